"""Checks whether earlier images show through, as when cameras or recorders average frames against noise.

Such a camera delays motion by a/(1 − a) frames, left and right alike (docs/mathematics.md, section 8). The evidence is
a second picture in each patch I: the patch P of an earlier image at the same pixels. What the patch T of the same point
some frames earlier explains of I, with changes of light, position, warp and blur, is taken out; the rest r_I is
regressed on that of P, with two controls, of which the one with less evidence counts: O, the patch of the last image on
the other side of the point, which a fast approach resembles as much as P; and the same with both images exchanged (J,
N), as sensor patterns and sampling are alike in both directions of time.
"""

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.section import Section, expert
from ..geometry import Array
from ..geometry.evidence import log_ratio
from ..record import record
from .prepared import PreparedImages
from .view import View


class GhostRules(Section, frozen=True, kw_only=True):
    """Whether earlier images show through."""

    # Slower views look too alike to tell; with 0.7 hardly more ghosts are found.
    least_px: Annotated[float, expert("least motion between two frames of an examined patch, px", 0.1, 1000)] = 1.5
    # By then the motion has changed, but the view of the point hardly.
    back_frames: Annotated[int, expert("frames between the two views of a patch that are compared", 1, 100)] = 4
    # Each costs about 6 µs.
    patches: Annotated[int, expert("most patches of a frame", 1, 2000)] = 64
    fewest: Annotated[int, expert("least patches of a frame that says anything", 1, 2000)] = 5
    # What rounding leaves in smoothed images.
    noise_grey: Annotated[float, expert("least σ of what is left of a patch", 0.1, 1000)] = 1.0
    least_square: Annotated[float, expert("least square of a change of a patch", 1e-12, 1e6)] = 1e-3
    # Cameras that average frames mix 0.15 and more, of which a quarter shows where motion hardly changes.
    share: Annotated[float, expert("least share of the previous image that counts as showing through", 0, 1)] = 0.04
    # In 330 frames of sound logs, real and rendered, none then has more than 3 nats. With noise reduction of 0.2
    # to 0.5, two moving frames have 12.
    std_share: Annotated[float, expert("σ of the previous image's share in sound images", 1e-6, 1)] = 0.02
    # On a road, 0.59 of the frames are so.
    steady: Annotated[float, expert("share of frames whose steady motion hides a ghost", 1e-3, 0.999)] = 0.6


_NOTHING = np.zeros((2, 5))


@record
class Ghosts:
    """Compares patches with what was at their pixels in the last image."""

    rules: GhostRules = GhostRules()

    sentence: ClassVar[str] = (
        "earlier images show through: is noise reduction over time on in the cameras, or were frames blended? "
        "Positions lag behind"
    )
    of_pair: ClassVar[bool] = False

    @property
    def earlier(self) -> int:
        """The frames between the two views of a patch."""
        return self.rules.back_frames

    def nats(self, images: PreparedImages, views: tuple[View, ...]) -> float | None:
        """Return the evidence by the control that has less of it, or None if too few patches move."""
        found = [share_of(sums) for sums in _sums(views, self.rules)]
        if None in found:
            return None
        return min(self._nats(*each) for each in found if each is not None)

    def _nats(self, share: float, std: float) -> float:
        """Return the log-likelihood ratio of a ghost, of the share that fits best, against none.

        Nor does a ghost show in steady motion.
        """
        rules = self.rules
        shows = log_ratio(share, std**2 + rules.std_share**2, min(max(share, rules.share), 1.0))
        return float(np.logaddexp(np.log(rules.steady), np.log1p(-rules.steady) + shows))


def _sums(views: tuple[View, ...], rules: GhostRules) -> Array:
    """Return sums (2, 5) over patches of the last of these frames, for both controls; zeros if too few move.

    They are those of p = r_I·(r_P − r_O), s = r_P², p², p s and s², and the same with p = r_I·r_P − r_J·r_N. P is taken
    from the latest frame since which enough patches have moved.
    """
    now = views[-1]
    for at in reversed(range(len(views) - 1)):
        before = views[at]
        last_px = before.of(now.ids)
        usable = np.linalg.norm(now.left_px - last_px, axis=1) > rules.least_px
        usable &= now.inside(now.left_px) & now.inside(2 * last_px - now.left_px)
        first, usable = _oldest(views[: at + 1], now, usable)
        rows = usable.nonzero()[0]
        if len(rows) >= rules.fewest:
            rows = rows[:: -(-len(rows) // rules.patches)]
            at_px = now.left_px[rows], last_px[rows], first.of(now.ids)[rows]
            return core.ghost_sums(now.image, before.image, first.image, *at_px, rules.noise_grey, rules.least_square)
    return _NOTHING


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


def share_of(sums: Array) -> tuple[float, float] | None:
    """Return the share of the last image and its σ, by the scatter of patches, from the sums (5,) of a control.

    None if there are no patches.
    """
    p, s, pp, ps, ss = sums
    if s <= 0:
        return None
    share = p / s
    variance = pp - 2 * share * ps + share**2 * ss
    return float(share), float(np.sqrt(max(variance, 1e-6 * pp)) / s)
