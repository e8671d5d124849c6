"""The motions between the frames of the window and the newest one, with their covariances from the joint system.

A pose in the world contains all drift since the start; the motion over a few frames does not. Its covariance follows
directly from the joint covariance of the window, eq. (74), including all errors that the two poses share.
"""

import numpy as np

from .... import core
from ....geometry import Array, se3
from ....rig_model.estimate import RigEstimate
from ....types import CommonErrors, RelativeMotions
from ..inertia.interval import JOINT
from ..state import WindowState


def newest_motion(current: WindowState) -> Array:
    """Return the motion (4, 4) from the newest frame to the previous one, which may be the reference."""
    earlier = current.true_cams[-2] if len(current.frames) > 1 else np.eye(4)
    return se3.orthonormalise(earlier @ se3.inverse(current.true_cams[-1]))


def relative_motions(current: WindowState, by_span: Array, apparent_turns: float) -> RelativeMotions:
    """Return the motions from the newest frame to the reference camera and to every other frame of the window.

    `by_span` (b,): the factors on σ over 1 … b frames; the views of the window have the last of them, eq. (74d).
    `apparent_turns`: share of apparent rotations by sliding patches. These come and go within a window, so over any of
    its spans they count as over one frame, with this share of their variance, eq. (17b); those that stay add up in the
    pose.
    """
    frames, system = current.frames, current.system
    modes, turns = system.at["modes"], np.array([f.std_turn_rad for f in frames])
    from_newest, cov, by_rig = core.window_motions(
        *(current.cams_from_ref, current.true_cams, *_of_true_cams(current), system.cov_rig),
        *(by_span, np.array([modes.start, modes.stop]), turns, apparent_turns),
    )
    if any(f.ambiguity.shape[1] for f in frames):
        cov += _of_ambiguous(current)
    return RelativeMotions(
        frame_indices=np.array([f.index for f in current.all_frames[:-1]], np.int64),
        frame_from_newest=from_newest,
        cov=cov,
        common_jacobian=by_rig,
    )


def _of_true_cams(current: WindowState) -> tuple[Array, Array]:
    """Return a root (6F, n) of the covariance of `true_cams` given the rig's errors, and ∂ by these (6F, m)."""
    if current.inertia is not None:
        return current.inertia.true_poses(current.system)
    poses = current.system.at["poses"]
    return current.system.root[poses], current.system.by_rig[poses]


def common_errors(current: WindowState, rig: RigEstimate | None) -> CommonErrors | None:
    """Return the rig's errors, which all frames share, and their effect on the newest pose; None for an exact rig."""
    if rig is None:
        return None
    system = current.system
    of_poses, of_modes = system.by_rig[system.at["poses"]], system.by_rig[system.at["modes"]]
    of_world = se3.adjoint(current.newest_cam_from_ref) @ system.prior.world_modes[JOINT["pose"]]
    of = system.prior.of_modes
    jacobian = of_world[:, of["own"]] @ of_modes + of_world[:, of["rig"]] - of_poses[-6:]
    return CommonErrors(current.rig_error, rig.cov, jacobian)


def _of_ambiguous(current: WindowState) -> Array:
    """Return the covariances (r, 6, 6) by ambiguous motions between earlier frames and the newest; they add up."""
    frames, covs = current.frames[::-1], []
    by_cams = se3.adjoint(current.newest_cam_from_ref @ se3.inverse(current.cams_from_ref[::-1]))
    together, apart = np.zeros((6, 6)), np.zeros((6, 6))
    for frame, moved in zip(frames, by_cams, strict=True):
        if frame.ambiguity.shape[1]:
            other = moved @ frame.ambiguity
            together, apart = together + other[:, :6], apart + other[:, 6:] @ other[:, 6:].T
        covs.append(together @ together.T + apart)
    return np.array(covs[::-1])
