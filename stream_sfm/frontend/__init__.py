"""Images to observations: detect, match left to right, track through time, reject outliers.

Here: everything that looks at pixels. Not here: the estimate (`estimators/`), files (`recording/`). The front-end
keeps its own rough motion and depths for prediction, so that methods can be compared on the same observations; an
estimator tells it no more than delay and readout of the cameras (`FrontEnd.learn`). Equations "(n)" are those of
docs/mathematics.md, sections 3 and 11.
"""

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from ..rig_model.estimate import RigEstimate
    from ..types import Observations
    from .prepared import PreparedImages
    from .state import FrontEndState


class FrontEnd(Protocol):
    """What a front-end offers, that of a pair (`front_end.py`) and that of one camera (`mono/front_end.py`).

    Nothing in it changes: what is learnt from frames is in the `FrontEndState`, `start` before the first one, which
    each step replaces. So a state can be kept, copied and gone on from more than once.
    """

    start: "FrontEndState"

    def prepare(self, images: "PreparedImages", frame_index: int) -> None:
        """Compute more forms of the images now that `step` would compute, for the index that the frame will have.

        Any thread may call it at any time, in any order, also for frames that are never stepped; the observations are
        the same.
        """
        ...

    def step(
        self, state: "FrontEndState", images: "PreparedImages", stamp_ns: int
    ) -> tuple["FrontEndState", "Observations"]:
        """Return the state after the next frame, and the frame's observations; stamps ascend."""
        ...

    def learn(self, state: "FrontEndState", estimate: "RigEstimate") -> "FrontEndState":
        """Take in what an estimator has found out about the rig with the latest frame, in units of σ."""
        ...

    def rig_in_px(self, state: "FrontEndState", estimate: "RigEstimate | None") -> "RigEstimate | None":
        """Errors of the calibration in units of their σ, in pixels."""
        ...
