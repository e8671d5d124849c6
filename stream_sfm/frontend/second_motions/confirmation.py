"""Confirms by points that begin later that the motion followed is the camera's.

The points of a body that is followed instead of the scene all agree with its motion. But points begin where they are
missing, on the scene as well as on the body, and those on the scene disagree.
"""

import numpy as np
from numpy.typing import NDArray

from ...geometry.evidence import Evidence, ratio_of_share
from ...record import changed, record
from ..rules import MotionRules


@record
class Confirmation:
    """The `evidence` that the motion followed is the camera's, by tracks whose ids are not below `next_id`.

    `contradicted`: whether the latest ones have taken back all that spoke for it.
    """

    evidence: Evidence
    next_id: int = 0
    contradicted: bool = False
    rules: MotionRules = MotionRules()

    @classmethod
    def sought(cls, rules: MotionRules, next_id: int = 0) -> "Confirmation":
        """Return that of a motion that nothing has confirmed yet."""
        return cls(Evidence(rules.confirmed_nats, rules.unsteady_frames), next_id, False, rules)

    @property
    def is_there(self) -> bool:
        """Whether the motion is confirmed."""
        return self.evidence.is_there

    def after(self, ids: NDArray[np.int64], accepted: NDArray[np.bool_]) -> "Confirmation":
        """Return the same after a frame in which the tracks `ids` (n,), ascending, were found.

        `accepted` (n,): which of them agree with its motion. Each track is judged once, when it is first found again.
        """
        new = ids >= self.next_id
        agree, n = int(np.count_nonzero(new & accepted)), int(np.count_nonzero(new))
        nats = ratio_of_share(agree, n, self.rules.new_favour)
        evidence = self.evidence.after(nats)
        next_id = max(self.next_id, int(ids[-1]) + 1 if len(ids) else 0)
        return changed(self, evidence=evidence, next_id=next_id, contradicted=nats < 0 and not evidence.change)
