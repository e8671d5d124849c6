"""Render logs with exact ground truth: `python -m tools.make_logs` writes those of logs/ anew.

    python -m tools.make_logs --hard build/hard                       # all hard logs
    python -m tools.make_logs --hard build/hard corridor 'walking_*'  # some, in this order
    python -m tools.make_logs --hard build/small --width 320 --frames 40
    python -m tools.make_logs --hard build/loops block office mower lanes eight --width 256 --seed 1

    python -m tools.make_logs --random 12 build/worlds                # all of it drawn from the seed 12
    python -m tools.make_logs --random 12 build/worlds --without-faults
    python -m tools.make_logs --random 12 build/worlds --faults late zoom    # or how many: --faults 2

The five before these are worlds that are seen more than once. Another seed has other textures, noise and paths. Hard
logs are the scenes of tools/render/hard.py and tools/render/loops.py, and motions of tools/render/motions.py with the
faults of tools/render/faults.py, as walking_clean and walking_rs20. Logs drawn at random are those of
tools/render/worlds.py. README.txt beside them says what is wrong in each.
With --imu bmi160 (or consumer) hard logs have the samples of such a unit, too (tools/render/inertial.py).
Images that several logs of one call share are rendered once. The logs follow docs/log-profile.md.
"""

import argparse
import fcntl
import hashlib
import multiprocessing
import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

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
from render.worlds import ALL_FAULTS, World, drawn_world

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3
from stream_sfm.logs.mcap_file.message import Message as Stored
from stream_sfm.logs.sources.profile import ProfileEncoder

START_NS = 1_760_000_000_000_000_000
SEED = 7
JPEG_QUALITY = {"demo": 72}  # other logs: 80
WORLD_JPEG_QUALITY = 92
DEPTH_EVERY = {"demo": 60}  # frames; other logs: 10
DEPTH_UNIT_M = 1e-4
SENSOR = Sensor(gain_right=0.98)
FRAME_IDS = {"left": "left_camera_optical_frame", "right": "right_camera_optical_frame"}


MESSAGES = {kind.__name__: kind for kind in (CameraCalibration, CompressedImage, PoseInFrame)}
SAMPLES = ("room", "demo")
HARD = ["demo", *RECORDINGS, *LOOPS, *(f"{motion}_{fault}" for motion in MOTIONS for fault in FAULTS)]


class Rendered(Protocol):
    """A log to render. `stem`: of its file's name; `scene`: logs with the same one may share images."""

    seed: int

    @property
    def stem(self) -> str: ...
    @property
    def scene(self) -> Any: ...
    @property
    def jpeg_quality(self) -> int: ...
    @property
    def depth_every(self) -> int: ...  # frames; 0: no depth images
    @property
    def imu(self) -> str | None: ...  # the inertial unit whose samples the log has
    @property
    def truth(self) -> str: ...  # what is wrong in this log; {middle} is its middle frame
    def recording(self) -> Recording: ...


@dataclass(frozen=True, slots=True)
class Order:
    """A sample log (`name` room) or a hard one, and how large."""

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
    def stem(self) -> str:
        return f"{self.name}{self.seed or ''}"

    @property
    def scene(self) -> tuple[str, int, int | None, int]:
        return self.name.partition("_")[0], self.width, self.frames, self.seed

    @property
    def jpeg_quality(self) -> int:
        return JPEG_QUALITY.get(self.name, 80)

    @property
    def depth_every(self) -> int:
        return DEPTH_EVERY.get(self.name, 10)

    @property
    def truth(self) -> str:
        fault = self.name.partition("_")[2]
        return FAULTS[fault].truth if fault else "nothing is wrong with the rig, the scene is hard"


@dataclass(frozen=True)
class WorldOrder:
    """A world drawn from a seed. `asked`: its faults by name or number; None for those that the seed has."""

    seed: int
    asked: tuple[str, ...] | int | None = None

    depth_every = 0

    @property
    def imu(self) -> str | None:
        return self.world.imu

    @property
    def world(self) -> World:
        return _world(self.seed, self.asked)

    def recording(self) -> Recording:
        """The clean scene is built once for all orders of a seed."""
        return self.world.with_faults(_clean_world(self.seed))

    @property
    def stem(self) -> str:
        asked = () if self.asked is None else ("_".join(self.world.faults) or "clean",)
        return "_".join((f"world{self.seed}", *asked))

    @property
    def scene(self) -> tuple[str, int]:
        return "world", self.seed

    @property
    def jpeg_quality(self) -> int:
        fault = self.world.faults.get("jpeg")
        return WORLD_JPEG_QUALITY if fault is None or fault.jpeg_quality is None else fault.jpeg_quality

    @property
    def truth(self) -> str:
        return self.world.truth


@lru_cache(maxsize=4)
def _world(seed: int, asked: tuple[str, ...] | int | None) -> World:
    return drawn_world(seed, asked)


@lru_cache(maxsize=1)
def _clean_world(seed: int) -> Recording:
    return _world(seed, ()).clean()


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


def _image(recording: Recording, order: Rendered, i: int, side: str, shared: Path) -> CompressedImage:
    """The image of a side in frame i; taken from the folder `shared` where another log had the same one."""
    view = recording.view(i, side, SEED + order.seed)
    made_of = (order.scene, order.jpeg_quality, recording.readout_s, view)
    kept = shared / hashlib.sha256(pickle.dumps(made_of)).hexdigest()
    if not kept.exists():
        options = [cv2.IMWRITE_JPEG_QUALITY, order.jpeg_quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
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
    return CompressedImage(timestamp=_stamp(stamp_ns), frame_id=FRAME_IDS["left"], data=data.tobytes(), format="png")


def _pose(stamp_ns: int, world_from_cam: np.ndarray) -> PoseInFrame:
    message = PoseInFrame(timestamp=_stamp(stamp_ns), frame_id="world")
    position, orientation = message.pose.position, message.pose.orientation
    position.x, position.y, position.z = world_from_cam[:3, 3]
    orientation.x, orientation.y, orientation.z, orientation.w = se3.quat_xyzw_from_matrix(world_from_cam[:3, :3])
    return message


def _stamp_ns(recording: Recording, i: int) -> int:
    return START_NS + round(1e9 * (i / recording.rate_hz + recording.stamp_error_s(i)))


def frame_messages(order: Rendered, i: int, shared: Path) -> Iterator[tuple[str, Message]]:
    """Topics and messages of one frame, calibration first."""
    recording = order.recording()
    stamp_ns = _stamp_ns(recording, i)
    if i % round(recording.rate_hz) == 0:
        for side, calibration in calibration_messages(recording.rig, stamp_ns).items():
            yield f"/camera/{side}/calibration", calibration
    for side in SIDES:
        yield f"/camera/{side}/image", _image(recording, order, i, side, shared)
    yield "/ground_truth/pose", _pose(stamp_ns, recording.pose(i))
    if order.depth_every and i % order.depth_every == 0:
        yield "/ground_truth/depth", _depth(stamp_ns, recording.depth_m(i))


def _frames(order: Rendered) -> int:
    cv2.setNumThreads(1)
    return order.recording().frames


def _frame(task: tuple[Rendered, int, Path]) -> tuple[int, list[tuple[str, str, bytes]]]:
    """The stamp, and topic, type and content of each message of a frame: messages themselves cannot be pickled."""
    cv2.setNumThreads(1)
    order, i, _ = task
    return _stamp_ns(order.recording(), i), [
        (topic, type(m).__name__, m.SerializeToString()) for topic, m in frame_messages(*task)
    ]


def inertial_messages(order: Rendered) -> list[Stored]:
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


def write_logs(folder: Path, orders: Sequence[Rendered], workers: int) -> None:
    """Render logs into a folder, each one MCAP file in zstd chunks, which has its name when it is whole.

    One worker is this process itself.
    """
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of the workers: there are enough of them
    with ExitStack() as stack:
        shared = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="shared-images-")))
        mapped: Callable[..., Iterable[Any]] = map
        if workers > 1:  # OpenCV's threads do not survive a fork
            mapped = stack.enter_context(multiprocessing.get_context("spawn").Pool(workers)).imap
        for order in orders:
            (frames,) = mapped(_frames, [order])
            path = folder / f"{order.stem}.mcap"
            part = path.with_name(f"{path.name}.{os.getpid()}.part")  # another process may render the same
            waiting = inertial_messages(order)
            _write(part, mapped(_frame, ((order, i, shared) for i in range(frames))), frames, waiting)
            part.replace(path)
            print(f"{path}: {path.stat().st_size / 1e6:.2f} MB", file=sys.stderr)
            if order.stem not in SAMPLES:
                _note(folder / "README.txt", path.stem, order.truth.format(middle=frames // 2))


def _write(
    path: Path, content: Iterable[tuple[int, list[tuple[str, str, bytes]]]], frames: int, waiting: list[Stored]
) -> None:
    """Write the stamps and messages of frames, and inertial ones, into a log; says on a terminal how far it is."""
    told = sys.stderr.isatty()
    with (
        path.open("wb") as file,
        Writer(file, chunk_size=512 * 1024, compression=CompressionType.ZSTD) as writer,
    ):
        channels: dict[str, int] = {}
        for i, (stamp_ns, messages) in enumerate(content):
            _write_samples(writer, waiting, stamp_ns, channels)
            for topic, kind, data in messages:
                message = MESSAGES[kind].FromString(data)
                writer.write_message(topic, message, log_time=stamp_ns, publish_time=stamp_ns, sequence=i)
            if told:
                print(f"\r{path.stem}: frame {i + 1} of {frames} ", end="", file=sys.stderr, flush=True)
        _write_samples(writer, waiting, 2**62, channels)


def _note(path: Path, name: str, truth: str) -> None:
    """Write the line of a log into the list of what is wrong in each, or replace it; others may be doing so, too."""
    with path.open("a+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        kept = [line for line in file.read().splitlines() if not line.startswith(f"{name}: ")]
        file.truncate(0)
        file.write("\n".join([*kept, f"{name}: {truth}", ""]))


def asked_faults(given: Sequence[str] | None) -> tuple[str, ...] | int | None:
    """Faults as the command line has them: names, how many, or as the seed has them. Raises ValueError."""
    if given is None:
        return None
    if len(given) == 1 and given[0].isdigit():
        return int(given[0])
    unknown = [name for name in given if name not in ALL_FAULTS]
    if unknown:
        raise ValueError(f"no fault is called {unknown[0]}; there are {', '.join(ALL_FAULTS)}")
    return tuple(given)


def main() -> None:
    """Parse the command line and render."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hard", nargs="+", metavar=("DIR", "NAME"),
                        help=f"hard logs into this folder instead of the room into logs/: names or patterns of "
                        f"{', '.join(RECORDINGS)}, and MOTION_FAULT with a motion of {', '.join(MOTIONS)} and a fault "
                        f"of {', '.join(FAULTS)}; default: all")  # fmt: skip
    parser.add_argument(
        "--random", nargs=2, metavar=("SEED", "DIR"), help="a world drawn from this seed, into a folder"
    )
    parser.add_argument(
        "--without-faults", action="store_true", help="of a random world: the same scene, nothing wrong"
    )
    parser.add_argument("--faults", nargs="+", metavar="NAME", help="of a random world: a number, or names of "
                        f"{', '.join(ALL_FAULTS)}; default: as the seed has it")  # fmt: skip
    parser.add_argument("--workers", type=int, default=2, help="processes that render")
    parser.add_argument("--width", type=int, default=640, help="pixels, of hard logs")
    parser.add_argument("--seed", type=int, default=0, help="of textures, noise and paths; not 0: in the log's name")
    parser.add_argument("--imu", choices=tuple(UNITS), help="give hard logs the samples of an inertial unit")
    parser.add_argument("--frames", type=int, help="frames of hard logs; default: as many as each has")
    arguments = parser.parse_args()
    if arguments.random:
        seed, folder = arguments.random
        try:
            asked = () if arguments.without_faults else asked_faults(arguments.faults)
            order = WorldOrder(int(seed), asked)
        except ValueError as error:
            parser.error(str(error))
        write_logs(Path(folder), [order], arguments.workers)
        return
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
