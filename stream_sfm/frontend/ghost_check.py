"""Checks whether earlier images show through, as when cameras or recorders average frames against noise.

A camera that delivers a·(last image) + (1 − a)·(current view) delays all steady motion by a/(1 − a) frames. While the
motion changes, patches are mixtures of two places, and alignment puts them somewhere in between. Both cameras do the
same, so left and right are consistent. The evidence is a second picture in each patch: the one that was at the same
pixels in the last frame. A patch I is compared with the patch T of the same point some frames earlier, and with the
patch P of the last image at the pixels of I. Changes of light, position, warp and blur of T explain most of I: their
regressors are 1, T, its first derivatives, these times x and y, and its second derivatives. The residual of I, r_I, is
regressed on the residual of P, r_P: over all patches, share = Σ r_I·(r_P − r_O) / Σ r_P². It is a if T has no ghost of
its own, less if T has a similar one, and zero in sound images, whose noise is independent between frames. O is the
patch of the last image on the other side of the point: changes by a fast approach resemble O as much as P.

The second control is the direction of time: r_I·r_P less the same with the two images exchanged, r_J·r_N, where J is
the patch in the last image and N the patch of the current image at the pixels of J. Sensor patterns that stay at their
pixels, dust, and the effect of sampling on fine texture are the same in both directions; a ghost is only of the past.
The control with less evidence counts.
"""

from dataclasses import field
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.image_rules import GhostRules
from ..geometry import Array
from ..record import changed, record
from .prepared import Image

_SHOWS_THROUGH = (
    "earlier images show through: is noise reduction over time on in the cameras, or were frames blended? "
    "Positions lag behind"
)
_NOTHING = np.zeros((1, 2, 5))


@record
class View:
    """The left image (h, w) of a frame, and the positions `left_px` (n, 2) of its tracks `ids` (n,), which ascend."""

    image: Image
    ids: NDArray[np.int64]
    left_px: Array

    def of(self, ids: NDArray[np.int64]) -> Array:
        """Return the positions (n, 2) of the given tracks; NaN for those that are not in it."""
        if not len(self.ids):
            return np.full((len(ids), 2), np.nan)
        rows = np.minimum(self.ids.searchsorted(ids), len(self.ids) - 1)
        px = self.left_px.take(rows, axis=0)
        px[self.ids.take(rows) != ids] = np.nan
        return px

    def inside(self, px: Array) -> NDArray[np.bool_]:
        """Return at which positions (n, 2) a patch, with all pixels that its sampling needs, lies within the image."""
        (x, y), (height, width), margin = px.T, self.image.shape, core.PATCH_RADIUS_PX + 3
        return np.asarray((x > margin - 1) & (x < width - margin) & (y > margin - 1) & (y < height - margin))


@record
class GhostCheck:
    """The evidence so far.

    `views`: the latest views. `sums` (n, 2, 5): for each of the latest examined frames, sums over all patches of
    p = r_I·(r_P − r_O), s = r_P², p², p s and s², and the same with p = r_I·r_P − r_J·r_N. `waited`: frames since the
    last of these. `lasts`: for how many more frames a ghost is suspected.
    """

    views: tuple[View, ...] = ()
    sums: Array = field(default_factory=lambda: np.empty((0, 2, 5)))
    waited: int = 0
    lasts: int = 0
    rules: GhostRules = GhostRules()

    @property
    def share(self) -> tuple[float, float]:
        """The share of the previous image in each image, and its significance in σ, by the control with less evidence.

        Both are zero if nothing is known.
        """
        return min(map(_share_of, self.sums.sum(axis=0)), key=itemgetter(1))

    @property
    def problem(self) -> str:
        """The problem that earlier images show through, or an empty string."""
        return _SHOWS_THROUGH if self.lasts else ""

    def after(self, view: View) -> "GhostCheck":
        """Return the check after a frame, from its smoothed left image and the track positions in it."""
        rules = self.rules
        views = (*self.views, view)[-rules.back_frames - 1 :]
        if len(self.sums) == rules.remembered and self.waited + 1 < rules.every:
            return changed(self, views=views, waited=self.waited + 1, lasts=max(0, self.lasts - 1))
        sums = np.concatenate([self.sums, _sums(views, rules)])[-rules.remembered :]
        check = changed(self, views=views, sums=sums, waited=0)
        shown = _at_least(*check.share, rules.sigmas) > rules.share
        return changed(check, lasts=rules.lasting_frames if shown else max(0, self.lasts - 1))

    def interrupted(self) -> "GhostCheck":
        """Return the check after a frame that could not be followed."""
        return changed(self, views=())


def _sums(views: tuple[View, ...], rules: GhostRules) -> Array:
    """Return the sums (1, 2, 5) of `GhostCheck` for the last of these frames."""
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
    """Return the oldest view with at least half as many usable tracks (n) as any later one, and which these are."""
    best, found, most = now, np.zeros_like(usable), np.count_nonzero(usable)
    for view in views:
        if 2 * np.count_nonzero(found) >= most:  # the usual case: no later view can have more than twice as many
            break
        there = usable & now.inside(view.of(now.ids)) & (view.image.shape == now.image.shape)
        if np.count_nonzero(there) > 2 * np.count_nonzero(found):
            best, found = view, there
    return best, found


def _share_of(sums: Array) -> tuple[float, float]:
    """Return a share and its significance in σ from the sums (5,) of a control."""
    p, s, pp, ps, ss = sums
    if s <= 0:
        return 0.0, 0.0
    share = p / s
    variance = pp - 2 * share * ps + share**2 * ss  # of p, from the scatter of the patches
    return float(share), float(p / np.sqrt(max(variance, 1e-6 * pp)))


def _at_least(share: float, significance: float, sigmas: float) -> float:
    """Return the lower bound of a share, `sigmas` of its σ below it."""
    return share * (1 - sigmas / significance) if significance > 0 else share
