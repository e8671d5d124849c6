"""Whether patches are smeared along their motion by more than a shutter can, as where cameras average frames.

An image that is a·(last image) + (1 − a)·(what the camera sees) shows a point that moves by d per frame where it was
a/(1 − a) frames ago in the mean, with a variance of a/(1 − a)² frames². So it is smeared along its motion by a variance
of a/(1 − a)²·d², and that is all that shows where motion is slow. A shutter that is open from one frame to the next
smears by d²/12, and none by more; as much as with a = 0.07. Poses are wrong where the speed has changed, and there the
smear has changed as well.

A patch now is compared with that of the same point in the slowest of the latest frames. Of C, the change of the
covariance of what blurs it, the second derivatives of the patch show it: I = T + ½ tr(C·∇∇T), beside changes of light,
place and shape. Noise blurs as well, namely what the other patch explains of it; so the same is done with the two
exchanged, and half the difference taken. Focus blurs in all directions; so C is taken along the motion less across it.
Sampling between pixels blurs by f·(1 − f), f the fraction of the position, which is taken out. What is left, y, is
regressed on x = d² over all patches: Σ x·(y − x/12) over Σ x² is a/(1 − a)² − 1/12, less where the slowest frame is
hardly slower, and not above zero in any other images.

In the first frame that moves after a start, half of what both cameras show may not have moved. Where that is more than
a few pixels, alignment finds the half that is at rest, and no second derivative explains the other one. Noise is the
same in all patches, and half of another picture is the more the more texture there is: what is left of patches,
compared with those of the frame before, grows with their contrast.
"""

import numpy as np

from .. import core
from ..config.image_rules import SmearRules
from ..geometry import Array
from ..geometry.medians import median
from ..record import changed, record
from .ghost_check import SHOWS_THROUGH
from .patches import RADIUS_PX, View, at_least, patches_of, share_of

_STD_OF_MEDIAN = 1.86  # over the median deviation, by the root of the number
_SECOND = np.array([2.0, 2.0, 4.0])  # from coefficients of the last three changes to C: xx, yy, xy


@record
class SmearCheck:
    """What the frames so far have shown: the `last` view, and the `slow` one, whose tracks moved by `slow_px`, `age`
    frames ago; `sums` (5,) of the latest frames that were looked at, over all patches: of p = w x (y − x/12), s = w x²,
    p², p s and s²; `waited`: frames since the last one. `lasts`: for how many frames a smear is still suspected."""

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
        """By how much variance, frames², patches are smeared more than by a shutter, and this in σ."""
        return share_of(np.sum(self.sums, axis=0)) if self.sums else (0.0, 0.0)

    @property
    def problem(self) -> str:
        """Say that earlier images show through; or nothing."""
        return SHOWS_THROUGH if self.lasts else ""

    def after(self, now: View) -> "SmearCheck":
        """Return the check after a frame: its smoothed left image, and where its tracks are in it."""
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
        """The check with another slow view, whose tracks moved by so much."""
        return changed(self, slow=view, slow_px=moved_px, age=0)


def _found(slow: View, now: View, moved_px: Array, rules: SmearRules) -> tuple[Array, float] | None:
    """What a frame says, the tracks of which moved by (n, 2): `sums` as in `SmearCheck`, and how much of its patches
    is of another picture, at least; None where it is too little."""
    then_px, lengths_px = slow.of(now.ids), np.linalg.norm(moved_px, axis=1)
    usable = (lengths_px > rules.least_px) & (lengths_px < rules.most_px)
    usable &= now.inside(then_px) & now.inside(now.left_px)
    rows = usable.nonzero()[0]
    if len(rows) < rules.fewest or slow.image.shape != now.image.shape:
        return None
    rows = rows[:: -(-len(rows) // rules.patches)]
    then_px, now_px, x = then_px[rows], now.left_px[rows], lengths_px[rows] ** 2
    across, down = (moved_px[rows] / lengths_px[rows, None]).T
    turned, mixed = across**2 - down**2, 2 * across * down  # along less across: turned·(xx − yy) + 2 mixed·xy
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
    p, s = weights * x * (y - x / 12), weights * x**2  # 1/12: variance of a shutter that is open for a whole frame
    return np.array([p.sum(), s.sum(), p @ p, p @ s, s @ s]), _other(left, square, rules.other_sigmas)


def _other(left: Array, square: Array, sigmas: float) -> float:
    """The share of another picture in patches (n,), so many σ below it: how what is `left` of them grows with their
    mean `square`, from the half with less texture to that with more."""
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
    """By how much variance (n, 2) interpolation blurs at positions (n, 2)."""
    fraction = px - np.floor(px)
    return np.asarray(fraction * (1 - fraction))
