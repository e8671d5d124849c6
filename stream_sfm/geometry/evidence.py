"""Evidence over frames: whether something has begun or has ended, decided by one sum with one bound, eq. (7a).

Errors that the patches or views of a frame share make them one event. So the log-likelihood ratio of a frame is that of
the whole frame, and independence is assumed between frames only.
"""

import math

from ..record import changed, record


@record
class Evidence:
    """What the frames so far say about whether something is there.

    `change`: the evidence, in nats, that this is no longer the case, or that it has begun; from `bound` on it counts as
    such. Of each frame the share 1/`memory_frames` is forgotten per frame.
    """

    bound: float
    memory_frames: float
    is_there: bool = False
    change: float = 0.0

    def after(self, nats: float) -> "Evidence":
        """Return the evidence after a frame; `nats`: the log-likelihood ratio of being there against not being there.

        Contrary evidence takes back what there is, and no more.
        """
        kept = (1 - 1 / self.memory_frames) * self.change
        change = max(0.0, kept - nats if self.is_there else kept + nats)
        if change < self.bound:
            return changed(self, change=change)
        return changed(self, is_there=not self.is_there, change=0.0)

    @property
    def log_odds(self) -> float:
        """The log odds of being there, as the bound is minus the log of the prior odds of a change."""
        return self.bound - self.change if self.is_there else self.change - self.bound


def ratio_of_share(agree: int, n: int, favour: float) -> float:
    """Return the log-likelihood ratio, nats, of a frame in which some of n points agree, eq. (7c).

    What the points of a frame show they share: the share s that agrees is one unknown of the frame. It has the density
    a s^(a-1), a = `favour`, where points should agree, and otherwise any is as probable as any other.
    """
    if not n:
        return 0.0
    expected = math.log(favour) + math.lgamma(agree + favour) - math.lgamma(n + favour + 1)
    return expected + math.lgamma(n + 2) - math.lgamma(agree + 1)


def log_ratio(shown: float, variance: float, expected: float) -> float:
    """Return the log-likelihood ratio, nats, of an amount `expected` against 0 by a Gaussian estimate of it.

    `variance` contains what differs from frame to frame as well.
    """
    return expected * (shown - 0.5 * expected) / variance
