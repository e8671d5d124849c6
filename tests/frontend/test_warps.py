"""Warps of patches against the images of a plane, point by point, and what they are worth to a turning camera."""

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.config import Config
from stream_sfm.engine import Engine
from stream_sfm.frontend.tracks import Tracks
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.estimators import nees
from tests.helpers.wall import Wall, rig

P = StereoProjection(300.0, 160.0, 150.0, 120.0, 0.2, 320, 240)
CAM_FROM_ANCHOR = se3.exp([0.3, -0.1, -0.4, 0.1, -0.25, 0.15])
RAY, RHO, SLOPES = np.array([0.2, -0.1]), 0.4, np.array([0.15, -0.1])  # of the surface, in the anchor camera
OFFSETS_PX = np.stack(np.meshgrid(np.arange(-8, 9, 4.0), np.arange(-8, 9, 4.0)), axis=-1).reshape(-1, 2)


def images_of(offsets_px: np.ndarray) -> np.ndarray:
    """Views (n, 4) in the camera of surface points at offsets (n, 2) around the template's middle."""
    d = offsets_px / P.f_px
    anchor = np.concatenate([RAY + d, np.ones((len(d), 1)), (RHO + d @ SLOPES)[:, None]], axis=1)
    return P.project_homogeneous(anchor @ CAM_FROM_ANCHOR.T)


@pytest.mark.parametrize("side", [0, 1])
def test_a_warp_is_the_plane_s_exact_map(side: int) -> None:
    point = CAM_FROM_ANCHOR @ np.array([*RAY, 1, RHO])
    tracks = Tracks(
        ids=np.array([0]),
        slots=np.array([0]),
        left_px=np.zeros((1, 2)),
        cov_left_px=0.01 * np.eye(2)[None],
        points=(point / point[2])[None],
        var_rho=np.array([1e-6]),
        anchor_from_start=np.eye(4)[None],
        anchor_rays=RAY[None],
        slopes=SLOPES[None],
        scale=np.ones(1, np.int64),
        agreed=np.zeros(1, np.int64),
    )
    of_motion = np.eye(4), CAM_FROM_ANCHOR, np.zeros((1, 2)), np.array([False])
    warp = core.predict_tracks(P.pinholes, tracks.of_core, *of_motion)[3 + side][0]
    columns = slice(2 * side, 2 * side + 2)
    now_px = images_of(OFFSETS_PX)[:, columns] - images_of(np.zeros((1, 2)))[:, columns]
    back = (now_px @ warp[:2].T) / (1 + now_px @ warp[2])[:, None]
    assert np.abs(back - OFFSETS_PX).max() < 1e-9
    affine = now_px @ warp[:2].T
    assert np.abs(affine - OFFSETS_PX).max() > 0.05  # what the affine part alone would leave


@pytest.mark.parametrize("axis", [(0, 1, 0), (1, 0, 0), (0, 0, 1), (0.6, 0.7, 0.4)], ids=str)
def test_a_turn_in_front_of_a_slanted_wall_is_no_sideways_step(axis: tuple[float, float, float]) -> None:
    """NEES of the pose, 6 expected; with affine warps it is 70 to 160. Frames share the first one's error, so that a
    run's mean scatters like a χ²₆/6 of few degrees of freedom: between 2 and 12."""
    wall, stereo = Wall(2), rig(0.02, 480, 360)
    engine, squares = Engine(stereo, Config()), []
    for i in range(20):
        pose = np.eye(4)
        pose[:3, :3] = se3.exp_so3(0.16 * np.sin(0.12 * i) * np.array(axis))
        estimate = engine.step(wall.frame(stereo, pose, i))
        if i:
            squares.append(nees(estimate.world_from_cam, estimate.cov_pose, pose))
    assert np.mean(squares) < 12
