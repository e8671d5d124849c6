"""What `refine` writes into a calibration itself: a turn of the right camera, and the focal length."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..camera.models import Camera
from ..camera.rectification import Rectifier
from ..camera.rig import StereoRig
from ..geometry import Array, se3
from ..rig_model.estimate import CERTAIN, RigEstimate
from ..rig_model.terms import FOCAL


def with_right_turned(rig: StereoRig, turn_rad: Array) -> StereoRig:
    """Return the rig with its right camera turned about its centre, by (2,) about the rectified x and z."""
    right_from_rect = rig.right_from_left[:3, :3] @ Rectifier(rig).rect_from_cam.T
    turn = np.concatenate([np.zeros(3), right_from_rect @ np.array([turn_rad[0], 0.0, turn_rad[1]])])
    return replace(rig, right_from_left=se3.exp(turn) @ rig.right_from_left)


def focal_of(estimates: Sequence[RigEstimate]) -> tuple[float, float]:
    """Return the error of the common focal length and its σ, as shares of it; zeros if it is not certain.

    It is certain if some runs are, and their thirds agree, and these runs agree with each other.
    """
    found = np.array([e.term(FOCAL) for e in estimates if e.agrees((FOCAL,))]).reshape(-1, 2)
    sure = found[np.abs(found[:, 0]) > CERTAIN * found[:, 1]]
    if not len(sure) or np.ptp(sure[:, 0]) > CERTAIN * sure[:, 1].max():
        return 0.0, 0.0
    return together(sure[:, 0], sure[:, 1] ** 2)


def together(mean: Array, var: Array) -> tuple[float, float]:
    """Return what independent runs (n,) say together, and its σ: their scatter, if that is larger than they claim."""
    information = (1 / var).sum()
    scatter = float(mean.std(ddof=1)) if len(mean) > 1 else 0.0
    return float((mean / var).sum() / information), max(float(information**-0.5), scatter)


def with_longer_focal(rig: StereoRig, share: float) -> StereoRig:
    """Return the rig with the focal lengths of both cameras longer by a share of them."""

    def longer(camera: Camera) -> Camera:
        k = camera.K.copy()
        k[:2, :2] *= 1 + share
        return replace(camera, K=k)

    return replace(rig, left=longer(rig.left), right=longer(rig.right))
