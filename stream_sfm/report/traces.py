"""The errors of every frame, as they are drawn; the figures themselves come from `evaluation`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..evaluation.alignment import from_first_camera
from ..evaluation.association import matched
from ..evaluation.consistency import nees_pose
from ..evaluation.drift import distances_m
from ..geometry import se3
from ..geometry.se3 import Array
from ..types import Trajectory
from .records import RunRecord


@dataclass(frozen=True, slots=True)
class Trace:
    """One method against ground truth, in the k frames that have one, first poses aligned.

    `xi` (k, 6): truth = estimate·Exp(ξ), metres and radians; `sigma` (k, 6) its estimated standard deviations and
    `nees` (k,) are None where the ground truth does not begin with the first frame.
    """

    frames: NDArray[np.int64]
    distance_m: Array
    estimate: Array
    truth: Array
    xi: Array
    sigma: Array | None
    nees: Array | None

    @property
    def position_m(self) -> Array:
        """Length (k,) of the position error, metres."""
        return np.linalg.norm(self.estimate[:, :3, 3] - self.truth[:, :3, 3], axis=1)

    @property
    def rotation_deg(self) -> Array:
        """Angle (k,) of the rotation error, degrees."""
        return np.degrees(np.linalg.norm(self.xi[:, 3:], axis=1))


def trace(run: RunRecord, truth: Trajectory) -> Trace | None:
    """The trace of a method; None where fewer than two frames have a ground truth."""
    return trace_of(run.trajectory(), truth)


def trace_of(estimate: Trajectory, truth: Trajectory) -> Trace | None:
    """The trace of a trajectory; None where fewer than two frames have a ground truth."""
    rows, true = matched(estimate, truth)
    if len(rows) < 2:
        return None
    e, t = from_first_camera(estimate.world_from_cam[rows]), from_first_camera(true.world_from_cam)
    sigma = nees = None
    if estimate.cov_pose is not None and rows[0] == 0:
        cov = estimate.cov_pose[rows]
        sigma = np.sqrt(np.maximum(np.diagonal(cov, axis1=1, axis2=2), 0))
        nees = nees_pose(e, cov, t)
    return Trace(rows, distances_m(t), e, t, se3.log(se3.inverse(e) @ t), sigma, nees)


def broken(frames: NDArray[np.int64], *columns: Array) -> list[Array]:
    """Frames and columns (k,) as floats, with a NaN row wherever frames are missing in between."""
    cuts = np.flatnonzero(np.diff(frames) > 1) + 1
    return [np.insert(np.asarray(c, float), cuts, np.nan) for c in (frames, *columns)]
