"""Whether earlier images show through, as where cameras or recorders average frames against noise.

A camera that gives a·(last image) + (1 − a)·(what it sees) delays all motion by a/(1 − a) frames as long as it is
steady; where it changes, patches are mixtures of two places, which alignment puts somewhere between. Both cameras do
the same, so left and right fit each other. What gives it away is a second picture in each patch: that which was at the
same pixels a frame before. A patch I is compared with the patch T of the same point some frames earlier, and with what
was at its place in the last image, P. Light, misplacement, warp and blur of T explain most of I: they are 1, T, its
first derivatives, these times x and y, and its second derivatives. What they leave of I, r_I, is regressed on what they
leave of P, r_P: over all patches, share = Σ r_I·(r_P − r_O) / Σ r_P², which is a where T has no ghost of its own, less
where it has a similar one, and zero in all other images, whose noise at two moments is independent. O is what lies on
the other side of the point in the last image: what a fast approach changes of a patch is as much like O as like P.

A second control is time itself: r_I·r_P less the same with the two images exchanged, r_J·r_N, where J is the patch in
the last image and N what is at its place now. A pattern of the sensor that stays at its pixels, dust, and how
sampling changes fine texture are the same in both directions; a ghost is of the past only. The control by which there
is less evidence counts.
"""

from dataclasses import field
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.image_rules import GhostRules
from ..geometry import Array
from ..record import changed, record
from .patches import View, at_least, share_of

SHOWS_THROUGH = (
    "earlier images show through: is noise reduction over time on in the cameras, or were frames blended? "
    "Positions lag behind"
)
_NOTHING = np.zeros((1, 2, 5))


@record
class GhostCheck:
    """What the frames so far have shown: the latest views, and `sums` (n, 2, 5) of each of the latest that were
    looked at: over all patches, of p = r_I·(r_P − r_O), s = r_P², p², p s and s², and of the same with p = r_I·r_P −
    r_J·r_N; `waited`: frames since the last one. `lasts`: for how many frames a ghost is still suspected."""

    views: tuple[View, ...] = ()
    sums: Array = field(default_factory=lambda: np.empty((0, 2, 5)))
    waited: int = 0
    lasts: int = 0
    rules: GhostRules = GhostRules()

    @property
    def share(self) -> tuple[float, float]:
        """How much of each image is the one before it, and this in σ, of the control by which it is least; zero where
        nothing is known."""
        return min(map(share_of, self.sums.sum(axis=0)), key=itemgetter(1))

    @property
    def problem(self) -> str:
        """Say that earlier images show through; or nothing."""
        return SHOWS_THROUGH if self.lasts else ""

    def after(self, view: View) -> "GhostCheck":
        """Return the check after a frame: its smoothed left image, and where its tracks are in it."""
        rules = self.rules
        views = (*self.views, view)[-rules.back_frames - 1 :]
        if len(self.sums) == rules.remembered and self.waited + 1 < rules.every:
            return changed(self, views=views, waited=self.waited + 1, lasts=max(0, self.lasts - 1))
        sums = np.concatenate([self.sums, _sums(views, rules)])[-rules.remembered :]
        check = changed(self, views=views, sums=sums, waited=0)
        shown = at_least(*check.share, rules.sigmas) > rules.share
        return changed(check, lasts=rules.lasting_frames if shown else max(0, self.lasts - 1))

    def interrupted(self) -> "GhostCheck":
        """Return the check after a frame that could not be followed."""
        return changed(self, views=())


def _sums(views: tuple[View, ...], rules: GhostRules) -> Array:
    """What a frame, the last of these, says: see `GhostCheck`."""
    before, now = views[-2] if len(views) > 1 else views[-1], views[-1]
    last_px = before.of(now.ids)
    usable = np.linalg.norm(now.left_px - last_px, axis=1) > rules.least_px
    usable &= now.inside(now.left_px) & now.inside(2 * last_px - now.left_px)
    first, usable = _oldest(views[:-1], now, usable)
    rows = usable.nonzero()[0]
    if len(rows) < rules.fewest:
        return _NOTHING
    rows = rows[:: -(-len(rows) // rules.patches)]
    at_px = now.left_px[rows], last_px[rows], first.of(now.ids)[rows]
    return core.ghost_sums(now.image, before.image, first.image, *at_px, rules.noise_grey, rules.least_square)[None]


def _oldest(views: tuple[View, ...], now: View, usable: NDArray[np.bool_]) -> tuple[View, NDArray[np.bool_]]:
    """The oldest of some views in which at least half as many of the usable tracks (n) are as in any later one, and
    which these are."""
    best, found, most = now, np.zeros_like(usable), np.count_nonzero(usable)
    for view in views:
        if 2 * np.count_nonzero(found) >= most:  # as is usual; no later one can have more than twice as many
            break
        there = usable & now.inside(view.of(now.ids)) & (view.image.shape == now.image.shape)
        if np.count_nonzero(there) > 2 * np.count_nonzero(found):
            best, found = view, there
    return best, found
