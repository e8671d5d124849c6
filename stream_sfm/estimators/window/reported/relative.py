"""The motions between the frames of the window and the newest one, with their covariances from the joint system.

A pose in the world contains all drift since the start; the motion over a few frames does not. Its covariance follows
directly from the joint covariance of the window, eq. (74), including all errors that the two poses share.
"""

import numpy as np

from ....geometry import Array, se3
from ....geometry.linear import product
from ....rig_model.estimate import RigEstimate
from ....types import CommonErrors, RelativeMotions
from ..inertia.interval import JOINT
from ..state import WindowState


def apart_from_newest(from_newest: Array, *of_poses: Array) -> list[Array]:
    """Return J of eq. (74) times each matrix (6F, n), for the reference and every camera of F but the newest.

    `from_newest` (F − 1, 4, 4): the motions from the newest camera to these cameras, without the reference.
    """
    moved = se3.adjoint(se3.inverse(from_newest))
    by_pose = [each.reshape(len(moved) + 1, 6, -1) for each in of_poses]
    return [np.concatenate([-each[-1:], moved @ each[:-1] - each[-1]]) for each in by_pose]


def newest_motion(current: WindowState) -> Array:
    """Return the motion (4, 4) from the newest frame to the previous one, which may be the reference."""
    earlier = current.true_cams[-2] if len(current.frames) > 1 else np.eye(4)
    return se3.orthonormalise(earlier @ se3.inverse(current.true_cams[-1]))


def relative_motions(current: WindowState, by_span: Array, apparent_turns: float) -> RelativeMotions:
    """Return the motions from the newest frame to the reference camera and to every other frame of the window.

    `by_span` (b,): the factors on σ over 1 … b frames; the views of the window have the last of them, eq. (74d).
    `apparent_turns`: share of apparent rotations by sliding patches.
    """
    frames, system = current.frames, current.system
    true_cams, (of_poses, of_rig) = current.true_cams, _of_true_cams(current)
    cams = np.array([np.eye(4), *true_cams[:-1]])  # the reference is exact by definition
    from_newest = cams @ se3.inverse(true_cams[-1])
    half, by_rig = apart_from_newest(from_newest[1:], of_poses, of_rig)
    factors = by_span[: len(frames), None, None][::-1]
    modes = system.at["modes"]
    half[..., : modes.start] *= factors / by_span[-1]
    half[..., modes] *= factors
    cov = half @ np.swapaxes(half, 1, 2) + product(by_rig, system.cov_rig) @ np.swapaxes(by_rig, 1, 2)
    return RelativeMotions(
        frame_indices=np.array([f.index for f in current.all_frames[:-1]], np.int64),
        frame_from_newest=se3.orthonormalise(from_newest),
        cov=cov + _of_motions(current, apparent_turns),
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


def _of_motions(current: WindowState, apparent_turns: float) -> Array:
    """Return the covariances (r, 6, 6) to add to the motions between each earlier frame and the newest one.

    Differences of ambiguous motions add up. Apparent rotations by sliding patches come and go within a window, so over
    any of its spans they count as over one frame, with a share `apparent_turns` of their variance, eq. (17b); those
    that stay add up in the pose.
    """
    frames = current.frames[::-1]
    by_cams = se3.adjoint(current.newest_cam_from_ref @ se3.inverse(current.cams_from_ref[::-1]))
    turned = np.array([f.std_turn_rad for f in frames])[:, None, None] * by_cams[..., 3:]
    turns = np.cumsum(turned @ np.swapaxes(turned, 1, 2), axis=0)
    covs = apparent_turns / np.arange(1, len(frames) + 1)[:, None, None] * turns
    if not any(f.ambiguity.shape[1] for f in frames):
        return covs[::-1]
    together, apart = np.zeros((6, 6)), np.zeros((6, 6))
    for cov, frame, moved in zip(covs, frames, by_cams, strict=True):
        if frame.ambiguity.shape[1]:
            other = moved @ frame.ambiguity
            together, apart = together + other[:, :6], apart + other[:, 6:] @ other[:, 6:].T
        cov += together @ together.T + apart
    return covs[::-1]
