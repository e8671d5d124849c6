"""The stages of views (n, 4) px, each a type of its own: what has been taken out of them so far.

Raw → timed → corrected. Arithmetic returns plain arrays, so each function that takes an error out names the stage of
its result, and mypy refuses views of one stage where those of another are asked for.
"""

from typing import NewType

import numpy as np
from numpy.typing import NDArray

RawViews = NewType("RawViews", NDArray[np.float64])
"""As in the rectified images; the rig's refinement counts as part of the rectification."""
TimedViews = NewType("TimedViews", NDArray[np.float64])
"""As at the stamp of their frame: without the effects of delay and readout."""
CorrectedViews = NewType("CorrectedViews", NDArray[np.float64])
"""Without any known error of the rig: what is compared with projected points."""
