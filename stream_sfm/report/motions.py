"""What a motion has not shown of a rig, and which motion would."""

from collections.abc import Sequence

import numpy as np

from ..camera.refinement import DIFFERENCE, DISPARITY, LENSES
from ..config import Config
from ..geometry import Array
from ..rig_model.estimate import RigEstimate
from ..rig_model.terms import AT_TIMING, FOCAL, TERMS, prior_std

_SHOWN = 0.5  # σ after the run over the one assumed beforehand: more means that the motion has shown little
_AT_FOCAL = TERMS.index(FOCAL)
# What is shown or not, and by which motion.
MOTIONS = (
    ("disparity", DISPARITY, "carry the camera sideways past near things"),
    ("lenses of both cameras", LENSES, "turn the camera so that points cross the whole image"),
    ("difference of the lenses", DIFFERENCE, "turn the camera so that points reach all corners"),
    (
        "focal length",
        slice(_AT_FOCAL, _AT_FOCAL + 1),
        "turn by 30° and more about x and about y, with near things in view",
    ),
    ("delay", slice(AT_TIMING.start, AT_TIMING.start + 1), "turn the camera quickly to both sides"),
    ("readout", slice(AT_TIMING.start + 1, AT_TIMING.stop), "turn the camera quickly up, down and to both sides"),
)


def coverage(estimate: RigEstimate, config: Config) -> Array:
    """Return for each of the `MOTIONS` how far σ has shrunk: 0 as before the run, 1 as if nothing were uncertain."""
    assumed = prior_std(config.rig)
    std = np.sqrt(np.diag(estimate.cov_if_wrong))[: len(assumed)]
    return np.array([1 - min(1.0, float(np.mean(std[where] / assumed[where]))) for _, where, _ in MOTIONS])


def shows_focal(estimate: RigEstimate) -> bool:
    """Whether a run has shown the focal length, right or wrong; its assumed σ is not learnt."""
    return bool(estimate.cov_if_wrong[_AT_FOCAL, _AT_FOCAL] < (_SHOWN * estimate.prior_std[_AT_FOCAL]) ** 2)


def not_shown(estimates: Sequence[RigEstimate], config: Config) -> list[str]:
    """Return a sentence about each cause of which no run has shown much, with the motion that would."""
    if not estimates:
        return []
    best = np.max([coverage(estimate, config) for estimate in estimates], axis=0)
    return [
        f"{name}: not shown by this motion; to learn it, {motion}"
        for (name, _, motion), shown in zip(MOTIONS, best, strict=True)
        if shown < 1 - _SHOWN
    ]
