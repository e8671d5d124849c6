"""The package's own ROS 2 messages: their definitions, and what of a `FrameEstimate` is in which field, both ways.

Matrices are written row by row. A dict of numbers by name is two arrays, `<field>_names` and `<field>`.
"""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera.refinement import TERMS
from ..geometry import se3
from ..rig_model.estimate import RigEstimate
from ..rig_model.terms import DELAY, FOCAL, READOUT
from ..types import CommonErrors, FrameEstimate, InertialEstimate, RelativeMotions, Status

SCHEMA_VERSION = 2
ESTIMATE, SCALARS, TIMING = (f"stream_sfm_msgs/msg/{name}" for name in ("Estimate", "Scalars", "Timing"))
# A field and its explanation per line.
_FIELDS = {
    ESTIMATE: """\
std_msgs/Header header  # One frame of /stream_sfm/estimate: everything except the points (/stream_sfm/points and \
/stream_sfm/map).
int64 schema_version  # raised when a field changes its meaning
int64 frame_index  # counts the frames given to the engine, from 0
int64 stamp_ns  # stamp of the left image, nanoseconds
string status  # initialising, ok, degraded or lost
string reason  # why the status is not ok; may be empty
float64[16] world_from_cam  # pose of the left camera in the world, 4×4 row by row, metres; z is forward
float64[36] cov_pose  # 6×6 covariance of ξ in truth = world_from_cam·Exp(ξ), ξ = (translation m, rotation rad) in \
axes of the camera
int64[] window_frame_indices  # frames in the estimator's window, oldest first
float64[] window_world_from_cam  # their poses as re-estimated now, each 4×4 row by row
string[] counts_names  # points tracked, new, used, rejected
int64[] counts
int64[] relative_frame_indices  # earlier frames, to which the motion from this one is known with its covariance
float64[] relative_frame_from_newest  # carry points of this camera into theirs, each 4×4, metres
float64[] relative_frame_from_cam  # the same under its former name, for programs that read it
float64[] relative_cov  # 6×6 covariances of ξ in truth = frame_from_newest·Exp(ξ), as cov_pose
float64[] relative_common_jacobian  # how common errors move these motions, each 6×m row by row, one after the other
float64[] common_mean  # errors c that all poses and motions share: of lengths, of the axes, of the rig; or empty
float64[] common_cov  # their covariance, m×m row by row
float64[] common_jacobian  # how they move the pose, 6×m row by row; c is in σ of what was assumed
float64[] rig_error_px  # errors of the calibration as known now, px; empty where it is taken for exact
float64[] rig_cov_px2  # their covariance, one matrix, or empty
float64[] rig_delay_s  # delay of the right camera and its σ, seconds, or empty
float64[] rig_readout_s  # readout time of the shutters, from the top down, and its σ, seconds, or empty
float64[] rig_focal_length  # error of the common focal length as a share of it, and its σ, or empty
bool rig_applied  # whether the calibration is more probably wrong than right
float64[] inertial_state  # by inertial samples: velocity, gravity, both in the camera, biases of gyroscope and \
accelerometer, scale, turn of the unit, time offset: 17 numbers; or empty
float64[] inertial_cov  # joint covariance 23×23 of ξ and that state
float64[] inertial_densities  # factors on the noise densities of gyroscope and accelerometer, as learnt
float64 inertial_distance2  # squared distance of the images' motion from that of the samples, 6 expected
bool dead_reckoned  # the pose is by inertial samples alone
bool unscaled  # with one camera: lengths are in units of the first baseline, not in metres
float64 nis  # whitened squared innovation of the accepted views
int64 nis_dof  # its degrees of freedom; nis/nis_dof is 1 where the noise is as assumed
""",
    SCALARS: """\
std_msgs/Header header  # One frame of /stream_sfm/scalars: numbers to plot, one field each.
float64 x  # position in the world, as in /stream_sfm/pose
float64 y  # position
float64 z  # position
float64 sigma_x  # its standard deviation along the same axis
float64 sigma_y  # its standard deviation along the same axis
float64 sigma_z  # its standard deviation along the same axis
float64 sigma_position  # square root of the trace of the position's covariance
float64 sigma_rotation_deg  # the same of the rotation, degrees
float64 speed  # since the previous frame, per second
float64 angular_speed_deg_s  # since the previous frame, degrees per second
float64 path_length  # along the motions between frames so far
int64 points_tracked  # points that are followed
int64 points_new  # points seen for the first time
int64 points_used  # points whose views were accepted
int64 points_rejected  # points whose views were rejected
float64 nis_per_dof  # 1 on average where the noise is as assumed; NaN without views
int64 status  # 0 initialising, 1 ok, 2 degraded, 3 lost
""",
    TIMING: """\
std_msgs/Header header  # One frame of /stream_sfm/timing, the only topic that differs between two runs of one log.
int64 frame_index  # as in /stream_sfm/estimate
string[] timings_ms_names  # stages, and the milliseconds that each took
float64[] timings_ms
""",
}
# As ROS reads them: an explanation above its field.
DEFINITIONS = {
    name: re.sub(r"^(.+)  # (.+)$", r"# \2\n\1", text, flags=re.MULTILINE) for name, text in _FIELDS.items()
}
_AS_IN_ESTIMATES = (
    *("frame_index", "stamp_ns", "reason", "world_from_cam", "cov_pose", "window_frame_indices"),
    *("window_world_from_cam", "unscaled", "nis", "nis_dof"),
)
_OF_RELATIVE = ("frame_indices", "frame_from_newest", "cov", "common_jacobian")
_OF_COMMON = ("mean", "cov", "jacobian")
_RIG_TIMES = {FOCAL: "rig_focal_length", DELAY: "rig_delay_s", READOUT: "rig_readout_s"}


def named(field: str, numbers: Mapping[str, float]) -> dict[str, Any]:
    """Return the two fields of numbers by name."""
    return {f"{field}_names": list(numbers), field: list(numbers.values())}


def estimate_fields(estimate: FrameEstimate) -> dict[str, Any]:
    """Return the fields of an ESTIMATE, without its header; `estimate_of` is the inverse."""
    relative, common, rig, n = estimate.relative, estimate.common, estimate.rig, len(TERMS)
    fields = {name: getattr(estimate, name) for name in _AS_IN_ESTIMATES}
    fields |= {"schema_version": SCHEMA_VERSION, "status": str(estimate.status), **named("counts", estimate.counts)}
    for part, prefix, names in ((relative, "relative", _OF_RELATIVE), (common, "common", _OF_COMMON)):
        values = {f"{prefix}_{name}": getattr(part, name, None) for name in names}
        fields |= {name: () if value is None else value for name, value in values.items()}
    fields["relative_frame_from_cam"] = fields["relative_frame_from_newest"]
    fields["rig_applied"] = rig is not None and rig.applied
    fields |= {name: () if rig is None else rig.term(term) for term, name in _RIG_TIMES.items()}
    fields |= _inertial_fields(estimate.inertial)
    of_rig = ((), ()) if rig is None else (rig.mean[:n], rig.cov[:n, :n])
    return fields | dict(zip(("rig_error_px", "rig_cov_px2"), of_rig, strict=True))


def _inertial_fields(of: InertialEstimate | None) -> dict[str, Any]:
    if of is None:
        names = ("inertial_state", "inertial_cov", "inertial_densities")
        return dict.fromkeys(names, ()) | {"inertial_distance2": 0.0, "dead_reckoned": False}
    parts = of.velocity, of.gravity, of.gyro_bias, of.accel_bias, [of.scale], of.axes_rad, [of.time_offset_s]
    return {
        "inertial_state": np.concatenate(parts),
        "inertial_cov": of.cov,
        "inertial_densities": of.densities,
        "inertial_distance2": of.distance2,
        "dead_reckoned": of.dead_reckoned,
    }


def _inertial(m: Any) -> InertialEstimate | None:
    """The recorded inertial state; None where there is none, as in files of earlier versions."""
    s: Any = getattr(m, "inertial_state", ())
    if not len(s):
        return None
    of = np.asarray(s)
    rest = m.inertial_cov.reshape(23, 23), m.inertial_densities, m.inertial_distance2, m.dead_reckoned
    return InertialEstimate(of[:3], of[3:6], of[6:9], of[9:12], float(of[12]), of[13:16], float(of[16]), *rest)


def estimate_of(m: Any, points: tuple[NDArray[Any], ...] | None = None) -> FrameEstimate:
    """Return the content of an ESTIMATE, with the ids, points and covariances of another message if given.

    Points in the world, those that have left the view, and times per stage are left out.
    """
    world_from_cam, rows = m.world_from_cam.reshape(4, 4), len(m.common_mean)
    track_ids, points_in_cam, cov_points = points or (np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3, 3)))
    in_cam = points_in_cam.astype(float)
    common = relative = None
    if rows:
        common = CommonErrors(m.common_mean, m.common_cov.reshape(rows, rows), m.common_jacobian.reshape(6, rows))
    if len(m.relative_frame_indices):
        relative = RelativeMotions(
            m.relative_frame_indices,
            m.relative_frame_from_newest.reshape(-1, 4, 4),
            m.relative_cov.reshape(-1, 6, 6),
            m.relative_common_jacobian.reshape(-1, 6, rows) if rows else None,
        )
    return FrameEstimate(
        frame_index=m.frame_index,
        stamp_ns=m.stamp_ns,
        status=Status(m.status),
        reason=m.reason,
        world_from_cam=world_from_cam,
        cov_pose=m.cov_pose.reshape(6, 6),
        track_ids=track_ids,
        points_in_cam=in_cam,
        cov_points=cov_points.astype(float),
        points_in_world=se3.transform(world_from_cam, in_cam),
        cov_points_in_world=np.full((len(in_cam), 3, 3), np.nan),
        window_frame_indices=m.window_frame_indices,
        window_world_from_cam=m.window_world_from_cam.reshape(-1, 4, 4),
        counts=dict(zip(m.counts_names, m.counts.tolist(), strict=True)),
        nis=m.nis,
        nis_dof=m.nis_dof,
        timings_ms={},
        unscaled=m.unscaled,
        relative=relative,
        common=common,
        rig=_rig(m) if len(m.rig_error_px) else None,
        inertial=_inertial(m),
    )


def _rig(m: Any) -> RigEstimate:
    """The recorded errors of the rig; the smooth field and the prior are not recorded."""
    times = [getattr(m, name) for name in _RIG_TIMES.values()]
    n = len(m.rig_error_px)
    mean = np.array([*m.rig_error_px, *(value for value, _ in times)])
    cov = np.diag([0.0] * n + [std**2 for _, std in times])
    cov[:n, :n] = m.rig_cov_px2.reshape(n, n)
    return RigEstimate(mean, cov, float(m.rig_applied), mean, cov, np.full(len(mean), np.nan))
