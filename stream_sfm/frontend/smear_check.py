"""Whether patches are smeared along their motion by more than a shutter can, as where cameras average frames.

An image that is a·(last image) + (1 − a)·(what the camera sees) shows a point that moves by d per frame where it was
a/(1 − a) frames ago in the mean, with a variance of a/(1 − a)² frames². So it is smeared along its motion by a variance
of a/(1 − a)²·d², and that is all that shows where motion is slow. A shutter that is open from one frame to the next
smears by d²/12, and none by more; as much as with a = 0.07. Poses are wrong where the speed has changed, and there the
smear has changed as well.

A patch now is compared with that of the same point in the slowest of the latest frames. Of C, the change of the
covariance of what blurs it, the second derivatives of the patch tell: I = T + ½ tr(C·∇∇T), beside changes of light,
place and shape. Noise blurs as well, namely what the other patch explains of it; so the same is done with the two
exchanged, and half the difference taken. Focus blurs in all directions; so C is taken along the motion less across it.
Sampling between pixels blurs by f·(1 − f), f the fraction of the position, which is taken out. What is left, y, is
regressed on x = d² over all patches: Σ x·(y − x/12) over Σ x² is a/(1 − a)² − 1/12, less where the slowest frame is
hardly slower, and not above zero in any other images.
"""

import numpy as np

from .. import core
from ..config.rules import SmearRules
from ..geometry.medians import median
from ..geometry.se3 import Array
from ..record import changed, record
from .ghost_check import SHOWS_THROUGH
from .patches import RADIUS_PX, View, patches_of, share_of

_SHUTTER = 1 / 12  # variance of a whole frame
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
            sums = _sums(self.slow, now, moved_px, rules)
            if sums is None:
                return check._slow(now, typical_px)
            check = changed(check, sums=(*self.sums, sums)[-rules.remembered :], waited=0)
            variance, significance = check.share
            if variance > rules.variance and significance > rules.sigmas:
                check = changed(check, lasts=rules.lasting_frames)
        return check._slow(now, typical_px) if check.age >= rules.oldest or typical_px < self.slow_px else check

    def interrupted(self) -> "SmearCheck":
        """Return the check after a frame that could not be followed."""
        return changed(self, last=None, slow=None)

    def _slow(self, view: View, moved_px: float) -> "SmearCheck":
        """The check with another slow view, whose tracks moved by so much."""
        return changed(self, slow=view, slow_px=moved_px, age=0)


def _sums(slow: View, now: View, moved_px: Array, rules: SmearRules) -> Array | None:
    """What a frame says, the tracks of which moved by (n, 2): see `SmearCheck`; None where it is too little."""
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
    (forth, var_forth), (back, var_back) = (
        core.patch_smears(*patches, along, rules.noise_grey, rules.least_square).T
        for patches in ((before, after), (after, before))
    )
    sampled = _blur_of_sampling(now_px) - _blur_of_sampling(then_px)
    y = (forth - back) / 2 - turned * (sampled[:, 0] - sampled[:, 1])
    weights = 1 / ((var_forth + var_back) / 4 + rules.std_px2**2)
    p, s = weights * x * (y - _SHUTTER * x), weights * x**2
    return np.array([p.sum(), s.sum(), p @ p, p @ s, s @ s])


def _blur_of_sampling(px: Array) -> Array:
    """By how much variance (n, 2) interpolation blurs at positions (n, 2)."""
    fraction = px - np.floor(px)
    return np.asarray(fraction * (1 - fraction))
