"""Render logs with exact ground truth: `python tools/make_logs.py` writes logs/room.mcap anew.

    python tools/make_logs.py --hard crowd corridor --out build/hard    # the scenes of tools/render/hard.py
    python tools/make_logs.py --hard all --width 320 --frames 40 --out build/small

The logs follow docs/log-profile.md.
"""

import argparse
import multiprocessing
import sys
from collections.abc import Iterator
from dataclasses import dataclass
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
from render import RECORDINGS, Recording, Sensor, Shot, room_recording

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

START_NS = 1_760_000_000_000_000_000
SEED = 7
JPEG_QUALITY = 80
DEPTH_EVERY = 10
DEPTH_UNIT_M = 1e-4
SENSOR = Sensor(gain_right=0.98)
FRAME_IDS = {"left": "left_camera_optical_frame", "right": "right_camera_optical_frame"}


@dataclass(frozen=True, slots=True)
class Order:
    """What to render: the sample log (`name` room) or a hard one, and how large."""

    name: str = "room"
    width: int = 640
    frames: int | None = None

    def recording(self) -> Recording:
        """Build the scene; takes some seconds."""
        if self.name == "room":
            return room_recording(SEED, SENSOR)
        asked = {} if self.frames is None else {"frames": self.frames}
        return RECORDINGS[self.name](width=self.width, **asked)


_recording: Recording | None = None  # each worker builds its own: OpenCV's threads do not survive a fork


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


def frame_messages(i: int, shot: Shot, recording: Recording) -> Iterator[tuple[str, Message]]:
    """Topics and messages of one frame, calibration first."""
    stamp_ns = START_NS + round(i * 1e9 / recording.rate_hz)
    if i % round(recording.rate_hz) == 0:
        for side, calibration in calibration_messages(recording.rig, stamp_ns).items():
            yield f"/camera/{side}/calibration", calibration
    yield "/camera/left/image", _image("left", stamp_ns, shot.left)
    yield "/camera/right/image", _image("right", stamp_ns, shot.right)
    yield "/ground_truth/pose", _pose(stamp_ns, recording.pose(i))
    if i % DEPTH_EVERY == 0:
        yield "/ground_truth/depth", _depth(stamp_ns, shot.depth_m)


def _prepare(order: Order) -> None:
    global _recording
    cv2.setNumThreads(1)
    _recording = order.recording()


def _rendered(i: int) -> Shot:
    assert _recording is not None
    return _recording.shot(i, SEED)


def write_log(path: Path, order: Order, workers: int) -> None:
    """Render a recording and write it as one MCAP file, in zstd chunks; it has its name when it is whole."""
    recording = order.recording()
    part = path.with_name(path.name + ".part")
    with (
        part.open("wb") as file,
        Writer(file, chunk_size=512 * 1024, compression=CompressionType.ZSTD) as writer,
        multiprocessing.get_context("spawn").Pool(workers, _prepare, (order,)) as pool,
    ):
        for i, shot in enumerate(pool.imap(_rendered, range(recording.frames))):
            stamp_ns = START_NS + round(i * 1e9 / recording.rate_hz)
            for topic, message in frame_messages(i, shot, recording):
                writer.write_message(topic, message, log_time=stamp_ns, publish_time=stamp_ns, sequence=i)
            print(f"\r{path.name}: frame {i + 1} of {recording.frames}", end="", file=sys.stderr, flush=True)
    part.replace(path)
    print(f"\n{path}: {path.stat().st_size / 1e6:.2f} MB", file=sys.stderr)


def main() -> None:
    """Parse the command line and render."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "logs", help="folder")
    parser.add_argument("--workers", type=int, default=2, help="processes that render")
    parser.add_argument("--hard", nargs="+", default=[], choices=[*RECORDINGS, "all"], metavar="NAME",
                        help=f"hard scenes instead of the room: all, or some of {', '.join(RECORDINGS)}")  # fmt: skip
    parser.add_argument("--width", type=int, default=640, help="pixels, of hard scenes")
    parser.add_argument("--frames", type=int, help="frames of hard scenes; default: as many as each has")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    hard = list(RECORDINGS) if "all" in arguments.hard else arguments.hard
    for name in hard or ["room"]:
        write_log(arguments.out / f"{name}.mcap", Order(name, arguments.width, arguments.frames), arguments.workers)


if __name__ == "__main__":
    main()
