"""Warps of patches against the images of a plane, point by point, and their benefit to a turning camera."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config, RigConfig
from stream_sfm.core import _core
from stream_sfm.frontend.learnt.timing import Timing
from stream_sfm.frontend.tracks import Tracks
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection, velocities
from stream_sfm.pipeline.engine import Engine
from tests.helpers.estimators import nees
from tests.helpers.rectified import own_rows
from tests.helpers.wall import Wall, rig

P = StereoProjection(300.0, 160.0, 150.0, 120.0, 0.2, 320, 240)
CAM_FROM_ANCHOR = se3.exp([0.3, -0.1, -0.4, 0.1, -0.25, 0.15])
RAY, RHO, SLOPES = np.array([0.2, -0.1]), 0.4, np.array([0.15, -0.1])  # of the surface, in the anchor camera
OFFSETS_PX = np.stack(np.meshgrid(np.arange(-8, 9, 4.0), np.arange(-8, 9, 4.0)), axis=-1).reshape(-1, 2)


def images_of(offsets_px: np.ndarray) -> np.ndarray:
    """Views (n, 4) in the camera of surface points at offsets (n, 2) around the template's centre."""
    d = offsets_px / P.f_px
    anchor = np.concatenate([RAY + d, np.ones((len(d), 1)), (RHO + d @ SLOPES)[:, None]], axis=1)
    return P.project_homogeneous(anchor @ CAM_FROM_ANCHOR.T)


def track(anchor_velocity_px_s: np.ndarray) -> Tracks:
    """A track of the central point, seen in the camera."""
    point = CAM_FROM_ANCHOR @ np.array([*RAY, 1, RHO])
    return replace(
        Tracks.none(), cov_left_px=0.01 * np.eye(2)[None], points=(point / point[2])[None],
        var_rho=np.array([1e-6]), anchor_from_start=np.eye(4)[None],
        anchor_velocity_px_s=anchor_velocity_px_s[None], slopes=SLOPES[None], scale=np.ones(1, np.int64),
    )  # fmt: skip


def warps(tracks: Tracks, timing: Timing, twist: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Its warps in the left and in the right image."""
    of_motion = np.eye(4), CAM_FROM_ANCHOR, np.zeros((1, 2)), np.array([False])
    *_, left, right = _core._predict_tracks(P, timing, twist, tracks, *of_motion)
    return left[0], right[0]


@pytest.mark.parametrize("side", [0, 1])
def test_a_warp_is_the_plane_s_exact_map(side: int) -> None:
    warp = warps(track(np.zeros(2)), Timing.unknown(P, RigConfig(), None), np.zeros(6))[side]
    columns = slice(2 * side, 2 * side + 2)
    now_px = images_of(OFFSETS_PX)[:, columns] - images_of(np.zeros((1, 2)))[:, columns]
    back = (now_px @ warp[:2].T) / (1 + now_px @ warp[2])[:, None]
    assert np.abs(back - OFFSETS_PX).max() < 1e-9
    affine = now_px @ warp[:2].T
    assert np.abs(affine - OFFSETS_PX).max() > 0.05  # the error of the affine part alone


@pytest.mark.parametrize("side", [0, 1])
def test_a_warp_knows_how_a_readout_shears_patches(side: int) -> None:
    """Images have the times of their rows, and points have a twist: small offsets now become those of the template.

    What is left is that velocities differ over a patch, a tenth of the shear.
    """
    rows, readout_s, step_px = own_rows(P), 0.02, 1.0
    timing = replace(Timing.unknown(P, RigConfig(), rows), mean=np.array([0.0, readout_s]))
    then, now = np.array([0.2, 0.1, 0.4, 0.5, 0.9, -0.3]), np.array([-0.3, 0.2, 0.5, -0.6, -1.0, 0.4])

    def seen(offset_px: np.ndarray, cam_from_anchor: np.ndarray, twist: np.ndarray, of: int) -> np.ndarray:
        d, view = offset_px / P.f_px, np.zeros(4)
        point = cam_from_anchor @ np.array([*(RAY + d), 1, RHO + d @ SLOPES])
        for _ in range(8):
            moved = se3.exp(readout_s * rows(view[None])[0, 2 * of] * twist) @ point
            view = P.project_homogeneous(moved[None])[0]
        return view[2 * of : 2 * of + 2]

    offsets = step_px * np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]])
    by_offset = [
        np.stack([(seen(a, *at) - seen(b, *at)) / (2 * step_px) for a, b in (offsets[:2], offsets[2:])], axis=1)
        for at in ((np.eye(4), then, 0), (CAM_FROM_ANCHOR, now, side))
    ]
    expected = by_offset[0] @ np.linalg.inv(by_offset[1])
    anchor = np.array([[*RAY, 1, RHO]])
    tracks = track(velocities(P, anchor, then)[0, :2])
    found, unsheared = warps(tracks, timing, now)[side], warps(tracks, replace(timing, mean=np.zeros(2)), now)[side]
    assert np.abs(found[:2] - expected).max() < 0.25 * np.abs(unsheared[:2] - expected).max()


@pytest.mark.parametrize("axis", [(0, 1, 0), (1, 0, 0), (0, 0, 1), (0.6, 0.7, 0.4)], ids=str)
def test_a_turn_in_front_of_a_slanted_wall_is_no_sideways_step(axis: tuple[float, float, float]) -> None:
    """The NEES of the pose is 6 as expected; with affine warps it is 70 to 160.

    Frames share the error of the first one, so that a run's mean scatters like that of few samples: between 2 and 12.
    """
    wall, stereo = Wall(2), rig(0.02, 480, 360)
    engine, squares = Engine(stereo, Config()), []
    for i in range(20):
        pose = np.eye(4)
        pose[:3, :3] = se3.exp_so3(0.16 * np.sin(0.12 * i) * np.array(axis))
        estimate = engine.step(wall.frame(stereo, pose, i))
        if i:
            squares.append(nees(estimate.world_from_cam, estimate.cov_pose, pose))
    assert np.mean(squares) < 12
