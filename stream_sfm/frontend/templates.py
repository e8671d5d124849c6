"""Anchored templates: every point is aligned against the patch of its first frame, never against the last one.

A patch that is followed from frame to frame drifts towards zero motion under image noise, and no estimator repairs
that. The template's own noise moves the point once and for all, which harms nobody. A patch is warped by the map that
pose, depth and slope predict (`warps.py`), then found by Gauss-Newton over its position and over gain and offset of its
grey values together, inverse compositional (Baker and Matthews 2004): two cameras expose differently, and so does one
from frame to frame. What lies towards the rim counts less: there the warp is less right, and other surfaces begin.
"""

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ..geometry.medians import median
from ..geometry.se3 import Array
from .warps import facing

Grey = NDArray[np.float32]
_COLUMNS = 32  # patches beside each other in the atlas; any number does
_SPACING_PX = 2  # between samples: smoothing leaves neighbours the same noise, so half of them say as much
# σ of the weights over the patch, in units of its radius. Measured on four logs over four starts: a rendered one
# has pose NEES 16.4 -> 10.8 and aligned ATE 1.19 -> 0.74 mm, the others are unchanged; 0.6 to 1.0 do nearly as
# well.
_WIDTH = 0.8
_MAX_STEPS = 20  # two or three do, more for an image that is more blurred than the template
_MAX_STEP_RATIO = 0.7  # of each step over the one before, chosen by hand: at more the steps lead nowhere
_CONVERGED_PX = 0.05  # a step leaves a tenth of itself, which is below the noise floor of a view
_GAIN_RANGE = (0.1, 10.0)  # of grey values now over then, chosen by hand: no exposure changes more within a track
_MIN_EXPLAINED = 0.5  # fraction of the image's variance, chosen by hand: at less it shows something else
_PARAMETERS = 4  # that a patch's residual has been fitted with: position, gain, offset
_RIDGE, _MIN_INFORMATION = 1e-6, 1e-3  # relative to the trace, and grey²: patches without texture stay invertible
_BEYOND = 2  # the window, for its derivatives and interpolation, px
_STORED = 1.7  # half width of a stored patch over that of an aligned one: room for warps up to this scale
# Area of the template that one pixel of today covers: at less the patch has grown by more than √5 and shows
# detail that the template lacks.
_MIN_AREA = 0.2


@dataclass(frozen=True, slots=True)
class Samples:
    """Where a patch of 2 `radius_px` + 1 pixels is sampled: k × k pairs `u_px`, `v_px` (k²,) of offsets, `spacing_px`
    apart, with `weights` (k²,) of mean 1."""

    radius_px: int
    spacing_px: int
    u_px: Grey
    v_px: Grey
    weights: Grey

    @classmethod
    @cache
    def of(cls, radius_px: int, spacing_px: int) -> "Samples":
        """The samples of a radius and a spacing."""
        offsets = np.arange(-radius_px, radius_px + 1, spacing_px, dtype=np.float32)
        across = np.exp(-0.5 * (offsets / (_WIDTH * radius_px)) ** 2)
        weights = np.outer(across, across).ravel() / across.mean() ** 2
        k = len(offsets)
        return cls(radius_px, spacing_px, np.tile(offsets, k), np.repeat(offsets, k), weights)


@dataclass(frozen=True, slots=True)
class Patches:
    """Warped templates (n), ready to be aligned with an image.

    Of k × k `samples`: the weighted pseudo-inverse `inverse` (n, 3, k²) of their slopes along u and v and of their grey
    values, each of mean zero; the products `information` (n, 3, 3) of these; and the mean grey value `level` (n,).
    """

    inverse: Grey
    information: Array
    level: Grey
    samples: Samples

    @classmethod
    def of_grey(cls, grey: Grey, spacing_px: int) -> "Patches":
        """Make patches of 2r + 1 pixels from grey values (n, 2r + 3, 2r + 3), one pixel apart."""
        n, samples = len(grey), Samples.of((grey.shape[1] - 3) // 2, spacing_px)
        inner, before, after = slice(1, -1, spacing_px), slice(0, -2, spacing_px), slice(2, None, spacing_px)
        k = 2 * samples.radius_px // spacing_px + 1
        square = np.empty((n, 3, k, k), np.float32)
        np.subtract(grey[:, inner, after], grey[:, inner, before], out=square[:, 0])
        np.subtract(grey[:, after, inner], grey[:, before, inner], out=square[:, 1])
        square[:, :2] *= 0.5
        square[:, 2] = grey[:, inner, inner]
        columns = square.reshape(n, 3, k * k)
        mean = columns @ (samples.weights / len(samples.weights))
        columns -= mean[:, :, None]
        weighted = columns * samples.weights
        information = np.einsum("nkm,nlm->nkl", columns, weighted).astype(np.float64)
        information += (_RIDGE * np.trace(information, axis1=1, axis2=2) + _MIN_INFORMATION)[
            :, None, None
        ] * np.eye(3)
        inverse = np.linalg.inv(information).astype(np.float32) @ weighted
        return cls(inverse, information, np.asarray(mean[:, 2], np.float32), samples)

    @property
    def gradients(self) -> Array:
        """Gradient matrices H (n, 2, 2), grey², eq. (14): information about position, gain and offset eliminated."""
        i = self.information
        with_gain = i[:, :2, 2:]
        return np.asarray(
            self.samples.spacing_px**2 * (i[:, :2, :2] - with_gain @ np.swapaxes(with_gain, 1, 2) / i[:, 2:, 2:])
        )

    def replaced(self, rows: NDArray[np.bool_], other: "Patches") -> "Patches":
        """These patches, but those of `other` in the given rows (n,)."""
        if not rows.any():
            return self
        inverse, information, level = self.inverse.copy(), self.information.copy(), self.level.copy()
        inverse[rows], information[rows], level[rows] = other.inverse, other.information, other.level
        return replace(self, inverse=inverse, information=information, level=level)

    def align(self, image: Grey, starts_px: Array) -> tuple[Array, NDArray[np.bool_], Array]:
        """Find the patches in an image, from starts (n, 2).

        Returns positions (n, 2), whether each was found (n,), and the deviation (n,) of the grey differences that are
        left, in grey values of the template, inf where it was not found.

        A position is found with the patch's own gain and offset. What it is worth is judged with those that all
        patches have in common, eq. (15): light that changes on one patch alone is a reflection or a shadow.
        """
        n, k2 = len(starts_px), len(self.samples.weights)
        at = np.array(starts_px, dtype=np.float32)
        fits, levels, totals = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
        ok = np.zeros(n, bool)
        rows = np.flatnonzero(np.isfinite(at).all(axis=1))
        before: Array | float = self.samples.radius_px / _MAX_STEP_RATIO
        for _ in range(_MAX_STEPS):
            if not len(rows):
                break
            there, level = self._samples(image, at[rows])
            fit = np.einsum("nkm,nm->nk", self.inverse[rows], there)  # gain × step along u, v; gain
            fits[rows], levels[rows], totals[rows] = fit, level, (there * there) @ self.samples.weights
            step = fit[:, :2] / fit[:, 2:].clip(*_GAIN_RANGE)
            at[rows] -= step
            size = np.abs(step).max(axis=1)
            ok[rows] = size < _CONVERGED_PX
            going = (size >= _CONVERGED_PX) & (size < _MAX_STEP_RATIO * before)
            rows, before = rows[going], size[going]
        rest = np.maximum(totals - np.einsum("nk,nkl,nl->n", fits, self.information, fits), 0.0)
        gains = fits[:, 2]
        ok &= (gains > _GAIN_RANGE[0]) & (gains < _GAIN_RANGE[1]) & (rest < (1 - _MIN_EXPLAINED) * totals)
        error = np.full(n, np.inf)
        if ok.any():
            gain = median(gains[ok])
            offsets = levels[ok] - gain * self.level[ok]
            own_gain = (gains[ok] - gain) ** 2 * self.information[ok, 2, 2]
            own_offset = k2 * (offsets - median(offsets)) ** 2
            error[ok] = np.sqrt((rest[ok] + own_gain + own_offset) / (k2 - _PARAMETERS)) / gain
        return at.astype(np.float64), ok, error

    def _samples(self, image: Grey, at: Grey) -> tuple[Grey, Grey]:
        """Grey values (n, k²) around positions (n, 2), each row of mean zero, and the means (n,)."""
        s = self.samples
        u, v = at[:, :1] + s.u_px, at[:, 1:] + s.v_px
        grey = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        level = grey @ (s.weights / len(s.weights))
        return np.asarray(grey - level[:, None]), np.asarray(level)


@dataclass(frozen=True, slots=True)
class TemplateAtlas:
    """Patches of all tracks by slot, in one image `grey`, which interpolation needs.

    `radius_px` of the alignment window (2r+1 pixels wide); patches are stored half as large again, so that a warp
    finds its pixels.
    """

    radius_px: int
    grey: Grey

    @classmethod
    def empty(cls, slots: int, radius_px: int) -> "TemplateAtlas":
        """Return an atlas with so many slots."""
        side = 2 * _half(radius_px) + 1
        return cls(radius_px, np.zeros((-(-slots // _COLUMNS) * side, _COLUMNS * side), np.float32))

    def stored(self, image: Grey, points_px: NDArray[np.intp], slots: NDArray[np.intp]) -> "TemplateAtlas":
        """Return the atlas with patches cut around whole pixels (n, 2) in these slots (n,)."""
        half, grey = _half(self.radius_px), self.grey.copy()
        side = 2 * half + 1
        wide = cv2.copyMakeBorder(image, half, half, half, half, cv2.BORDER_REPLICATE)
        every = sliding_window_view(np.asarray(wide), (side, side))
        by_patch = grey.reshape(-1, side, _COLUMNS, side)
        by_patch[slots // _COLUMNS, :, slots % _COLUMNS] = every[points_px[:, 1], points_px[:, 0]]
        return TemplateAtlas(self.radius_px, grey)

    def fits(self, anchor_from_now: Array) -> NDArray[np.bool_]:
        """Whether warps (n, 3, 2) stay inside the stored patches and do not blow them up beyond recognition."""
        # of W u, and of h·u, over the window
        reach = np.abs(anchor_from_now).sum(axis=2) * (self.radius_px + _BEYOND)
        inside: NDArray[np.bool_] = reach[:, :2].max(axis=1) < _half(self.radius_px) * (1 - reach[:, 2])
        inside &= np.abs(np.linalg.det(anchor_from_now[:, :2])) > _MIN_AREA
        return inside

    def warped(self, slots: NDArray[np.intp], anchor_from_now: Array) -> Patches:
        """The templates of `slots` (n,) as today's image should show them; warps (n, 3, 2) of pixel offsets."""
        return Patches.of_grey(self._grey(slots, anchor_from_now, self.radius_px), _SPACING_PX)

    def inner(self, slots: NDArray[np.intp]) -> Patches:
        """The inner halves of templates as they were cut, of every pixel."""
        return Patches.of_grey(self._grey(slots, facing(len(slots)), self.radius_px // 2), 1)

    def _grey(self, slots: NDArray[np.intp], anchor_from_now: Array, radius: int) -> Grey:
        """Patches (n, 2r + 3, 2r + 3), one pixel of today's image between neighbours."""
        side = 2 * radius + 3
        if not len(slots):
            return np.zeros((0, side, side), np.float32)
        pixels = Samples.of(radius + 1, 1)
        grid = np.stack([pixels.u_px, pixels.v_px])
        w = anchor_from_now.astype(np.float32)
        half = _half(self.radius_px)
        centre = np.stack([slots % _COLUMNS, slots // _COLUMNS], axis=1) * (2 * half + 1) + half
        nearer = 1 + w[:, 2] @ grid
        x, y = ((w[:, i] @ grid) / nearer + centre[:, i, None].astype(np.float32) for i in (0, 1))
        return np.asarray(cv2.remap(self.grey, x, y, cv2.INTER_LINEAR), np.float32).reshape(-1, side, side)


def _half(radius_px: int) -> int:
    """Half width of a stored patch."""
    return int(_STORED * (radius_px + _BEYOND))
