"""Checks whether a body hides the background, so that the agreeing tracks are on a moving object.

This is so if two conditions hold. Of the tracks that have agreed before, fewer than MANY_VIEWS and fewer than half
agree now. And many new tracks agree on a motion that has jumped, or the background was hidden already. If the new
tracks lie in front of the background, a motion jumps if it is unlike the usual motion of this camera.
"""

import numpy as np

from ..geometry.medians import median
from ..geometry.resection import MANY_VIEWS, Resection
from .seen import Seen
from .state import FrontEndState
from .step import Step
from .tracks import Tracks


def is_background_hidden(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> bool:
    """Whether most of the tracks that were found, and so their motion, belong to moving objects."""
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
    """Whether new tracks lie in front of those that have agreed, like a body that hides them."""
    old = tracks.points[tracks.agreed > 0, 3]
    return bool(len(old)) and median(new.points[:, 3]) > step.setup.rules.start.deeper * median(old)
