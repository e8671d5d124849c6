"""The errors of every frame, as they are drawn; the figures themselves come from `evaluation`."""

import numpy as np
from numpy.typing import NDArray

from ..evaluation.association import matched
from ..evaluation.trajectory import distances_m, from_first_camera, nees_pose
from ..geometry import se3
from ..geometry.se3 import Array
from ..record import record
from ..types import Trajectory


@record
class Trace:
    """One method against ground truth, in the k frames that have one, first poses aligned.

    `position_m` (k,): lengths of the position errors; `rotation_deg` (k,): angles of the rotation errors; `nees` (k,):
    NaN where the ground truth does not begin with the first frame.
    """

    frames: NDArray[np.int64]
    distance_m: Array
    estimate: Array
    truth: Array
    position_m: Array
    rotation_deg: Array
    nees: Array


def trace_of(estimate: Trajectory, truth: Trajectory) -> Trace | None:
    """The trace of a trajectory; None where fewer than two frames have a ground truth."""
    rows, true = matched(estimate, truth)
    if len(rows) < 2:
        return None
    e, t = from_first_camera(estimate.world_from_cam[rows]), from_first_camera(true.world_from_cam)
    xi = se3.log(se3.inverse(e) @ t)
    nees = np.full(len(rows), np.nan)
    if estimate.cov_pose is not None and rows[0] == 0:
        nees = nees_pose(e, estimate.cov_pose[rows], t)
    return Trace(
        rows,
        distances_m(t),
        e,
        t,
        np.linalg.norm(e[:, :3, 3] - t[:, :3, 3], axis=1),
        np.degrees(np.linalg.norm(xi[:, 3:], axis=1)),
        nees,
    )
