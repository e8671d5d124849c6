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
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array
from ..record import changed, record
from .prepared import Image

_RADIUS_PX = 5  # of a patch
_BACK = 4  # frames from T to I: motion has changed, the view of the point hardly
_PATCHES = 64  # of a frame; each costs some 20 µs
# Of motion between two frames. With 0.7 the texture of a wall, resampled by parts of a pixel, is taken for a ghost.
_LEAST_PX = 1.5
_FEWEST = 5  # patches
_NOISE_GREY2 = 1.0  # variance of what is left of a patch at least: rounding, smoothed
_REMEMBERED = 40  # frames that are judged together
# Frames that a suspicion lasts without new evidence, which there is none of while the camera stands or moves steadily.
_LASTS = 100
# Sample logs, real and rendered, never have a share above zero by more than 4 σ.
_LEAST_SHARE, _LEAST_SIGNIFICANCE = 0.008, 6.0

_LEAST_VARIANCE = 1e-6  # of what patches say, over its square
_NOTHING = np.zeros(5)
_OFFSETS = np.mgrid[-_RADIUS_PX - 1 : _RADIUS_PX + 2, -_RADIUS_PX - 1 : _RADIUS_PX + 2][::-1].astype(np.float32)


@record
class _View:
    """The left image (h, w) of a frame, and where its tracks `ids` (n,), ascending, are in it: `left_px` (n, 2)."""

    image: Image
    ids: NDArray[np.int64]
    left_px: Array

    def of(self, ids: NDArray[np.int64]) -> Array:
        """Where the given tracks were (n, 2); NaN of those that were not."""
        rows = np.searchsorted(self.ids, ids).clip(max=len(self.ids) - 1)
        return np.where((self.ids[rows] == ids)[:, None], self.left_px[rows], np.nan)


@record
class GhostCheck:
    """What the frames so far have shown: the latest views, and `sums` (k, 5) of the latest frames: over all patches, of
    p = r_I·(r_P − r_O), s = r_P², p², p s and s². `lasts`: for how many frames a ghost is still suspected."""

    views: tuple[_View, ...] = ()
    sums: tuple[Array, ...] = ()
    lasts: int = 0

    @property
    def share(self) -> tuple[float, float]:
        """How much of each image is the one before it, and this in σ; zero where nothing is known."""
        p, s, pp, ps, ss = np.sum(self.sums, axis=0) if self.sums else _NOTHING
        if s <= 0:
            return 0.0, 0.0
        share = p / s
        variance = pp - 2 * share * ps + share**2 * ss  # of p by how patches differ
        return float(share), float(p / np.sqrt(max(variance, _LEAST_VARIANCE * pp)))

    @property
    def problem(self) -> str:
        """Say that earlier images show through; or nothing."""
        if not self.lasts:
            return ""
        return (
            "earlier images show through: is noise reduction over time on in the cameras, or were frames blended? "
            "Positions lag behind"
        )

    def after(self, image: Image, ids: NDArray[np.int64], left_px: Array) -> "GhostCheck":
        """Return the check after a frame, its smoothed left image (h, w) and where its tracks are in it."""
        views = (*self.views, _View(image, ids, left_px))[-_BACK - 1 :]
        check = GhostCheck(views, (*self.sums, _sums(views))[-_REMEMBERED:])
        share, significance = check.share
        shown = share > _LEAST_SHARE and significance > _LEAST_SIGNIFICANCE
        return changed(check, lasts=_LASTS if shown else max(0, self.lasts - 1))

    def interrupted(self) -> "GhostCheck":
        """Return the check after a frame that could not be followed."""
        return changed(self, views=())


def _sums(views: tuple[_View, ...]) -> Array:
    """What a frame, the last of these, says: see `GhostCheck`."""
    first, before, now = views[0], views[-2] if len(views) > 1 else views[-1], views[-1]
    if not (len(first.ids) and len(before.ids) and len(now.ids)) or first.image.shape != now.image.shape:
        return _NOTHING
    then_px, last_px = first.of(now.ids), before.of(now.ids)
    limit = np.array(now.image.shape[::-1]) - _RADIUS_PX - 3
    usable = np.linalg.norm(now.left_px - last_px, axis=1) > _LEAST_PX
    for px in (then_px, now.left_px, 2 * last_px - now.left_px):
        usable &= ((px > _RADIUS_PX + 2) & (px < limit)).all(axis=1)
    rows = usable.nonzero()[0]
    if len(rows) < _FEWEST:
        return _NOTHING
    rows = rows[:: -(-len(rows) // _PATCHES)]
    explained = _explained(_patches(first.image, then_px[rows]))
    seen, there, opposite = (
        _unexplained(_patches(image, px[rows])[:, 1:-1, 1:-1], explained)
        for image, px in (
            (now.image, now.left_px),
            (before.image, now.left_px),
            (before.image, 2 * last_px - now.left_px),
        )
    )
    weights = 1 / ((seen**2).mean(axis=1) + _NOISE_GREY2)
    p, s = weights * (seen * (there - opposite)).sum(axis=1), weights * (there**2).sum(axis=1)
    return np.array([p.sum(), s.sum(), (p * p).sum(), (p * s).sum(), (s * s).sum()])


def _patches(image: Image, at_px: Array) -> Array:
    """Patches (n, d, d) of an image around positions (n, 2), with a border of one pixel."""
    x, y = (_OFFSETS[:, None] + at_px.T[:, :, None, None]).astype(np.float32)
    d = x.shape[1]
    sampled = cv2.remap(image, x.reshape(-1, d), y.reshape(-1, d), cv2.INTER_LINEAR)
    return sampled.reshape(-1, d, d).astype(float)


def _explained(patches: Array) -> Array:
    """What may change of patches (n, d, d) between two frames, as orthonormal columns (n, k, 11), k = (d − 2)²."""
    x, y = (offset[1:-1, 1:-1].astype(float) for offset in _OFFSETS)
    t, left, right = patches[:, 1:-1, 1:-1], patches[:, 1:-1, :-2], patches[:, 1:-1, 2:]
    above, below = patches[:, :-2, 1:-1], patches[:, 2:, 1:-1]
    across = patches[:, 2:, 2:] + patches[:, :-2, :-2] - patches[:, 2:, :-2] - patches[:, :-2, 2:]
    dx, dy = right - left, below - above
    second = left + right - 2 * t, above + below - 2 * t, across
    columns = np.stack([np.ones_like(t), t, dx, dy, x * dx, y * dx, x * dy, y * dy, *second], axis=-1)
    return np.asarray(np.linalg.qr(columns.reshape(len(t), -1, columns.shape[-1]))[0])


def _unexplained(patches: Array, explained: Array) -> Array:
    """What orthonormal columns leave of patches: (n, k)."""
    y = patches.reshape(len(patches), -1, 1)
    return np.asarray((y - explained @ (np.swapaxes(explained, 1, 2) @ y))[..., 0])
