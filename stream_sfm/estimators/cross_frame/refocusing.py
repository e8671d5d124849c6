"""A focus that moves: by what it changes the errors of the rig, eq. (72g)."""

import numpy as np

from ...geometry.se3 import Array
from .prior import Prior
from .rig_knowledge import RigKnowledge
from .window_frame import WindowFrame


def refocused(prior: Prior, frame: WindowFrame, next_ns: int) -> Prior:
    """Return the prior with a focus that may have moved faster or slower since `frame`, if it moves at all.

    `next_ns`: the stamp of the frame after it.
    """
    if frame.rig is None:
        return prior
    passed_s, age_s = (next_ns - frame.stamp_ns) / 1e9, prior.rig.age_s(frame.stamp_ns)
    root = frame.rig.root_of_focusing(prior.rig.held, prior.rig.cov_held, age_s, passed_s)
    if not root.any():
        return prior
    # until now its motion was taken for other errors, which are as unknown as at first
    return prior.with_rig_change(prior.rig.changed(_with_others(root, prior.rig)))


def _with_others(root: Array, rig: RigKnowledge) -> Array:
    """Return a root with that of all errors as at first, of a rig that was steady until now."""
    return np.concatenate([root, np.diag(rig.size)], axis=1) if rig.steady else root
