"""Render logs with exact ground truth: `python -m tools.make_logs` writes those of logs/ anew.

    python -m tools.make_logs --hard build/hard                       # all hard logs
    python -m tools.make_logs --hard build/hard corridor 'walking_*'  # some, in this order
    python -m tools.make_logs --hard build/small --width 320 --frames 40
    python -m tools.make_logs --hard build/loops block office mower lanes eight --width 256 --seed 1

The last five are worlds that are seen more than once. Another seed has other textures, noise and paths. Hard logs are
the scenes of tools/render/hard.py and tools/render/loops.py, and motions of tools/render/motions.py with the faults of
tools/render/faults.py, as walking_clean and walking_rs20; README.txt beside them says what is wrong in each.
With --imu bmi160 (or consumer) hard logs have the samples of such a unit, too (tools/render/inertial.py).
Images that several logs of one call share are rendered once. The logs follow docs/log-profile.md.
"""

import argparse
import hashlib
import multiprocessing
import os
import pickle
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
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

sys.path.insert(0, str(Path(__file__).parent))
from render import FAULTS, LOOPS, MOTIONS, RECORDINGS, SIDES, Recording, Sensor, demo_recording, room_recording
from render.inertial import UNITS, measured

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3
from stream_sfm.mcap_file.message import Message as Stored
from stream_sfm.sources.profile import ProfileEncoder

START_NS = 1_760_000_000_000_000_000
SEED = 7
JPEG_QUALITY = {"demo": 72}  # other logs: 80
DEPTH_EVERY = {"demo": 60}  # frames; other logs: 10
DEPTH_UNIT_M = 1e-4
SENSOR = Sensor(gain_right=0.98)
FRAME_IDS = {"left": "left_camera_optical_frame", "right": "right_camera_optical_frame"}


MESSAGES = {kind.__name__: kind for kind in (CameraCalibration, CompressedImage, PoseInFrame)}
SAMPLES = ("room", "demo")
HARD = ["demo", *RECORDINGS, *LOOPS, *(f"{motion}_{fault}" for motion in MOTIONS for fault in FAULTS)]


@dataclass(frozen=True, slots=True)
class Order:
    """What to render: the sample log (`name` room) or a hard one, and how large."""

    name: str = "room"
    width: int = 640
    frames: int | None = None
    seed: int = 0
    imu: str | None = None

    def recording(self) -> Recording:
        """Build the scene, which takes some seconds unless it was built before."""
        motion, _, fault = self.name.partition("_")
        clean = _clean(motion, self.width, self.frames, self.seed)
        return FAULTS[fault].applied(clean) if fault else clean

    @property
    def truth(self) -> str:
        """What is wrong in this log; {middle} is its middle frame."""
        fault = self.name.partition("_")[2]
        return FAULTS[fault].truth if fault else "nothing is wrong with the rig, the scene is hard"


@lru_cache(maxsize=len(MOTIONS))
def _clean(name: str, width: int, frames: int | None, seed: int) -> Recording:
    if name == "room":
        return room_recording(SEED, SENSOR)
    if name == "demo":
        return demo_recording(SEED + seed)
    asked = {} if frames is None else {"frames": frames}
    if name in LOOPS:
        return LOOPS[name](width=width, seed=seed, **asked)
    return (RECORDINGS | MOTIONS)[name](width=width, seed=seed, **asked).wandering(seed)


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


def _image(recording: Recording, order: Order, i: int, side: str, shared: Path) -> CompressedImage:
    """The image of a side in frame i; taken from the folder `shared` where another log had the same one."""
    view = recording.view(i, side, SEED + order.seed)
    made_of = (order.name.partition("_")[0], order.width, order.frames, order.seed, recording.readout_s, view)
    kept = shared / hashlib.sha256(pickle.dumps(made_of)).hexdigest()
    if not kept.exists():
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY.get(order.name, 80), cv2.IMWRITE_JPEG_OPTIMIZE, 1]
        ok, data = cv2.imencode(".jpg", recording.image(view), options)
        assert ok
        kept.write_bytes(data.tobytes())
    return CompressedImage(
        timestamp=_stamp(_stamp_ns(recording, i)), frame_id=FRAME_IDS[side], data=kept.read_bytes(), format="jpeg"
    )


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


def _stamp_ns(recording: Recording, i: int) -> int:
    return START_NS + round(i * 1e9 / recording.rate_hz)


def frame_messages(order: Order, i: int, shared: Path) -> Iterator[tuple[str, Message]]:
    """Topics and messages of one frame, calibration first."""
    recording = order.recording()
    stamp_ns = _stamp_ns(recording, i)
    if i % round(recording.rate_hz) == 0:
        for side, calibration in calibration_messages(recording.rig, stamp_ns).items():
            yield f"/camera/{side}/calibration", calibration
    for side in SIDES:
        yield f"/camera/{side}/image", _image(recording, order, i, side, shared)
    yield "/ground_truth/pose", _pose(stamp_ns, recording.pose(i))
    if i % DEPTH_EVERY.get(order.name, 10) == 0:
        yield "/ground_truth/depth", _depth(stamp_ns, recording.depth_m(i))


def _frames_and_rate(order: Order) -> tuple[int, float]:
    cv2.setNumThreads(1)
    return order.recording().frames, order.recording().rate_hz


def _frame(task: tuple[Order, int, Path]) -> list[tuple[str, str, bytes]]:
    """Topic, type and content of each message of a frame: messages themselves cannot be pickled."""
    cv2.setNumThreads(1)
    return [(topic, type(m).__name__, m.SerializeToString()) for topic, m in frame_messages(*task)]


def inertial_messages(order: Order) -> list[Stored]:
    """The mounting and the samples of the inertial unit of a log, in order of time; none without one."""
    if order.imu is None:
        return []
    recording, unit, encoder = order.recording(), UNITS[order.imu], ProfileEncoder(None)
    down = recording.scene.room_from_world[:3, :3].T @ np.array([0, 0, -1.0])
    span_s = (-0.2, (recording.frames - 1) / recording.rate_hz + 0.05)
    samples = measured(recording.path, span_s, down, unit, SEED + order.seed, START_NS)
    rows = np.concatenate([samples.gyro_rad_s, samples.accel_m_s2], axis=1)
    stored = [encoder.imu_mounting(int(samples.stamps_ns[0]), unit.calibration)]
    return [*stored, *map(encoder.imu_sample, samples.stamps_ns.tolist(), rows)]


def _write_samples(writer: Writer, waiting: list[Stored], until_ns: int, channels: dict[str, int]) -> None:
    """Write the inertial messages up to a time, and forget them."""
    plain = writer._writer  # the one of MCAP, as these messages are no protobuf
    while waiting and waiting[0].log_time_ns <= until_ns:
        channel, time_ns, data, *_ = waiting.pop(0)
        if channel.topic not in channels:
            schema = plain.register_schema(channel.schema_name, channel.schema_encoding, channel.definition)
            channels[channel.topic] = plain.register_channel(channel.topic, channel.message_encoding, schema)
        plain.add_message(channels[channel.topic], time_ns, data, time_ns)


def write_logs(folder: Path, orders: Sequence[Order], workers: int) -> None:
    """Render logs into a folder, each one MCAP file in zstd chunks, which has its name when it is whole."""
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of the workers: there are enough of them
    with (
        tempfile.TemporaryDirectory(prefix="shared-images-") as shared,
        multiprocessing.get_context("spawn").Pool(workers) as pool,  # OpenCV's threads do not survive a fork
    ):
        for order in orders:
            frames, rate_hz = pool.apply(_frames_and_rate, (order,))
            path = folder / f"{order.name}{order.seed or ''}.mcap"
            part = path.with_name(path.name + ".part")
            with (
                part.open("wb") as file,
                Writer(file, chunk_size=512 * 1024, compression=CompressionType.ZSTD) as writer,
            ):
                tasks = ((order, i, Path(shared)) for i in range(frames))
                waiting: list[Stored] = pool.apply(inertial_messages, (order,))
                channels: dict[str, int] = {}
                for i, messages in enumerate(pool.imap(_frame, tasks)):
                    stamp_ns = START_NS + round(i * 1e9 / rate_hz)
                    _write_samples(writer, waiting, stamp_ns, channels)
                    for topic, kind, content in messages:
                        message = MESSAGES[kind].FromString(content)
                        writer.write_message(topic, message, log_time=stamp_ns, publish_time=stamp_ns, sequence=i)
                    if i == frames - 1:
                        _write_samples(writer, waiting, 2**62, channels)
                    print(f"\r{path.name}: frame {i + 1} of {frames}", end="", file=sys.stderr, flush=True)
            part.replace(path)
            print(f"\n{path}: {path.stat().st_size / 1e6:.2f} MB", file=sys.stderr)
            if order.name not in SAMPLES:
                _note(folder / "README.txt", path.stem, order.truth.format(middle=frames // 2))


def _note(path: Path, name: str, truth: str) -> None:
    """Write the line of a log into the list of what is wrong in each, or replace it."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    kept = [line for line in lines if not line.startswith(f"{name}: ")]
    path.write_text("\n".join([*kept, f"{name}: {truth}", ""]), encoding="utf-8")


def main() -> None:
    """Parse the command line and render."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hard", nargs="+", metavar=("DIR", "NAME"),
                        help=f"hard logs into this folder instead of the room into logs/: names or patterns of "
                        f"{', '.join(RECORDINGS)}, and MOTION_FAULT with a motion of {', '.join(MOTIONS)} and a fault "
                        f"of {', '.join(FAULTS)}; default: all")  # fmt: skip
    parser.add_argument("--workers", type=int, default=2, help="processes that render")
    parser.add_argument("--width", type=int, default=640, help="pixels, of hard logs")
    parser.add_argument(
        "--seed", type=int, default=0, help="of textures, noise and paths; not 0: in the log's name"
    )
    parser.add_argument("--imu", choices=tuple(UNITS), help="give hard logs the samples of an inertial unit")
    parser.add_argument("--frames", type=int, help="frames of hard logs; default: as many as each has")
    arguments = parser.parse_args()
    if not arguments.hard:
        write_logs(Path(__file__).parents[1] / "logs", [Order(name) for name in SAMPLES], arguments.workers)
        return
    folder, *patterns = arguments.hard
    names = {name: None for pattern in patterns or ["*"] for name in HARD if fnmatchcase(name, pattern)}
    unknown = [p for p in patterns if not any(fnmatchcase(name, p) for name in HARD)]
    if unknown:
        parser.error(f"no hard log is called {unknown[0]}; there are {', '.join(HARD)}")
    orders = [Order(name, arguments.width, arguments.frames, arguments.seed, arguments.imu) for name in names]
    write_logs(Path(folder), orders, arguments.workers)


if __name__ == "__main__":
    main()
