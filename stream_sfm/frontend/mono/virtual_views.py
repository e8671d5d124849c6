"""Virtual right sides: what the parallax has shown of a depth, said as the view of a right camera that does not exist.

Estimators meet a point in its second view, as a stereo view whose right side holds that depth with its variance; all
later views have no right side.
"""

import numpy as np

from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection

# The estimator also gets the views from which these depths were learnt; so that they do not count twice, the
# depths enter with so many times their σ. In simulation (tests/estimators/test_mono.py) the mean NEES of the pose
# is then 3.8 and 3.7 for two motions, 6 expected; with 0.4 times their σ it was 8.9 and 6.9.
DEPTH_STD_FACTOR = 2.0
# σ of an unknown inverse depth, in units of the scene's median. Chosen by hand: within one σ lies all from
# infinity to a quarter of the scene's distance, so the first parallax outweighs it.
UNKNOWN_DEPTH_STD = 3.0
_UNINFORMATIVE_PX2 = 1e8  # variance of a coordinate that says nothing: 10 000 px


def with_virtual_right(
    p: StereoProjection, z_px: Array, cov_px: Array, rho: Array, var_rho: Array
) -> tuple[Array, Array]:
    """Left sides of views z (n, 4), cov (n, 4, 4) with right sides of inverse depths (n,) and variances, eq. (66)."""
    cov = cov_px.copy()
    cov[:, 2:] = cov[:, :, 2:] = 0
    cov[:, 2, 2], cov[:, 3, 3] = (p.f_px * p.baseline_m) ** 2 * var_rho, _UNINFORMATIVE_PX2
    u_right = z_px[:, 0] - p.f_px * p.baseline_m * rho
    return np.stack([z_px[:, 0], z_px[:, 1], u_right, z_px[:, 1]], axis=1), cov
