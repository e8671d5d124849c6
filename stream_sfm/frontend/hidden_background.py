"""Whether a body hides the background, so that what agrees moves by itself.

It is so where fewer tracks agree that have ever agreed before than MANY_VIEWS and than half, while as many new tracks
agree on a motion that has jumped, or that came while the background was hidden already. Where they lie before the
background, a motion jumps that is unlike how this camera moves.
"""

import numpy as np

from ..geometry.medians import median
from ..geometry.resection import MANY_VIEWS, Resection
from .seen import Seen
from .state import FrontEndState
from .step import Step
from .tracks import Tracks


def is_background_hidden(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> bool:
    """Whether the tracks that were found are mostly of things that move by themselves, and so is their motion."""
    trusted, agree = seen.before.agreed > 0, motion.accepted
    needed = min(MANY_VIEWS, 0.5 * np.count_nonzero(state.tracks.agreed))
    if np.count_nonzero(agree & trusted) >= needed:
        return False
    new = seen.before.keep(agree & ~trusted)
    if len(new) < step.setup.rules.motion.hidden_views:
        return False
    usual = step.usual_change(state.unsteadiness) if _is_before(step, new, state.tracks) else step.std_change
    return state.background_hidden or step.jumps(motion.cam_from_ref, usual)


def _is_before(step: Step, new: Tracks, tracks: Tracks) -> bool:
    """Whether new tracks lie before those that have agreed, as a body does that comes to hide them."""
    old = tracks.points[tracks.agreed > 0, 3]
    return bool(len(old)) and median(new.points[:, 3]) > step.setup.rules.start.deeper * median(old)
