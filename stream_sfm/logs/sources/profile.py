"""Encodes the messages of the log profile (docs/log-profile.md): Foxglove protobuf, image bytes unchanged."""

import json
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding

from ...camera.models import Camera
from ...camera.pixels import Grey
from ...camera.rectification import Rectifier
from ...camera.rig import StereoRig
from ...geometry import Array, se3
from ...inertial.samples import ImuCalibration
from ...record import changed
from ..mcap_file.message import Channel, Message

_SIDES = ("left", "right")
_IMU_FRAME = "imu"
STD_KEYS = ("std_position_m", "std_rotation_rad")  # of ground truth, in the metadata of its channel
_FRAME_IDS = ("left_camera_optical_frame", "right_camera_optical_frame")
_CALIBRATION_PERIOD_NS = 1_000_000_000  # calibrations are repeated, so that each part of the log has one
_MODELS = {"none": "plumb_bob", "equidistant": "kannala_brandt"}  # different names in Foxglove's CameraCalibration


class ProfileEncoder:
    """Encodes one log; `rig` is None if the calibration is not known; `std_truth`: σ of its poses, m and rad."""

    def __init__(self, rig: StereoRig | None, std_truth: tuple[float, float] = (0.0, 0.0)) -> None:
        self.images = tuple(_channel(f"/camera/{side}/image", "CompressedImage") for side in _SIDES)
        self.raw_images = tuple(raw_channel(f"/camera/{side}/image") for side in _SIDES)
        self.both_images = raw_channel("/camera/both/image")  # side by side or stacked
        self.calibrations = tuple(_channel(f"/camera/{side}/calibration", "CameraCalibration") for side in _SIDES)
        std = zip(STD_KEYS, map(repr, std_truth), strict=True) if any(std_truth) else ()
        self.poses = changed(_channel("/ground_truth/pose", "PoseInFrame"), metadata=tuple(std))
        self.imu, self.transforms = (
            _json("/imu", "sensor_msgs/msg/Imu"),
            _json("/tf_static", "foxglove.FrameTransform"),
        )
        self._rig = rig
        self._messages = None if rig is None else calibration_messages(rig)
        self._last_calibration_ns: list[int | None] = [None, None]

    def image(self, side: int, stamp_ns: int, data: bytes, encoding: str) -> Message:
        """Encode one image of `side` (0 left, 1 right), `encoding` png, jpeg or webp."""
        message = _schema("CompressedImage")(frame_id=_FRAME_IDS[side], format=encoding, data=data)
        return _encoded(self.images[side], message, stamp_ns)

    def raw_image(self, side: int | None, stamp_ns: int, image: Grey) -> Message:
        """Encode one image of `side`, None if it holds both; grey (h, w) with 8 or 16 bits, not compressed."""
        channel = self.both_images if side is None else self.raw_images[side]
        return raw_message(channel, _FRAME_IDS[side or 0], stamp_ns, image)

    def due_calibration(self, side: int, stamp_ns: int) -> Iterator[Message]:
        """Yield the calibration of `side` if it is due before an image of this stamp."""
        last_ns = self._last_calibration_ns[side]
        if self._messages is not None and (last_ns is None or stamp_ns - last_ns >= _CALIBRATION_PERIOD_NS):
            self._last_calibration_ns[side] = stamp_ns
            yield _encoded(self.calibrations[side], self._messages[side], stamp_ns)

    def pose(self, stamp_ns: int, world_from_cam: Array) -> Message:
        """Encode one pose (4, 4) of ground truth: the physical left camera in the world, metres."""
        message = _schema("PoseInFrame")(frame_id="world")
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = world_from_cam[:3, 3]
        q.x, q.y, q.z, q.w = se3.quat_xyzw_from_matrix(world_from_cam[:3, :3])
        return _encoded(self.poses, message, stamp_ns)

    def imu_sample(self, stamp_ns: int, values: Array) -> Message:
        """Encode one sample (6,) of an inertial unit, rad/s and m/s²."""
        rate, force = (dict(zip("xyz", map(float, v), strict=True)) for v in (values[:3], values[3:]))
        header = {"stamp": _time(stamp_ns), "frame_id": _IMU_FRAME}
        sample = {"header": header, "angular_velocity": rate, "linear_acceleration": force}
        return _as_json(self.imu, sample, stamp_ns)

    def imu_mounting(self, stamp_ns: int, imu: ImuCalibration) -> Message:
        """Encode the pose of the inertial unit in the left camera."""
        pose = imu.cam_from_imu
        transform = {
            "timestamp": _time(stamp_ns),
            "parent_frame_id": _FRAME_IDS[0],
            "child_frame_id": _IMU_FRAME,
            "translation": dict(zip("xyz", pose[:3, 3].tolist(), strict=True)),
            "rotation": dict(zip("xyzw", se3.quat_xyzw_from_matrix(pose[:3, :3]).tolist(), strict=True)),
        }
        return _as_json(self.transforms, transform, stamp_ns)


def _time(stamp_ns: int) -> dict[str, int]:
    return {"sec": stamp_ns // 1_000_000_000, "nsec": stamp_ns % 1_000_000_000}


def _json(topic: str, schema: str) -> Channel:
    return Channel(topic, MessageEncoding.JSON, schema, SchemaEncoding.JSONSchema, b'{"type": "object"}')


def _as_json(channel: Channel, message: dict[str, Any], stamp_ns: int) -> Message:
    return Message(channel, stamp_ns, json.dumps(message).encode())


def raw_channel(topic: str) -> Channel:
    return _channel(topic, "RawImage")


def raw_message(channel: Channel, frame_id: str, stamp_ns: int, image: Grey) -> Message:
    """Encode one grey image (h, w) with 8 or 16 bits, not compressed, of a camera with this frame."""
    height, width = image.shape
    encoding, step = f"mono{8 * image.itemsize}", width * image.itemsize
    message = _schema("RawImage")(frame_id=frame_id, width=width, height=height, encoding=encoding, step=step)
    message.data = image.tobytes()
    return _encoded(channel, message, stamp_ns)


def calibration_messages(rig: StereoRig) -> tuple[Any, Any]:
    """Return K, D, R, P of both cameras in the ROS sense; a reader recovers the rig from them.

    A pair that is rectified already (parallel, undistorted, one K) keeps R = 1 and P = K.
    """
    pose, k = rig.right_from_left, rig.left.K
    parallel = np.array_equal(pose[:3, :3], np.eye(3)) and not pose[1:3, 3].any() and pose[0, 3] < 0
    if parallel and np.array_equal(k, rig.right.K) and not any((*rig.left.D, *rig.right.D)):
        left_p, right_p = (np.c_[k, [x, 0, 0]] for x in (0.0, k[0, 0] * pose[0, 3]))
        return _calibration(0, rig.left, np.eye(3), left_p), _calibration(1, rig.right, np.eye(3), right_p)
    rectifier = Rectifier(rig)
    p, r = rectifier.projection, rectifier.rect_from_cam
    left_p, right_p = (
        np.array([[p.f_px, 0, cx, tx], [0, p.f_px, p.cy_px, 0], [0, 0, 1, 0]])
        for cx, tx in ((p.cx_left_px, 0.0), (p.cx_right_px, -p.f_px * p.baseline_m))
    )
    return _calibration(0, rig.left, r, left_p), _calibration(1, rig.right, r @ pose[:3, :3].T, right_p)


def _calibration(side: int, camera: Camera, rotation: Array, projection: Array) -> Any:
    return _schema("CameraCalibration")(
        frame_id=_FRAME_IDS[side],
        width=camera.width,
        height=camera.height,
        distortion_model=_MODELS.get(camera.distortion_model, camera.distortion_model),
        D=camera.D if any(camera.D) else (0.0,) * 5,
        K=camera.K.ravel().tolist(),
        R=rotation.ravel().tolist(),
        P=projection.ravel().tolist(),
    )


@lru_cache
def _schema(name: str) -> Any:
    """Return a message type of Foxglove; imported here, as most runs encode none and need no protobuf."""
    from foxglove_schemas_protobuf import CameraCalibration_pb2, CompressedImage_pb2, PoseInFrame_pb2, RawImage_pb2

    modules = CameraCalibration_pb2, CompressedImage_pb2, PoseInFrame_pb2, RawImage_pb2
    return next(getattr(module, name) for module in modules if hasattr(module, name))


def _channel(topic: str, kind: str) -> Channel:
    return Channel(topic, MessageEncoding.Protobuf, f"foxglove.{kind}", SchemaEncoding.Protobuf, _definition(kind))


@lru_cache
def _definition(kind: str) -> bytes:
    from mcap_protobuf.schema import build_file_descriptor_set

    return build_file_descriptor_set(_schema(kind)).SerializeToString()


def _encoded(channel: Channel, message: Any, stamp_ns: int) -> Message:
    message.timestamp.FromNanoseconds(stamp_ns)
    return Message(channel, stamp_ns, message.SerializeToString())
