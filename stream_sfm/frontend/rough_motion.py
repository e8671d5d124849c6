"""The rough motion since the previous image, from the optical flow that most tracks agree with.

The first search covers the usual range of motions between frames. If it explains too little, or no motion is known yet,
a deeper pyramid is used: from the predicted motion, from no motion, and from motions forward and backward that change
the size of patches.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array
from ..geometry.gates import chi2_gate
from ..geometry.medians import median
from ..geometry.resection import MANY_VIEWS, SecondMotion
from ..geometry.robust_rules import RobustRules
from ..pictures.rules import FlowRules
from ..record import record
from .alignment import Aligners
from .flow import as_exposed, track, track_wide
from .rules import MotionRules
from .step import Step
from .tracks import Tracks


@record
class RoughMotion:
    """A motion `cam_from_previous` (4, 4) from flow alone.

    `left_px` (n, 2): the positions of tracks by flow; `agree` (n,): which of them agree with the motion; `share`: the
    share of the found ones that agree. `alike`: another motion for which the scene looks the same.
    """

    cam_from_previous: Array
    left_px: Array
    agree: NDArray[np.bool_]
    share: float
    alike: SecondMotion | None = None


def find_rough_motion(step: Step, aligners: Aligners, tracks: Tracks) -> RoughMotion | None:
    """Return the motion that the flow of the tracks shows, or None."""
    best = None
    for motion in _found(step, aligners, tracks):
        if best is None or motion.agree.sum() > best.agree.sum():
            best = motion
        if best.share > step.setup.rules.of(FlowRules).enough:
            return best
    return None if best is None or best.agree.sum() < MANY_VIEWS else best


def _found(step: Step, aligners: Aligners, tracks: Tracks) -> Iterator[RoughMotion]:
    """Yield the motion of each attempt that finds one."""
    projection, config, previous = step.setup.projection, step.setup.config, step.previous
    flow, robust = config.rules.of(FlowRules), config.rules.of(RobustRules)
    exposed, gate = as_exposed(previous, step.images, flow), chi2_gate(2, robust.gate_probability)
    # if half of the view is covered, mean and contrast change although the exposure does not
    before_halves = [exposed] if exposed is previous.left_half else [exposed, previous.left_half]
    attempts = _attempts(config.frontend.pyramid_levels, tracks, step)
    for start, levels, zoom, before_half in ((*attempt, half) for attempt in attempts for half in before_halves):
        at_px = projection.project_homogeneous(tracks.points @ start.T)[:, :2].copy()
        found = np.zeros(len(tracks), bool)
        for scale, aligner in aligners.items():
            rows = (tracks.scale == scale).nonzero()[0]
            if not len(rows):
                continue
            before_px, near_px = tracks.left_px[rows], at_px[rows]
            if scale == 1:
                by_flow = track(aligner, flow, before_half, step.images, before_px, near_px, levels, zoom)
            else:
                by_flow = track_wide(aligner, flow, previous, step.images, before_px, near_px)
            at_px[rows], found[rows] = by_flow
        seen = tracks.weights(step.setup.rules.of(MotionRules)), at_px, found
        ok, motion, agree, share = core.motion_of_flow(projection, tracks, *seen, start, flow.std_px, gate, robust)
        if ok:
            yield RoughMotion(motion, at_px, agree, share)


def _attempts(near: int, tracks: Tracks, step: Step) -> Iterator[tuple[Array, int, float]]:
    """Yield the attempts in order: the start motion (4, 4) of flow, pyramid levels, and zoom of the previous image.

    `near`: levels for a well-predicted motion.
    """
    deep = near + step.setup.rules.of(FlowRules).more_levels
    if step.is_predicted:
        yield step.predicted, near, 1.0
    yield step.predicted, deep, 1.0
    if step.is_predicted:
        yield np.eye(4), deep, 1.0
    rho = median(tracks.points[:, 3])
    if rho > 0:
        larger = step.setup.rules.of(FlowRules).zoom
        for zoom in (larger, 1 / larger):
            forward = np.eye(4)
            forward[2, 3] = -(1 - 1 / zoom) / rho  # points at the median depth grow by this factor
            yield forward, deep, zoom
