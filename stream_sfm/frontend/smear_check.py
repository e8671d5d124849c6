"""Checks whether patches are smeared along their motion by more than a shutter can, as when cameras average frames.

An image that is a·(last image) + (1 − a)·(current view) shows a point with a speed of d per frame where it was
a/(1 − a) frames ago on average, with a variance of a/(1 − a)² frames². So it is smeared along its motion by a variance
of a/(1 − a)²·d², and if the motion is slow, this is the only evidence. A shutter that is open for a whole frame smears
by d²/12, which is the most that a shutter can, and as much as a = 0.07. Poses are wrong when the speed changes, and
then the smear changes as well.

The current patch is compared with that of the same point in the slowest of the latest frames. C is the change of the
covariance of its blur kernel. The second derivatives of the patch show it: I = T + ½ tr(C·∇∇T), beside changes of
light, position and shape. Noise that the other patch explains looks like blur as well, so the same is done with the two
exchanged, and half the difference is used. Defocus blurs in all directions, so C along the motion minus C across it is
used. Sampling between pixels blurs by f·(1 − f), with f the fraction of the position, and is subtracted. The result, y,
is regressed on x = d² over all patches: Σ x·(y − x/12) over Σ x² is a/(1 − a)² − 1/12. It is less if the slowest frame
is hardly slower, and not above zero in sound images.

In the first moving frame after a standstill, half of the picture in both cameras may not have moved. If the motion is
more than a few pixels, alignment finds the half at rest, and no second derivative explains the other one. Noise is the
same in all patches, but half of another picture leaves larger residuals where there is more texture: relative to the
previous frame, the residuals of patches grow with their contrast.
"""

import numpy as np

from .. import core
from ..config.image_rules import SmearRules
from ..geometry import Array
from ..geometry.medians import median
from ..record import changed, record
from .ghost_check import SHOWS_THROUGH
from .patches import RADIUS_PX, View, at_least, patches_of, share_of

_STD_OF_MEDIAN = 1.86  # σ of a median over the median absolute deviation, times the root of the number
_SECOND = np.array([2.0, 2.0, 4.0])  # from the coefficients of the second derivatives to C: xx, yy, xy


@record
class SmearCheck:
    """The evidence so far.

    `last`: the last view; `slow`: the slow view of `age` frames ago, whose tracks moved by `slow_px`. `sums` (5,): for
    each of the latest examined frames, sums over all patches of p = w x (y − x/12), s = w x², p², p s and s²; `waited`:
    frames since the last of these. `lasts`: for how many more frames a smear is suspected.
    """

    last: View | None = None
    slow: View | None = None
    slow_px: float = 0.0
    age: int = 0
    sums: tuple[Array, ...] = ()
    waited: int = 0
    lasts: int = 0
    rules: SmearRules = SmearRules()

    @property
    def share(self) -> tuple[float, float]:
        """The variance, frames², by which patches are smeared more than by a shutter, and its significance in σ."""
        return share_of(np.sum(self.sums, axis=0)) if self.sums else (0.0, 0.0)

    @property
    def problem(self) -> str:
        """The problem that earlier images show through, or an empty string."""
        return SHOWS_THROUGH if self.lasts else ""

    def after(self, now: View) -> "SmearCheck":
        """Return the check after a frame, from its smoothed left image and the track positions in it."""
        rules = self.rules
        check = changed(self, last=now, age=self.age + 1, waited=self.waited + 1, lasts=max(0, self.lasts - 1))
        if self.last is None or self.slow is None:
            return check._slow(now, 0.0)
        moved_px = now.left_px - self.last.of(now.ids)
        lengths_px = np.linalg.norm(moved_px, axis=1)
        known_px = lengths_px[np.isfinite(lengths_px)]
        typical_px = median(known_px) if len(known_px) else 0.0
        moves = typical_px > rules.typical_px
        if moves and (len(self.sums) < rules.remembered or check.waited >= rules.every):
            found = _found(self.slow, now, moved_px, rules)
            if found is None:
                return check._slow(now, typical_px)
            sums, other = found
            check = changed(check, sums=(*self.sums, sums)[-rules.remembered :], waited=0)
            blended = check.age == 1 and typical_px < rules.most_px and other > rules.other
            if blended or at_least(*check.share, rules.sigmas) > rules.variance:
                check = changed(check, lasts=rules.lasting_frames)
        return check._slow(now, typical_px) if check.age >= rules.oldest or typical_px < self.slow_px else check

    def interrupted(self) -> "SmearCheck":
        """Return the check after a frame that could not be followed."""
        return changed(self, last=None, slow=None)

    def _slow(self, view: View, moved_px: float) -> "SmearCheck":
        """Return the check with another slow view, whose tracks moved by `moved_px`."""
        return changed(self, slow=view, slow_px=moved_px, age=0)


def _found(slow: View, now: View, moved_px: Array, rules: SmearRules) -> tuple[Array, float] | None:
    """Return the evidence of a frame whose tracks moved by (n, 2), or None if it has too few patches.

    It is the `sums` as in `SmearCheck`, and the least share of another picture in the patches.
    """
    then_px, lengths_px = slow.of(now.ids), np.linalg.norm(moved_px, axis=1)
    usable = (lengths_px > rules.least_px) & (lengths_px < rules.most_px)
    usable &= now.inside(then_px) & now.inside(now.left_px)
    rows = usable.nonzero()[0]
    if len(rows) < rules.fewest or slow.image.shape != now.image.shape:
        return None
    rows = rows[:: -(-len(rows) // rules.patches)]
    then_px, now_px, x = then_px[rows], now.left_px[rows], lengths_px[rows] ** 2
    across, down = (moved_px[rows] / lengths_px[rows, None]).T
    turned, mixed = across**2 - down**2, 2 * across * down  # along minus across: turned·(xx − yy) + 2 mixed·xy
    before = patches_of(slow.image, then_px, RADIUS_PX + 1)
    after = patches_of(now.image, now_px, RADIUS_PX + 1)
    along = _SECOND * np.stack([turned, -turned, 2 * mixed], axis=1)
    (forth, var_forth, left, square), (back, var_back, _, _) = (
        core.patch_smears(*patches, along, rules.noise_grey, rules.least_square).T
        for patches in ((before, after), (after, before))
    )
    sampled = _blur_of_sampling(now_px) - _blur_of_sampling(then_px)
    y = (forth - back) / 2 - turned * (sampled[:, 0] - sampled[:, 1])
    weights = 1 / ((var_forth + var_back) / 4 + rules.std_px2**2)
    p, s = weights * x * (y - x / 12), weights * x**2  # 1/12: a shutter that is open for a whole frame
    return np.array([p.sum(), s.sum(), p @ p, p @ s, s @ s]), _other(left, square, rules.other_sigmas)


def _other(left: Array, square: Array, sigmas: float) -> float:
    """Return the share of another picture in patches (n,), less `sigmas` of its σ.

    It is the growth of their residuals `left` with their mean `square`, from the half with less texture to that with
    more.
    """
    if len(left) < 2:
        return 0.0
    order = square.argsort(kind="stable")
    halves = order[: len(order) // 2], order[len(order) // 2 :]
    (flat, textured), (flat_square, square_of_texture) = (
        [median(of[half]) for half in halves] for of in (left, square)
    )
    scatter = [median(np.abs(left[half] - median(left[half]))) / np.sqrt(len(half)) for half in halves]
    growth, std = textured - flat, _STD_OF_MEDIAN * np.hypot(*scatter)
    return float((growth - sigmas * std) / max(square_of_texture - flat_square, 1.0))


def _blur_of_sampling(px: Array) -> Array:
    """Return the variance (n, 2) of the blur by interpolation at positions (n, 2)."""
    fraction = px - np.floor(px)
    return np.asarray(fraction * (1 - fraction))
