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

from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from ..config.rules import GhostRules
from ..geometry.se3 import Array
from ..record import changed, record
from .patches import RADIUS_PX, View, changes_of, patches_of, share_of

SHOWS_THROUGH = (
    "earlier images show through: is noise reduction over time on in the cameras, or were frames blended? "
    "Positions lag behind"
)
_NOTHING = np.zeros((2, 5))
_LEAST_SQUARE = 1e-3  # of a change of a patch, grey values squared
# Changes may depend on each other, as where a patch is one straight edge; they have single precision.
_RIDGE = 1e-6


@record
class GhostCheck:
    """What the frames so far have shown: the latest views, and `sums` (2, 5) of each of the latest frames: over all
    patches, of p = r_I·(r_P − r_O), s = r_P², p², p s and s², and of the same with p = r_I·r_P − r_J·r_N. `lasts`: for
    how many frames a ghost is still suspected."""

    views: tuple[View, ...] = ()
    sums: tuple[Array, ...] = ()
    lasts: int = 0
    rules: GhostRules = GhostRules()

    @property
    def share(self) -> tuple[float, float]:
        """How much of each image is the one before it, and this in σ, of the control by which it is least; zero where
        nothing is known."""
        return min(map(share_of, np.sum(self.sums, axis=0) if self.sums else _NOTHING), key=itemgetter(1))

    @property
    def problem(self) -> str:
        """Say that earlier images show through; or nothing."""
        return SHOWS_THROUGH if self.lasts else ""

    def after(self, view: View) -> "GhostCheck":
        """Return the check after a frame: its smoothed left image, and where its tracks are in it."""
        rules = self.rules
        views = (*self.views, view)[-rules.back_frames - 1 :]
        check = changed(self, views=views, sums=(*self.sums, _sums(views, rules))[-rules.remembered :])
        share, significance = check.share
        shown = share > rules.share and significance > rules.sigmas
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
    now_px, last_px, opposite_px = now.left_px[rows], last_px[rows], (2 * last_px - now.left_px)[rows]
    newer = patches_of(now.image, np.stack([now_px, last_px]), RADIUS_PX)
    older = patches_of(before.image, np.stack([now_px, opposite_px, last_px]), RADIUS_PX)
    explained = changes_of(patches_of(first.image, first.of(now.ids)[rows], RADIUS_PX + 1))
    left = _unexplained(np.concatenate([newer, older]).reshape(5, len(rows), -1), explained)
    seen, there_now, there, opposite, last = left
    weights = 1 / (_dot(seen, seen) / seen.shape[1] + rules.noise_grey**2)
    s, seen_there = weights * _dot(there, there), _dot(seen, there)
    both = weights * (seen_there - _dot(seen, opposite)), weights * (seen_there - _dot(last, there_now))
    return np.array([[p.sum(), s.sum(), p @ p, p @ s, s @ s] for p in both])


def _oldest(views: tuple[View, ...], now: View, usable: NDArray[np.bool_]) -> tuple[View, NDArray[np.bool_]]:
    """The oldest of some views in which at least half as many of the usable tracks (n) are as in any later one, and
    which these are."""
    best, found = now, np.zeros_like(usable)
    for view in views:
        there = usable & now.inside(view.of(now.ids)) & (view.image.shape == now.image.shape)
        if np.count_nonzero(there) > 2 * np.count_nonzero(found):
            best, found = view, there
    return best, found


def _dot(some: Array, others: Array) -> Array:
    """Products (n,) of rows (n, k)."""
    return np.einsum("nk,nk->n", some, others)


def _unexplained(views: NDArray[np.float32], explained: NDArray[np.float32]) -> Array:
    """What the changes explained (n, m, k) leave of views (v, n, k) of patches."""
    views = np.swapaxes(views - views.mean(axis=2, keepdims=True), 0, 1)
    gram = (explained @ np.swapaxes(explained, 1, 2)).astype(float)
    scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", gram), _LEAST_SQUARE))
    gram = gram * scale[:, None] * scale[:, :, None] + _RIDGE * np.eye(gram.shape[1])
    products = scale[:, :, None] * (explained @ np.swapaxes(views, 1, 2))
    parts = scale[:, :, None] * np.linalg.solve(gram, products)
    left = views - np.swapaxes(parts, 1, 2).astype(np.float32) @ explained
    return np.swapaxes(left, 0, 1).astype(float)
