"""How far blur that comes or goes lets points slide: condensation, focus, motion blur.

A template is found in a more blurred or a sharper image at a place of its own, the same in the left and right one. Rows
do not show this, and residuals from frame to frame hardly do. What shows it is that all patches lose or gain contrast,
by more than the motion explains.
"""

import numpy as np

from ...geometry import Array
from ...geometry.medians import median

_FEWEST = 12  # patches that do not agree by chance
_OF_MOTION = 2.0  # the detail in a patch grows with its area, and so with the square of 1/Z
_SIGMAS = 3.0  # of the median that noise explains


def lost_or_gained(before: Array, now: Array, changed: float) -> Array:
    """Return the changes b/c (n,) of the sharpness of patches, relative to their templates, eq. (17c).

    Contrasts `before` and `now` (n,) are over those of the templates; NaN before the second view. `changed`: by how
    much a motion has changed patches, |t|/Z. In nearly all frames noise and motion explain everything: zero.
    """
    log_ratio = np.log(now / before)
    log_ratio = log_ratio[np.isfinite(log_ratio)]
    if len(log_ratio) < _FEWEST:
        return np.zeros(len(now))
    common = median(log_ratio)
    std = 1.85 * median(np.abs(log_ratio - common)) / np.sqrt(len(log_ratio))  # of a median of Gaussians
    unexplained = common**2 - (_OF_MOTION * changed) ** 2 - (_SIGMAS * std) ** 2
    return np.asarray(np.sqrt(max(unexplained, 0.0)) / now)
