"""Small stereo logs for the tests, written with the public MCAP libraries.

One function, `write_log`, covers profile × image encoding × container layout; the scene is a textured wall seen by
two parallel cameras, so that disparity is 12 px everywhere.
"""

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import Message as Protobuf
from mcap.writer import CompressionType, IndexType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2._dynamic import serialize_dynamic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3
from tests.helpers import idl

WIDTH, HEIGHT, FOCAL_PX, BASELINE_M, DISPARITY_PX = 96, 64, 80.0, 0.3, 12
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 100_000_000

_IN_ROS2, _IN_ROS1 = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS1_NOETIC)
_STEREO = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo")
_PLACES = ("tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/Transform")
ROS2 = {name: _IN_ROS2.generate_msgdef(name, ros_version=2)[0] for name in (*_STEREO, *_PLACES)}
_IN_ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))


def _ros1(name: str) -> str:
    """A definition as recorders of ROS 1 write it: they differ in the name of the header and the length of a rule."""
    text = _IN_ROS1.generate_msgdef(name)[0].replace("=" * 80, "=" * 16)
    return text.replace("std_msgs/Header header", "Header header", 1) if "Image" in name else text


ROS1 = {name.replace("/msg/", "/"): _ros1(name) for name in (*_STEREO, *_PLACES)}
_NO_ROI = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}

K = np.array([[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1.0]])


@dataclass(frozen=True)
class Calib:
    """One calibration message; `P` of the right camera holds −f·baseline."""

    width: int = WIDTH
    height: int = HEIGHT
    model: str = "plumb_bob"
    D: tuple[float, ...] = (0.0,) * 5
    K: np.ndarray = field(default_factory=K.copy)
    R: np.ndarray = field(default_factory=lambda: np.eye(3))
    P: np.ndarray = field(default_factory=lambda: np.c_[K, np.zeros(3)])


def right_calib(**changes: Any) -> Calib:
    """The right camera of the default pair."""
    p = np.c_[K, [-FOCAL_PX * BASELINE_M, 0, 0]]
    return replace(Calib(P=p), **changes)


def calibration_of(stereo: StereoRig, model: str) -> tuple[Calib, Calib]:
    """Both messages as a calibration tool writes them, R and P by OpenCV; `model` is the name of the lens."""
    r, t = stereo.right_from_left[:3, :3], stereo.right_from_left[:3, 3:]
    left, right = stereo.left, stereo.right
    size = (left.width, left.height)
    # R and P depend on the lens in focal length and centre only, which are free
    r1, r2, p1, p2, *_ = cv2.stereoRectify(left.K, np.zeros(4), right.K, np.zeros(4), size, r, t)
    return tuple(Calib(*size, model, c.D, c.K, r, p) for c, r, p in ((left, r1, p1), (right, r2, p2)))


def infos_of(stereo: StereoRig, baseline_m: float | None = None) -> tuple[Calib, Calib]:
    """Both messages of a parallel pair without distortion; with `baseline_m`, of another baseline than its own."""
    camera, x = stereo.left, stereo.baseline_m if baseline_m is None else baseline_m
    projections = (np.c_[camera.K, [-camera.K[0, 0] * offset, 0, 0]] for offset in (0.0, x))
    return tuple(Calib(camera.width, camera.height, K=camera.K, D=(), P=p) for p in projections)


@dataclass(frozen=True)
class Spec:
    """What to write; the defaults are a sound log of 12 frames."""

    profile: str = "foxglove"  # foxglove, json, ros2, ros1
    encoding: str = "png"
    topics: tuple[str, str] = ("/camera/left/image", "/camera/right/image")
    info_topics: tuple[str, str] = ("/camera/left/calibration", "/camera/right/calibration")
    infos: tuple[Calib | None, Calib | None] = field(default_factory=lambda: (Calib(), right_calib()))
    left: tuple[int, ...] = tuple(range(12))  # numbers of the frames that were recorded on each side
    right: tuple[int, ...] = tuple(range(12))
    truth: bool = False
    size: tuple[int, int] = (WIDTH, HEIGHT)


def scene(frame: int, side: int, size: tuple[int, int] = (WIDTH, HEIGHT)) -> np.ndarray:
    """Grey image (h, w) uint8 of one side; the wall moves 2 px a frame."""
    rng = np.random.default_rng(7)
    width, height = size
    wall = cv2.GaussianBlur(rng.integers(0, 256, (height, 4 * width + 200), dtype=np.uint8), (0, 0), 1.2)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)
    start = 20 + 2 * frame + (DISPARITY_PX if side else 0)
    return np.ascontiguousarray(wall[:, start : start + width])


def encode(grey: np.ndarray, encoding: str) -> tuple[bytes, int, bool]:
    """Bytes, bytes a row (0: compressed) and big-endianness of a grey image in `encoding`."""
    width = grey.shape[1]
    if encoding in ("png", "jpeg", "webp"):
        return cv2.imencode(f".{encoding}", grey)[1].tobytes(), 0, False
    if encoding.startswith("mono16"):
        big = encoding.endswith("-be")
        return (grey.astype(np.uint16) * 16).astype(">u2" if big else "<u2").tobytes(), 2 * width, big
    if encoding == "mono8-padded":
        return np.pad(grey, ((0, 0), (0, 5))).tobytes(), width + 5, False
    if encoding in ("rgb8", "bgr8", "rgba8", "bgra8"):
        channels = 4 if "a" in encoding else 3
        return np.repeat(grey, channels, axis=1).tobytes(), channels * width, False
    if encoding == "bgr8-padded":
        colour = np.repeat(grey, 3, axis=1)
        return np.pad(colour, ((0, 0), (0, 7)), constant_values=255).tobytes(), 3 * width + 7, False
    if encoding == "nv12":
        return grey.tobytes() + b"\x80" * (grey.size // 2), width, False
    if encoding == "uyvy":
        return np.stack([np.full_like(grey, 128), grey], axis=2).tobytes(), 2 * width, False
    if encoding == "yuv422_yuy2":
        return np.stack([grey, np.full_like(grey, 128)], axis=2).tobytes(), 2 * width, False
    return grey.tobytes(), width, False  # mono8, bayer_*, and what is refused


class LogWriter:
    """Messages of the four dialects into one MCAP file."""

    def __init__(self, path: Path, **container: Any) -> None:
        self._stream = path.open("wb")
        self.writer = Writer(self._stream, **container)
        self.writer.start(profile="", library="tests")
        self._channels: dict[tuple[str, str], int] = {}
        self.clock_ns: int | None = None  # of the recorder; None: it agrees with the stamps

    def add(
        self, topic: str, schema: str, encodings: tuple[str, str], definition: bytes, time: int, data: bytes
    ) -> None:
        if (topic, schema) not in self._channels:
            schema_id = self.writer.register_schema(schema, encodings[1], definition)
            self._channels[topic, schema] = self.writer.register_channel(topic, encodings[0], schema_id)
        log_time = time if self.clock_ns is None else self.clock_ns
        self.writer.add_message(self._channels[topic, schema], log_time, data, log_time)

    def protobuf(self, topic: str, message: Protobuf, time: int) -> None:
        definition = build_file_descriptor_set(type(message)).SerializeToString()
        name = type(message).DESCRIPTOR.full_name
        self.add(topic, name, ("protobuf", "protobuf"), definition, time, message.SerializeToString())

    def ros(self, profile: str, topic: str, name: str, message: dict[str, Any], time: int) -> None:
        """A message of ROS; `profile`: ros1, ros2, or ros2idl."""
        data = serialize_dynamic(name, ROS2[name])[name](message)
        if profile == "ros1":
            old = name.replace("/msg/", "/")
            content = bytes(_IN_ROS2.cdr_to_ros1(data, name))
            self.add(topic, old, ("ros1", "ros1msg"), ROS1[old].encode(), time, content)
        elif profile == "ros2idl":
            self.add(topic, name, ("cdr", "ros2idl"), idl.definition(name).encode(), time, data)
        else:
            self.add(topic, name, ("cdr", "ros2msg"), ROS2[name].encode(), time, data)

    def foxglove(self, profile: str, topic: str, kind: Any, fields: dict[str, Any], time: int) -> None:
        """A message of Foxglove's; `profile`: foxglove, in protobuf, or json."""
        if profile == "json":
            text = fields | {"timestamp": {"sec": time // 10**9, "nsec": time % 10**9}}
            data = json.dumps(text, default=lambda data: base64.b64encode(data).decode()).encode()
            self.add(topic, kind.DESCRIPTOR.full_name, ("json", "jsonschema"), b'{"type":"object"}', time, data)
        else:
            message = kind(**fields)
            message.timestamp.FromNanoseconds(time)
            self.protobuf(topic, message, time)

    def close(self) -> None:
        self.writer.finish()
        self._stream.close()


def write_image(
    log: LogWriter, profile: str, topic: str, time: int, grey: np.ndarray, encoding: str, frame_id: str = "left"
) -> None:
    """One image message, header stamp `time`. `profile`: foxglove, json, ros2, ros2idl or ros1."""
    data, step, big = encode(grey, encoding)
    name = encoding.removesuffix("-be").removesuffix("-padded")
    height, width = grey.shape
    raw = {"height": height, "width": width, "encoding": name, "step": step, "data": data}
    fields = raw if step else {"format": name, "data": data}
    kind = "Image" if step else "CompressedImage"
    if profile in ("foxglove", "json"):
        log.foxglove(profile, topic, RawImage if step else CompressedImage, fields | {"frame_id": frame_id}, time)
    else:
        big_endian = {"is_bigendian": big} if step else {}
        message = {"header": _header(time, frame_id)} | fields | big_endian
        log.ros(profile, topic, f"sensor_msgs/msg/{kind}", message, time)


def write_info(log: LogWriter, profile: str, topic: str, time: int, c: Calib, frame_id: str = "left") -> None:
    """One calibration message."""
    k, r, p = (m.ravel().tolist() for m in (c.K, c.R, c.P))
    size = {"height": c.height, "width": c.width}
    if profile in ("foxglove", "json"):
        fields = size | {"frame_id": frame_id, "distortion_model": c.model, "D": c.D, "K": k, "R": r, "P": p}
        log.foxglove(profile, topic, CameraCalibration, fields, time)
    else:
        body = {"header": _header(time, frame_id)} | size | {"distortion_model": c.model}
        body |= {"d": list(c.D), "k": k, "r": r, "p": p, "binning_x": 0, "binning_y": 0, "roi": _NO_ROI}
        log.ros(profile, topic, "sensor_msgs/msg/CameraInfo", body, time)


def write_pair(
    log: LogWriter,
    profile: str,
    time: int,
    images: Sequence[np.ndarray],
    infos: Sequence[Calib] | None = None,
    encoding: str = "png",
    topics: Sequence[str] = Spec.topics,
    info_topics: Sequence[str] = Spec.info_topics,
    frame_ids: Sequence[str] = ("left", "right"),
) -> None:
    """Both images of one moment, each behind its calibration if there is one."""
    for side, grey in enumerate(images):
        if infos is not None:
            write_info(log, profile, info_topics[side], time, infos[side], frame_ids[side])
        write_image(log, profile, topics[side], time, grey, encoding, frame_ids[side])


def write_transform(
    log: LogWriter, profile: str, time: int, parent: str, child: str, parent_from_child: np.ndarray
) -> None:
    """One fixed transform: `/tf_static` in ROS, a FrameTransform on `/tf` in Foxglove's schemas."""
    t, q = parent_from_child[:3, 3].tolist(), se3.quat_xyzw_from_matrix(parent_from_child[:3, :3]).tolist()
    moved = {"translation": dict(zip("xyz", t, strict=True)), "rotation": dict(zip("xyzw", q, strict=True))}
    if profile in ("foxglove", "json"):
        fields = {"parent_frame_id": parent, "child_frame_id": child} | moved
        log.foxglove(profile, "/tf", FrameTransform, fields, time)
    else:
        stamped = {"header": _header(time, parent), "child_frame_id": child, "transform": moved}
        log.ros(profile, "/tf_static", "tf2_msgs/msg/TFMessage", {"transforms": [stamped]}, time)


def write_truth(log: LogWriter, time: int, world_from_cam: np.ndarray, depth: np.ndarray) -> None:
    """Ground truth of pose and depth, `depth` (h, w) uint16 in tenths of millimetres, 0 where it is not known."""
    t, q = world_from_cam[:3, 3].tolist(), se3.quat_xyzw_from_matrix(world_from_cam[:3, :3]).tolist()
    pose = {"position": dict(zip("xyz", t, strict=True)), "orientation": dict(zip("xyzw", q, strict=True))}
    log.foxglove("foxglove", "/ground_truth/pose", PoseInFrame, {"frame_id": "world", "pose": pose}, time)
    image = {"frame_id": "left", "format": "png", "data": cv2.imencode(".png", depth)[1].tobytes()}
    log.foxglove("foxglove", "/ground_truth/depth", CompressedImage, image, time)


def _header(time: int, frame_id: str) -> dict[str, Any]:
    return {"stamp": {"sec": time // 10**9, "nanosec": time % 10**9}, "frame_id": frame_id}


def write_log(path: Path, spec: Spec | None = None, **container: Any) -> Path:
    """The log of `spec` at `path`; `container` goes to `mcap.writer.Writer`. Returns the path."""
    spec = spec or Spec()
    log = LogWriter(path, **container)
    for n in range(max((*spec.left, *spec.right), default=-1) + 1):
        time = START_NS + n * PERIOD_NS
        for topic, info in zip(spec.info_topics, spec.infos, strict=True):
            if n == 0 and info is not None:
                write_info(log, spec.profile, topic, time, info)
        for side, numbers in enumerate((spec.left, spec.right)):
            if n in numbers:
                grey = scene(n, side, spec.size)
                write_image(log, spec.profile, spec.topics[side], time, grey, spec.encoding)
        if spec.truth:
            pose, depth = np.eye(4), np.full((HEIGHT, WIDTH), 20000, np.uint16)
            pose[0, 3], depth[0, 0] = 0.05 * n, 0
            write_truth(log, time, pose, depth)
    log.close()
    return path


CONTAINERS: dict[str, dict[str, Any]] = {
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 20_000},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 20_000},
    "uncompressed chunks": {"compression": CompressionType.NONE, "chunk_size": 20_000},
    "unchunked": {"use_chunking": False},
    "no index": {
        "chunk_size": 20_000, "index_types": IndexType.NONE, "repeat_channels": False, "repeat_schemas": False,
        "use_statistics": False, "use_summary_offsets": False,
    },
}  # fmt: skip


def video(path: Path) -> Path:
    """A log whose cameras are video that is not read."""
    log = LogWriter(path)
    for topic in Spec.topics:
        frame = {"frame_id": "left", "format": "av1", "data": b"\0\0\0\1"}
        log.foxglove("foxglove", topic, CompressedVideo, frame, START_NS)
    log.close()
    return path
