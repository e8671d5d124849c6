"""Render the sample logs: `python tools/make_logs.py` writes logs/room.mcap anew. Profile: logs/README.md."""

import argparse
import multiprocessing
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType
from mcap_protobuf.writer import Writer
from render import Scene, Sensor, Shot, render_stereo, room_path, room_rig, room_scene
from render.room import RATE_HZ

from stream_sfm.camera.models import Camera, StereoRig
from stream_sfm.geometry import se3

START_NS = 1_760_000_000_000_000_000
SEED = 7
JPEG_QUALITY = 80
DEPTH_EVERY = 10
DEPTH_UNIT_M = 1e-4
SENSOR = Sensor(gain_right=0.98)
FRAME_IDS = {"left": "left_camera_optical_frame", "right": "right_camera_optical_frame"}

_scene: Scene | None = None  # each worker builds its own: OpenCV's threads do not survive a fork


def _stamp(stamp_ns: int) -> Timestamp:
    return Timestamp(seconds=stamp_ns // 10**9, nanos=stamp_ns % 10**9)


def calibration_messages(rig: StereoRig, stamp_ns: int) -> dict[str, CameraCalibration]:
    """K, D, R, P of both cameras in the ROS sense; rectified to the common view (alpha = 0, equal centres)."""
    pose = rig.right_from_left
    r_left, r_right, p_left, p_right, *_ = cv2.stereoRectify(
        rig.left.K, np.array(rig.left.D), rig.right.K, np.array(rig.right.D),
        (rig.left.width, rig.left.height), pose[:3, :3].copy(), pose[:3, 3:].copy(),
        flags=cv2.CALIB_ZERO_DISPARITY, alpha=0,
    )  # fmt: skip

    def message(side: str, camera: Camera, r: np.ndarray, p: np.ndarray) -> CameraCalibration:
        return CameraCalibration(
            timestamp=_stamp(stamp_ns),
            frame_id=FRAME_IDS[side],
            width=camera.width,
            height=camera.height,
            distortion_model=camera.distortion_model,
            D=camera.D,
            K=camera.K.ravel(),
            R=r.ravel(),
            P=p.ravel(),
        )

    return {
        "left": message("left", rig.left, r_left, p_left),
        "right": message("right", rig.right, r_right, p_right),
    }


def _image(side: str, stamp_ns: int, image: np.ndarray) -> CompressedImage:
    ok, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY, cv2.IMWRITE_JPEG_OPTIMIZE, 1])
    assert ok
    return CompressedImage(timestamp=_stamp(stamp_ns), frame_id=FRAME_IDS[side], data=data.tobytes(), format="jpeg")


def _depth(stamp_ns: int, depth_m: np.ndarray) -> CompressedImage:
    units = np.rint(depth_m / DEPTH_UNIT_M)
    units[~(units <= 65535)] = 0  # beyond the range of the format: no value
    ok, data = cv2.imencode(".png", units.astype(np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    assert ok
    return CompressedImage(
        timestamp=_stamp(stamp_ns), frame_id=FRAME_IDS["left"], data=data.tobytes(), format="png"
    )


def _pose(stamp_ns: int, world_from_cam: np.ndarray) -> PoseInFrame:
    message = PoseInFrame(timestamp=_stamp(stamp_ns), frame_id="world")
    position, orientation = message.pose.position, message.pose.orientation
    position.x, position.y, position.z = world_from_cam[:3, 3]
    orientation.x, orientation.y, orientation.z, orientation.w = se3.quat_xyzw_from_matrix(world_from_cam[:3, :3])
    return message


def frame_messages(i: int, shot: Shot, world_from_cam: np.ndarray, rig: StereoRig) -> Iterator[tuple[str, Message]]:
    """Topics and messages of one frame, calibration first."""
    per_second = round(RATE_HZ)
    stamp_ns = START_NS + round(i * 1e9 / RATE_HZ)
    if i % per_second == 0:
        for side, calibration in calibration_messages(rig, stamp_ns).items():
            yield f"/camera/{side}/calibration", calibration
    yield "/camera/left/image", _image("left", stamp_ns, shot.left)
    yield "/camera/right/image", _image("right", stamp_ns, shot.right)
    yield "/ground_truth/pose", _pose(stamp_ns, world_from_cam)
    if i % DEPTH_EVERY == 0:
        yield "/ground_truth/depth", _depth(stamp_ns, shot.depth_m)


def _prepare() -> None:
    global _scene
    cv2.setNumThreads(1)
    _scene = room_scene(SEED)


def _rendered(job: tuple[int, np.ndarray]) -> Shot:
    i, world_from_cam = job
    assert _scene is not None
    return render_stereo(_scene, room_rig(), world_from_cam, SENSOR, (SEED, i))


def write_room(path: Path, workers: int) -> None:
    """Render the room and write it as one MCAP file, in zstd chunks."""
    jobs = list(enumerate(room_path()))
    with (
        path.open("wb") as file,
        Writer(file, chunk_size=512 * 1024, compression=CompressionType.ZSTD) as writer,
        multiprocessing.get_context("spawn").Pool(workers, _prepare) as pool,
    ):
        for (i, world_from_cam), shot in zip(jobs, pool.imap(_rendered, jobs), strict=True):
            stamp_ns = START_NS + round(i * 1e9 / RATE_HZ)
            for topic, message in frame_messages(i, shot, world_from_cam, room_rig()):
                writer.write_message(topic, message, log_time=stamp_ns, publish_time=stamp_ns, sequence=i)
            print(f"\r{path.name}: frame {i + 1} of {len(jobs)}", end="", flush=True)
    print(f"\n{path}: {path.stat().st_size / 1e6:.2f} MB")


def main() -> None:
    """Parse the command line and render."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "logs", help="folder")
    parser.add_argument("--workers", type=int, default=2, help="processes that render")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    write_room(arguments.out / "room.mcap", arguments.workers)
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
