"""A unit on trial: its state beside the map, so that samples that are not used can show that they agree again.

This is a small filter. The images' motions between frames correct the state, and nothing goes back to the images.
"""

import numpy as np

from ....geometry import Array
from ....geometry.linear import symmetric
from .belief import Innovation
from .interval import JOINT, Known


def corrected(then: Known, found: Innovation) -> Known:
    """Return a state corrected by the motion of a frame, eq. (85b): the camera is the reference from then on.

    `then`: pose and state as predicted from the camera before; `found`: the motion of the images compared with it.
    """
    pose, state = JOINT["pose"], JOINT["state"]
    gain = np.linalg.solve(found.cov, then.cov[pose]).T
    cov = symmetric(then.cov - gain @ then.cov[pose])
    return beside(
        then.stamp_ns, np.eye(4), np.zeros((6, 6)), then.state + (gain @ found.apart)[state], cov[state, state]
    )


def beside(stamp_ns: int, world_from_cam: Array, cov_pose: Array, state: Array, cov_state: Array) -> Known:
    """Return a pose and a state whose errors are independent."""
    joint = np.zeros((JOINT.size, JOINT.size))
    joint[JOINT["pose"], JOINT["pose"]], joint[JOINT["state"], JOINT["state"]] = cov_pose, cov_state
    return Known(stamp_ns, world_from_cam, state, joint)
