"""The frames of a finished run as the `FrameEstimate`s that its sinks were given, as far as they are recorded."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..camera.rig import MonoRig, StereoRig
from ..errors import LogError
from ..geometry import se3
from ..mcap_file.damage import Damage
from ..mcap_file.log_file import LogFile
from ..rig_model.estimate import RigEstimate
from ..types import CommonErrors, FrameEstimate, RelativeMotions, Status
from .estimates_reader import Cloud, read_clouds, read_estimates
from .schema import EstimateRecord

_NO_IDS = np.empty(0, np.int64)


def frame_estimates(path: str | Path, points: bool = True) -> Iterator[FrameEstimate]:
    """Yield the frames of an `estimates.mcap`, with the local structure if `points`; what can be read of it.

    Points in the world, those that have left the view and times per stage are left out.
    """
    warnings: list[str] = []
    clouds = read_clouds(path, warnings=warnings) if points else iter(())
    cloud = next(clouds, None)
    for record in read_estimates(path, warnings):
        while cloud is not None and cloud.frame_index < record.frame_index:
            cloud = next(clouds, None)
        mine = cloud is not None and cloud.frame_index == record.frame_index
        yield _estimate(record, cloud if mine else None)


def recorded_rig(path: str | Path) -> StereoRig | MonoRig:
    """The rig of an `estimates.mcap`, from the calibration attached to it. Raises LogError where there is none."""
    for attachment in LogFile(path).attachments(Damage()):
        if attachment.name == "calibration.toml":
            kind = StereoRig if b"[right" in attachment.data else MonoRig
            return kind.parse_calibration(attachment.data, f"{path}, {attachment.name}")
    raise LogError(f"{path} holds no calibration: replay the log again")


def _rig(record: EstimateRecord) -> RigEstimate:
    """The recorded errors of the rig; the smooth field and the prior are not recorded."""
    times = [record.rig_focal_length, record.rig_delay_s, record.rig_readout_s]
    times = [pair or [0.0, 0.0] for pair in times]  # older files have none
    mean = np.array([*record.rig_error_px, *(value for value, _ in times)])
    n = len(record.rig_error_px)
    cov = np.diag([0.0] * n + [std**2 for _, std in times])
    cov[:n, :n] = record.rig_cov_px2[0]
    return RigEstimate(mean, cov, float(record.rig_applied), mean, cov, np.full(len(mean), np.nan))


def _estimate(record: EstimateRecord, cloud: Cloud | None) -> FrameEstimate:
    world_from_cam = np.array(record.world_from_cam)
    points = np.empty((0, 3)) if cloud is None else cloud.points.astype(float)
    relative = rig = common = None
    m = len(record.common_mean)
    if m:
        of_pose, cov = np.array(record.common_jacobian).reshape(6, m), np.array(record.common_cov).reshape(m, m)
        common = CommonErrors(np.array(record.common_mean), cov, of_pose)
    if record.relative_frame_indices:
        relative = RelativeMotions(
            np.array(record.relative_frame_indices, np.int64),
            np.array(record.relative_frame_from_newest or record.relative_frame_from_cam),
            np.array(record.relative_cov),
            np.array(record.relative_common_jacobian).reshape(-1, 6, m) if m else None,
        )
    if record.rig_error_px:
        rig = _rig(record)
    return FrameEstimate(
        frame_index=record.frame_index,
        stamp_ns=record.stamp_ns,
        status=Status(record.status),
        reason=record.reason,
        world_from_cam=world_from_cam,
        cov_pose=np.array(record.cov_pose),
        track_ids=_NO_IDS if cloud is None else cloud.track_ids,
        points_in_cam=points,
        cov_points=np.empty((0, 3, 3)) if cloud is None else cloud.cov_points.astype(float),
        points_in_world=se3.transform(world_from_cam, points),
        cov_points_in_world=np.full((len(points), 3, 3), np.nan),
        window_frame_indices=np.array(record.window_frame_indices, np.int64),
        window_world_from_cam=np.array(record.window_world_from_cam).reshape(-1, 4, 4),
        ended_ids=_NO_IDS,
        ended_points_in_world=np.empty((0, 3)),
        ended_cov_points_in_world=np.empty((0, 3, 3)),
        counts=dict(record.counts),
        nis=record.nis,
        nis_dof=record.nis_dof,
        timings_ms={},
        unscaled=record.unscaled,
        relative=relative,
        common=common,
        rig=rig,
    )
