"""The motion since the previous frame from which every estimator starts a frame, and its outlier test."""

import numpy as np
from numpy.typing import NDArray

from ..config import RobustConfig
from ..geometry.resection import Resection, resect
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..types import Observations

# Accepted share of the views, by weight, that ends the search: with less, another start may lead to a better one. The
# front-end's own motion may be that of a body which covers half of the view.
_ENOUGH = 0.95


def initial_motion(
    projection: StereoProjection,
    config: RobustConfig,
    observations: Observations,
    rows: NDArray[np.intp],
    points_in_previous: Array,
    cov_points: Array,
    cam_from_previous_predicted: Array,
    weights: Array | None = None,
) -> Resection | None:
    """Find cam_from_previous by robust resection of the views `rows` (n,), or None where too few of them agree.

    `points_in_previous` (n, 3) m or (n, 4) homogeneous with covariances: the local structure of the previous camera.
    Starts are the front-end's own motion, the prediction of the motion model, and no motion. The first one that
    nearly all views accept is taken, else the one that most of them accept. `weights` (n,): as in `resect`.
    """
    starts = [cam_from_previous_predicted, np.eye(4)]
    if observations.cam_from_previous is not None:
        starts.insert(0, observations.cam_from_previous)
    z_px, cov_px = observations.z_px[rows], observations.cov_px[rows]
    best: Resection | None = None
    for start in starts:
        found = resect(
            projection, points_in_previous, cov_points, z_px, cov_px, start, config.gate_probability, weights
        )
        enough = found.accepted.sum() >= config.min_inliers
        if found.ok and enough and (best is None or found.share > best.share):
            best = found
        if best is not None and best.share >= _ENOUGH:
            break
    return best
