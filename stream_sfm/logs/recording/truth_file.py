"""Ground truth from a file: a trajectory of the left camera, or of a body that carries it, on the clock of a log."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import ConfigError, LogError
from ...geometry import Array
from ...system.inputs import INT64
from ...types import Trajectory
from ..mcap_file.message import Source
from ..sources.pose_files import is_euroc_table, read_poses
from .survey import Survey
from .transforms import fixed_transform


@dataclass(frozen=True, slots=True)
class GroundTruthFile:
    """Poses in a file: TUM, EuRoC's CSV, or KITTI with stamps.

    `frame`: the frame of the poses. None: the left camera, or for EuRoC's CSV the body, on which `cam0/sensor.yaml`
    of the recording gives the camera. Otherwise the name of a frame that fixed transforms in the log connect with
    the left camera, or the path of a sensor.yaml. `offset_s` is added to the stamps.
    """

    path: str | Path
    frame: str | Path | None = None
    offset_s: float = 0.0

    def __post_init__(self) -> None:
        if not abs(self.offset_s) < INT64 / 1e9:
            raise ConfigError(f"an offset of {self.offset_s:g} s leads beyond stamps of 64 bits: give seconds")

    @property
    def of_left_camera(self) -> bool:
        """Whether the poses are those of the left camera, so that no recording is needed to transform them."""
        return self.frame is None and not is_euroc_table(Path(self.path))

    def poses(self) -> Trajectory:
        """Return the poses in the file, with stamps on the clock of the log. Raises LogError."""
        found, offset_ns = read_poses(Path(self.path)), round(self.offset_s * 1e9)
        if not all(-INT64 <= end_ns + offset_ns < INT64 for end_ns in found.stamps_ns[[0, -1]].tolist()):
            raise LogError(f"{self.path}: an offset of {self.offset_s:g} s leads beyond stamps of 64 bits")
        return Trajectory(found.stamps_ns + offset_ns, found.world_from_cam)


def load_truth(truth: GroundTruthFile, source: Source, survey: Survey, camera_frame: str) -> Trajectory:
    """Return `world_from_cam` of the physical left camera. Raises LogError for the file, ConfigError for the frame."""
    poses = truth.poses()
    if truth.of_left_camera:
        return poses
    body_from_cam = _body_from_cam(truth, source, survey, camera_frame)
    return Trajectory(poses.stamps_ns, poses.world_from_cam @ body_from_cam)


def _body_from_cam(truth: GroundTruthFile, source: Source, survey: Survey, camera_frame: str) -> Array:
    path = Path(truth.path)
    if truth.frame is None:
        sensor = path.resolve().parent.parent / "cam0" / "sensor.yaml"
        if not sensor.is_file():
            problem = f"{path}: the poses are of EuRoC's body, and {sensor} is missing"
            cure = "name the frame, or a sensor.yaml of the left camera"
            raise ConfigError(f"{problem}: {cure}", hint=("ground_truth_frame",))
        return _of_sensor(sensor)
    if Path(truth.frame).is_file():
        return _of_sensor(Path(truth.frame))
    frame = str(truth.frame).lstrip("/")
    if frame == camera_frame:
        return np.eye(4)
    if (found := fixed_transform(source, survey, frame, camera_frame)) is None:
        frames = f"frame {camera_frame!r} of the left camera to frame {frame!r} of the ground truth {path}"
        cure = "name another frame, or a sensor.yaml of the left camera"
        problem = f"{source.path}: no fixed transform leads from {frames}: {cure}"
        raise ConfigError(problem, hint=("ground_truth_frame",))
    return found


def _of_sensor(path: Path) -> Array:
    from ...camera.calibration.read import read_document
    from ...camera.calibration.slam import EUROC, body_from_left

    document = read_document(path)
    if not EUROC.matches(document.data) or (pose := body_from_left(document)) is None:
        raise ConfigError(f"{path} is not a sensor.yaml with T_BS, the pose of the left camera in the body")
    return pose


def time_warning(truth: Trajectory, path: str | Path, first_ns: int, last_ns: int) -> str | None:
    """Return a warning if no pose lies within the time of the frames."""
    begin_ns, end_ns = int(truth.stamps_ns[0]), int(truth.stamps_ns[-1])
    if begin_ns <= last_ns and end_ns >= first_ns:
        return None
    spans = (f"{begin_ns / 1e9:.3f} to {end_ns / 1e9:.3f} s", f"{first_ns / 1e9:.3f} to {last_ns / 1e9:.3f} s")
    return (
        f"ground truth {path}: its stamps run from {spans[0]}, those of the frames from {spans[1]}, so no pose belongs "
        f"to a frame; an offset of {(first_ns - begin_ns) / 1e9:.3f} s would let both begin together"
    )
