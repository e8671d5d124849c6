"""Whether a body hides the background, so that what agrees moves by itself.

It is so where fewer tracks agree that have ever agreed before than MANY_VIEWS and than half, while as many new tracks
agree on a motion that has jumped, or that came while the background was hidden already.
"""

import numpy as np

from ..geometry.resection import MANY_VIEWS, Resection
from .seen import Seen
from .state import FrontEndState
from .step import Step


def is_background_hidden(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> bool:
    """Whether the tracks that were found are mostly of things that move by themselves, and so is their motion."""
    trusted, agree = seen.before.agreed > 0, motion.accepted
    needed = min(MANY_VIEWS, 0.5 * np.count_nonzero(state.tracks.agreed))
    if np.count_nonzero(agree & trusted) >= needed:
        return False
    jumps = step.jumps(motion.cam_from_ref, step.std_change)
    newcomers = int(np.count_nonzero(agree & ~trusted))
    return (state.background_hidden or jumps) and newcomers >= step.setup.rules.motion.hidden_views
