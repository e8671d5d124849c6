"""The rough motion since the previous image: optical flow that most tracks agree with, searched for ever more widely.

First as far as motions between frames usually go. Where that explains too little, or nothing is known of the motion
yet, through a deeper pyramid, from the predicted motion, from none, and from motions forward and backward that change
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
from ..record import record
from .alignment import Aligners
from .flow import as_exposed, track, track_wide
from .step import Step
from .tracks import Tracks


@record
class RoughMotion:
    """`cam_from_previous` (4, 4) from flow alone; the tracks' positions `left_px` (n, 2) by flow, which of them `agree`
    (n,) with it, and the `share` of the found ones that do. `alike`: a motion for which the scene looks the same."""

    cam_from_previous: Array
    left_px: Array
    agree: NDArray[np.bool_]
    share: float
    alike: SecondMotion | None = None


def find_rough_motion(step: Step, aligners: Aligners, tracks: Tracks) -> RoughMotion | None:
    """Return the motion that the flow of tracks shows, or None."""
    best = None
    for motion in _found(step, aligners, tracks):
        if best is None or motion.agree.sum() > best.agree.sum():
            best = motion
        if best.share > step.setup.rules.flow.enough:
            return best
    return None if best is None or best.agree.sum() < MANY_VIEWS else best


def _found(step: Step, aligners: Aligners, tracks: Tracks) -> Iterator[RoughMotion]:
    """Yield what each attempt finds."""
    projection, config, previous = step.setup.projection, step.setup.config, step.previous
    flow = config.rules.flow
    exposed, gate = as_exposed(previous, step.images, flow), chi2_gate(2, config.robust.gate_probability)
    # where half of the view is covered, mean and contrast change, and the exposure does not
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
        seen = tracks.weights(step.setup.rules.motion), at_px, found
        ok, motion, agree, share = core.motion_of_flow(
            projection, tracks, *seen, start, flow.std_px, gate, config.robust
        )
        if ok:
            yield RoughMotion(motion, at_px, agree, share)


def _attempts(near: int, tracks: Tracks, step: Step) -> Iterator[tuple[Array, int, float]]:
    """What to try, in order: the motion (4, 4) that flow starts from, pyramid levels, zoom of the previous image.

    `near`: levels for a motion that is predicted well.
    """
    deep = near + step.setup.rules.flow.more_levels
    if step.is_predicted:
        yield step.predicted, near, 1.0
    yield step.predicted, deep, 1.0
    if step.is_predicted:
        yield np.eye(4), deep, 1.0
    rho = median(tracks.points[:, 3])
    if rho > 0:
        larger = step.setup.rules.flow.zoom
        for zoom in (larger, 1 / larger):
            forward = np.eye(4)
            forward[2, 3] = -(1 - 1 / zoom) / rho  # points at the median depth grow by just this
            yield forward, deep, zoom
