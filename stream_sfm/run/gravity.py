"""A replay whose world is upright: what it needs, and its poses at the end."""

from ..camera.rig import StereoRig
from ..errors import ConfigError
from ..methods import METHODS
from ..recording.stereo_log import StereoLog
from ..report.records import RunRecord
from ..types import InertialEstimator, Trajectory
from .lane import Lane
from .loop import Course


def check_gravity(log: StereoLog, lane: Lane, with_map: bool) -> None:
    """Raise a ConfigError where no samples can tell which way is up."""
    config, why = lane.config, ""
    if with_map:
        why = "a map of places has a world of its own: leave out one of the two"
    elif config.mono or not isinstance(log.rig, StereoRig):
        why = "with one camera inertial samples are not used: use both cameras"
    elif not config.imu.enabled:
        why = "inertial samples are switched off: set imu.enabled to true"
    elif not (METHODS[config.method].inertial and isinstance(lane.estimator, InertialEstimator)):
        why = f"the method {config.method} takes no inertial samples: use cross-frame"
    elif log.imu_topics is None:
        why = log.imu_problem or f"{log.path} has no inertial samples: leave out the world of gravity"
    if why:
        raise ConfigError(f"the world cannot be made upright by gravity: {why}")


def upright_trajectory(record: RunRecord, course: Course) -> Trajectory | None:
    """Return the poses of a run in a world that is upright by its last samples, and warn where there were none."""
    if record.upright is None:
        course.warnings.append("no frame had usable inertial samples: it is not known which way is up")
        return None
    known = record.trajectory()
    assert known.cov_pose is not None  # of every record
    return Trajectory(known.stamps_ns, *record.upright.poses(known.world_from_cam, known.cov_pose))
