"""Ground truth at the stamps of an estimate."""

import numpy as np
from numpy.typing import NDArray

from ..geometry import se3
from ..geometry.se3 import Array
from ..types import Trajectory

MAX_GAP_NS = 150_000_000  # between two truths that are interpolated: 10 Hz with half a period of jitter
NEAREST_NS = 1_000_000  # in wider gaps: a camera moving at 30 m/s travels 3 cm in this time


def matched(estimate: Trajectory, truth: Trajectory) -> tuple[NDArray[np.int64], Trajectory]:
    """Find the rows of the estimate that have a ground truth, and the truth at exactly their stamps.

    A truth with the same stamp is used as it is. Otherwise its two neighbours are interpolated on SE(3) (constant
    twist) if they are at most 150 ms apart; failing that, a truth within 1 ms is used. All other rows have no truth.
    Truths need not be sorted; of equal stamps the first is used.
    """
    stamps, first = np.unique(truth.stamps_ns, return_index=True)
    poses = truth.world_from_cam[first]
    wanted = estimate.stamps_ns
    if len(stamps) == 0 or len(wanted) == 0:
        return np.empty(0, np.int64), Trajectory(np.empty(0, np.int64), np.empty((0, 4, 4)))
    after = np.clip(np.searchsorted(stamps, wanted), 0, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(abs(stamps[after] - wanted) <= abs(wanted - stamps[before]), after, before)
    offset = abs(stamps[nearest] - wanted)
    gap = stamps[after] - stamps[before]
    inside = (stamps[before] <= wanted) & (wanted <= stamps[after]) & (gap > 0) & (gap <= MAX_GAP_NS)
    between = inside & (offset > 0)
    found = between | (offset <= NEAREST_NS)

    result = poses[nearest].copy()
    if between.any():
        fraction = (wanted - stamps[before])[between] / gap[between]
        result[between] = _interpolated(poses[before[between]], poses[after[between]], fraction)
    rows = np.flatnonzero(found).astype(np.int64)
    return rows, Trajectory(wanted[rows], result[rows])


def _interpolated(world_from_a: Array, world_from_b: Array, fraction: Array) -> Array:
    return world_from_a @ se3.exp(fraction[:, None] * se3.log(se3.inverse(world_from_a) @ world_from_b))
