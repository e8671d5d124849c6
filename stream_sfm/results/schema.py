"""The JSON messages of `estimates.mcap`: their fields, and the schema that describes them."""

from typing import Annotated, Any

import msgspec
from msgspec import Meta

from ..types import FrameEstimate

SCHEMA_VERSION = 1
Matrix = list[list[float | None]]


class EstimateRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One frame of /stream_sfm/estimate; numbers that are not finite are null.

    The points are in /stream_sfm/points and /stream_sfm/map.
    """

    schema_version: Annotated[int, Meta(description="raised when a field changes its meaning")] = SCHEMA_VERSION
    frame_index: Annotated[int, Meta(description="counts the frames given to the engine, from 0")]
    stamp_ns: Annotated[int, Meta(description="stamp of the left image, nanoseconds")]
    status: Annotated[str, Meta(description="initialising, ok, degraded or lost")]
    reason: Annotated[str, Meta(description="why the status is not ok; may be empty")]
    world_from_cam: Annotated[Matrix, Meta(description="pose of the left camera in the world, 4×4, metres")]
    cov_pose: Annotated[
        Matrix,
        Meta(
            description="6×6 covariance of ξ in truth = world_from_cam·Exp(ξ), ξ = (translation m, rotation rad) "
            "in axes of the camera"
        ),
    ]
    window_frame_indices: Annotated[list[int], Meta(description="frames in the estimator's window, oldest first")]
    window_world_from_cam: Annotated[list[Matrix], Meta(description="their poses as re-estimated now, each 4×4")]
    counts: Annotated[dict[str, int], Meta(description="points tracked, new, used, rejected")]
    unscaled: Annotated[
        bool, Meta(description="with one camera: lengths are in units of the first baseline, not in metres")
    ] = False
    nis: Annotated[float | None, Meta(description="whitened squared innovation of the accepted views")]
    nis_dof: Annotated[
        int, Meta(description="its degrees of freedom; nis/nis_dof is 1 where the noise is as assumed")
    ]


class TimingRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One frame of /stream_sfm/timing, the only topic that differs between two runs of one log."""

    schema_version: Annotated[int, Meta(description="as in /stream_sfm/estimate")] = SCHEMA_VERSION
    frame_index: int
    stamp_ns: int
    timings_ms: Annotated[dict[str, float], Meta(description="stage and the milliseconds it took")]


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
        counts={name: int(value) for name, value in estimate.counts.items()},
        unscaled=estimate.unscaled,
        nis=float(estimate.nis),
        nis_dof=int(estimate.nis_dof),
    )


def json_schema(kind: type[msgspec.Struct]) -> bytes:
    """The JSON schema of a record, with an object at its root as viewers expect."""
    schema: dict[str, Any] = msgspec.json.schema(kind)
    root = schema["$defs"][kind.__name__]
    return msgspec.json.encode({"$schema": "https://json-schema.org/draft/2020-12/schema", **root})
