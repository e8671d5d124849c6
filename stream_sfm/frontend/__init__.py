"""Images to observations: detect, match left to right, track through time, reject outliers.

Here: everything that looks at pixels. Not here: the estimate (`estimators/`), files (`recording/`). The front-end
keeps its own rough motion and depths for prediction, so that methods can be compared on the same observations; an
estimator tells it no more than delay and readout of the cameras (`FrontEnd.learn`). Equations "(n)" are those of
docs/mathematics.md, sections 3 and 11.
"""

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..geometry.se3 import Array
    from ..rig_model.estimate import RigEstimate
    from ..types import Observations
    from .prepared import Image, PreparedImages


class FrontEnd(Protocol):
    """What a front-end offers, that of a pair (`front_end.py`) and that of one camera (`mono/front_end.py`)."""

    def prepare(self, left: "Image", right: "Image", frame_index: int | None = None) -> "PreparedImages":
        """Compute from rectified images (h, w) uint8 the forms that `step` needs. Pure."""
        ...

    def step(self, frame_index: int, stamp_ns: int, images: "PreparedImages") -> "Observations":
        """Observations of the next frame; indices count the frames from 0, stamps ascend."""
        ...

    def learn(self, estimate: "RigEstimate") -> None:
        """Take in what an estimator has found out about the rig with the latest frame, in units of σ."""
        ...

    def std_bias_px(self, ids: NDArray[np.int64]) -> "Array":
        """σ (n,) of the disparity error that all views of a point share, px, of points by id (n,)."""
        ...

    def rig_in_px(self, estimate: "RigEstimate | None") -> "RigEstimate | None":
        """Errors of the calibration in units of their σ, in pixels."""
        ...
