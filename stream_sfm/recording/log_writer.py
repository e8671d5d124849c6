"""Writes stereo logs in the log profile (docs/log-profile.md): image bytes unchanged, messages in Foxglove protobuf.

Topics: `/camera/{left,right}/image` (foxglove.CompressedImage), `/camera/{left,right}/calibration`
(foxglove.CameraCalibration, K D R P in the ROS sense, once a second), `/ground_truth/pose` (foxglove.PoseInFrame,
the physical left camera in the world).
"""

from pathlib import Path
from types import TracebackType
from typing import IO

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.writer import CompressionType
from mcap_protobuf.writer import Writer

from ..errors import OutputError
from ..geometry import se3
from ..geometry.se3 import Array
from .messages import CalibrationMessage

_CALIBRATION_PERIOD_NS = 1_000_000_000  # repeated, so that a part of the log can be read alone
SIDES = ("left", "right")
FRAME_IDS = ("left_camera_optical_frame", "right_camera_optical_frame")


class StereoLogWriter:
    """Writes one log; a context manager. Messages are given in ascending order of time.

    `calibrations`: left and right; their `topic` and `frame_id` are set here. The file appears under its name
    when it is finished; a run that fails leaves none. Raises OutputError where it cannot be written.
    """

    def __init__(self, path: str | Path, calibrations: tuple[CalibrationMessage, CalibrationMessage]) -> None:
        self.path = Path(path)
        self._part = self.path.with_name(self.path.name + ".part")
        self._calibrations = calibrations
        self._calibrated_ns: list[int | None] = [None, None]
        try:
            self._stream: IO[bytes] = self._part.open("wb")
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror}") from None
        # The images are compressed already; only their index is worth having.
        self._writer = Writer(self._stream, compression=CompressionType.NONE)

    def image(self, side: int, stamp_ns: int, data: bytes, encoding: str) -> None:
        """Write one image of `side` (0 left, 1 right), `encoding` png, jpeg or webp, its bytes as they are."""
        last = self._calibrated_ns[side]
        if last is None or stamp_ns - last >= _CALIBRATION_PERIOD_NS:
            self._calibrated_ns[side] = stamp_ns
            self._calibration(side, stamp_ns)
        message = CompressedImage(frame_id=FRAME_IDS[side], format=encoding, data=data)
        message.timestamp.FromNanoseconds(stamp_ns)
        self._write(f"/camera/{SIDES[side]}/image", message, stamp_ns)

    def pose(self, stamp_ns: int, world_from_cam: Array) -> None:
        """Write one pose (4, 4) of ground truth: the physical left camera in the world, metres."""
        message = PoseInFrame(frame_id="world")
        message.timestamp.FromNanoseconds(stamp_ns)
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = world_from_cam[:3, 3]
        q.x, q.y, q.z, q.w = se3.quat_xyzw_from_matrix(world_from_cam[:3, :3])
        self._write("/ground_truth/pose", message, stamp_ns)

    def _calibration(self, side: int, stamp_ns: int) -> None:
        c = self._calibrations[side]
        message = CameraCalibration(
            frame_id=FRAME_IDS[side],
            width=c.width,
            height=c.height,
            distortion_model=c.distortion_model,
            D=c.D,
            K=c.K.ravel().tolist(),
            R=c.R.ravel().tolist(),
            P=c.P.ravel().tolist(),
        )
        message.timestamp.FromNanoseconds(stamp_ns)
        self._write(f"/camera/{SIDES[side]}/calibration", message, stamp_ns)

    def _write(self, topic: str, message: CompressedImage | CameraCalibration | PoseInFrame, stamp_ns: int) -> None:
        try:
            self._writer.write_message(topic, message, log_time=stamp_ns, publish_time=stamp_ns)
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror}") from None

    def __enter__(self) -> "StereoLogWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                self._writer.finish()
            self._stream.close()
            if error is None:
                self._part.replace(self.path)
        except OSError as failure:
            raise OutputError(f"cannot write {self.path}: {failure.strerror}") from None
        finally:
            self._stream.close()
            self._part.unlink(missing_ok=True)
