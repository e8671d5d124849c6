"""What is recorded of each frame in `estimates.mcap`: the fields of our own messages, from which they are defined."""

from typing import Annotated, Any

import msgspec
from msgspec import Meta

from ..camera.refinement import TERMS
from ..rig_model.estimate import RigEstimate
from ..rig_model.terms import DELAY, FOCAL, READOUT
from ..types import CommonErrors, FrameEstimate, RelativeMotions

SCHEMA_VERSION = 2
Matrix = list[list[float]]
Pose = Annotated[Matrix, Meta(extra={"shape": (4, 4)})]
PoseCovariance = Annotated[Matrix, Meta(extra={"shape": (6, 6)})]
RigCovariance = Annotated[Matrix, Meta(extra={"shape": (len(TERMS), len(TERMS))})]


class EstimateRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One frame of /stream_sfm/estimate: everything except the points (/stream_sfm/points and /stream_sfm/map)."""

    schema_version: Annotated[int, Meta(description="raised when a field changes its meaning")] = SCHEMA_VERSION
    frame_index: Annotated[int, Meta(description="counts the frames given to the engine, from 0")]
    stamp_ns: Annotated[int, Meta(description="stamp of the left image, nanoseconds")]
    status: Annotated[str, Meta(description="initialising, ok, degraded or lost")]
    reason: Annotated[str, Meta(description="why the status is not ok; may be empty")]
    world_from_cam: Annotated[
        Pose, Meta(description="pose of the left camera in the world, 4×4 row by row, metres; z is forward")
    ]
    cov_pose: Annotated[
        PoseCovariance,
        Meta(
            description="6×6 covariance of ξ in truth = world_from_cam·Exp(ξ), ξ = (translation m, rotation rad) "
            "in axes of the camera"
        ),
    ]
    window_frame_indices: Annotated[list[int], Meta(description="frames in the estimator's window, oldest first")]
    window_world_from_cam: Annotated[
        list[Pose], Meta(description="their poses as re-estimated now, each 4×4 row by row")
    ]
    counts: Annotated[dict[str, int], Meta(description="points tracked, new, used, rejected")]
    relative_frame_indices: Annotated[
        list[int],
        Meta(description="earlier frames, to which the motion from this one is known with its covariance"),
    ] = []
    relative_frame_from_newest: Annotated[
        list[Pose], Meta(description="carry points of this camera into theirs, each 4×4, metres")
    ] = []
    relative_frame_from_cam: Annotated[
        list[Pose], Meta(description="the same under its former name, for programs that read it")
    ] = []
    relative_cov: Annotated[
        list[PoseCovariance],
        Meta(description="6×6 covariances of ξ in truth = frame_from_newest·Exp(ξ), as cov_pose"),
    ] = []
    relative_common_jacobian: Annotated[
        list[float],
        Meta(description="how common errors move these motions, each 6×m row by row, one after the other"),
    ] = []
    common_mean: Annotated[
        list[float],
        Meta(
            description="errors c that all poses and motions share: of lengths, of the axes, of the rig; or empty"
        ),
    ] = []
    common_cov: Annotated[list[float], Meta(description="their covariance, m×m row by row")] = []
    common_jacobian: Annotated[
        list[float], Meta(description="how they move the pose, 6×m row by row; c is in σ of what was assumed")
    ] = []
    rig_error_px: Annotated[
        list[float],
        Meta(description="errors of the calibration as known now, px; empty where it is taken for exact"),
    ] = []
    rig_cov_px2: Annotated[list[RigCovariance], Meta(description="their covariance, one matrix, or empty")] = []
    rig_delay_s: Annotated[
        list[float], Meta(description="delay of the right camera and its σ, seconds, or empty")
    ] = []
    rig_readout_s: Annotated[
        list[float],
        Meta(description="readout time of the shutters, from the top down, and its σ, seconds, or empty"),
    ] = []
    rig_focal_length: Annotated[
        list[float], Meta(description="error of the common focal length as a share of it, and its σ, or empty")
    ] = []
    rig_applied: Annotated[bool, Meta(description="whether the calibration is more probably wrong than right")] = (
        False
    )
    unscaled: Annotated[
        bool, Meta(description="with one camera: lengths are in units of the first baseline, not in metres")
    ] = False
    nis: Annotated[float, Meta(description="whitened squared innovation of the accepted views")]
    nis_dof: Annotated[
        int, Meta(description="its degrees of freedom; nis/nis_dof is 1 where the noise is as assumed")
    ]


class TimingRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One frame of /stream_sfm/timing, the only topic that differs between two runs of one log."""

    frame_index: Annotated[int, Meta(description="as in /stream_sfm/estimate")]
    timings_ms: Annotated[dict[str, float], Meta(description="stages, and the milliseconds that each took")]


class ScalarsRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One frame of /stream_sfm/scalars: numbers to plot, one field each."""

    x: Annotated[float, Meta(description="position in the world, as in /stream_sfm/pose")]
    y: Annotated[float, Meta(description="position")]
    z: Annotated[float, Meta(description="position")]
    sigma_x: Annotated[float, Meta(description="its standard deviation along the same axis")]
    sigma_y: Annotated[float, Meta(description="its standard deviation along the same axis")]
    sigma_z: Annotated[float, Meta(description="its standard deviation along the same axis")]
    sigma_position: Annotated[float, Meta(description="square root of the trace of the position's covariance")]
    sigma_rotation_deg: Annotated[float, Meta(description="the same of the rotation, degrees")]
    speed: Annotated[float, Meta(description="since the previous frame, per second")]
    angular_speed_deg_s: Annotated[float, Meta(description="since the previous frame, degrees per second")]
    path_length: Annotated[float, Meta(description="along the motions between frames so far")]
    points_tracked: Annotated[int, Meta(description="points that are followed")]
    points_new: Annotated[int, Meta(description="points seen for the first time")]
    points_used: Annotated[int, Meta(description="points whose views were accepted")]
    points_rejected: Annotated[int, Meta(description="points whose views were rejected")]
    nis_per_dof: Annotated[float, Meta(description="1 on average where the noise is as assumed; NaN without views")]
    status: Annotated[int, Meta(description="0 initialising, 1 ok, 2 degraded, 3 lost")]


def estimate_record(estimate: FrameEstimate) -> EstimateRecord:
    """Make the record of an estimate."""
    return EstimateRecord(
        frame_index=estimate.frame_index,
        stamp_ns=estimate.stamp_ns,
        status=str(estimate.status),
        reason=estimate.reason,
        world_from_cam=estimate.world_from_cam.tolist(),
        cov_pose=estimate.cov_pose.tolist(),
        window_frame_indices=estimate.window_frame_indices.tolist(),
        window_world_from_cam=estimate.window_world_from_cam.tolist(),
        **_relative(estimate.relative),
        **_common(estimate.common),
        **_rig(estimate.rig),
        counts={name: int(value) for name, value in estimate.counts.items()},
        unscaled=estimate.unscaled,
        nis=float(estimate.nis),
        nis_dof=int(estimate.nis_dof),
    )


def _relative(relative: RelativeMotions | None) -> dict[str, Any]:
    if relative is None:
        return {}
    by_common = relative.common_jacobian
    return {
        "relative_frame_indices": relative.frame_indices.tolist(),
        "relative_frame_from_newest": relative.frame_from_newest.tolist(),
        "relative_frame_from_cam": relative.frame_from_newest.tolist(),
        "relative_cov": relative.cov.tolist(),
        "relative_common_jacobian": [] if by_common is None else by_common.ravel().tolist(),
    }


def _common(common: CommonErrors | None) -> dict[str, Any]:
    if common is None:
        return {}
    return {
        "common_mean": common.mean.tolist(),
        "common_cov": common.cov.ravel().tolist(),
        "common_jacobian": common.jacobian.ravel().tolist(),
    }


def _rig(rig: RigEstimate | None) -> dict[str, Any]:
    if rig is None:
        return {}
    n = len(TERMS)
    return {
        "rig_error_px": rig.mean[:n].tolist(),
        "rig_cov_px2": [rig.cov[:n, :n].tolist()],
        "rig_applied": rig.applied,
        "rig_delay_s": list(rig.term(DELAY)),
        "rig_readout_s": list(rig.term(READOUT)),
        "rig_focal_length": list(rig.term(FOCAL)),
    }
