"""The measurements of the front-end, against exact images of a wall."""

import cv2
import numpy as np
import pytest

from stream_sfm.config import Config, FrontendConfig
from stream_sfm.core import corner_strength, match_along_rows, match_new_points, new_corners
from stream_sfm.frontend.alignment import TemplateAligner
from stream_sfm.frontend.learnt.rows import Rows
from stream_sfm.frontend.new_points import PointRules
from stream_sfm.frontend.state import RightSides
from stream_sfm.frontend.templates import TemplateAtlas
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.wall import Wall, camera_path, rig


def test_detect_covers_evenly_and_keeps_its_distance() -> None:
    image = Wall(1).image(rig().left, np.eye(4))
    taken = np.array([[50.0, 60.0], [200.0, 100.0]])
    corners = new_corners(corner_strength(image), np.ones(image.shape, bool), taken, 80, 10.0, 1e-5, PointRules())
    every = np.concatenate([taken, corners])
    gap = np.linalg.norm(every[:, None] - every[None], axis=2) + 1e9 * np.eye(len(every))
    assert gap.min() > 9.0
    quarters = [((corners[:, 0] < 160) == a) & ((corners[:, 1] < 120) == b) for a in (0, 1) for b in (0, 1)]
    assert min(q.sum() for q in quarters) > 0.15 * len(corners)
    assert (
        len(new_corners(corner_strength(image), np.zeros(image.shape, bool), taken, 80, 10.0, 1e-5, PointRules())) == 0
    )


@pytest.mark.parametrize("shape", [(1, 7), (9, 1), (3, 2), (30, 41)])
def test_strength_of_corners_is_that_of_opencv(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    expected = cv2.cornerMinEigenVal(image, 5)
    for same in (image, image.astype(np.float32)):
        np.testing.assert_allclose(corner_strength(same), expected, rtol=1e-5, atol=1e-6 * expected.max())


def test_row_search_finds_shifts_and_refuses_repetition() -> None:
    image = Wall(2).image(rig().left, np.eye(4))
    points = np.array([[150, 100], [200, 60], [120, 180]])
    found, unique = match_along_rows(image, np.roll(image, -17, axis=1), points, 0, 60, PointRules())
    assert unique.all() and (found == 17).all()
    stripes = np.tile(np.array([0] * 8 + [200] * 8, np.uint8), (240, 20))
    assert not match_along_rows(stripes, stripes, points, -5, 60, PointRules())[1].any()


def test_a_repetition_at_whole_pixels_does_not_lead_over_a_match_between_pixels() -> None:
    """Tiles of 20.5 px, 10.5 px apart in left and right: the repetition at 31 px correlates more than the match."""
    u, v = np.meshgrid(np.arange(200.0), np.arange(120.0))

    def tiles(shift_px: float) -> np.ndarray:
        waves = [np.cos(2 * np.pi * k * (u + shift_px) / 20.5 + 1.7 * k * k + 0.31 * k * v) for k in range(1, 5)]
        return np.rint(128 + 15 * np.sum(waves, axis=0)).astype(np.uint8)

    points = np.array([[100, 60], [111, 60], [120, 71]])
    found, unique = match_along_rows(tiles(0.0), tiles(10.5), points, 0, 45, PointRules())
    assert (found == 31).all() and not unique.any()
    found, unique = match_along_rows(tiles(0.0), tiles(10.5), points, 0, 25, PointRules())
    assert np.isin(found, (10, 11)).all() and unique.all()  # nothing repeats as near as that


def waves(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """An analytic texture: grey values of waves of 7 px and longer in all directions."""
    rng = np.random.default_rng(5)
    across, down, phase = rng.uniform(-0.9, 0.9, 40), rng.uniform(-0.9, 0.9, 40), rng.uniform(0, 6, 40)
    return 128 + 5 * np.cos(across * u[..., None] + down * v[..., None] + phase).sum(axis=-1)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.1, -0.07), (-0.12, 0.05)], ids=str)
def test_new_points_are_matched_on_slanted_surfaces(slope: tuple[float, float]) -> None:
    """Disparities d = 12 + a u + b v, and their slopes; a facing patch would miss them by more than 1 px at its rim."""
    (a, b), (u, v) = slope, np.meshgrid(np.arange(240.0), np.arange(160.0))
    left, right = (np.rint(waves(at, v)).astype(np.uint8) for at in (u, (u + 12 + b * v) / (1 - a)))
    corners = np.stack(np.meshgrid(range(100, 200, 20), range(40, 130, 15)), axis=2).reshape(-1, 2)
    slots, radius_px = np.arange(len(corners)), 10
    stored = TemplateAtlas.empty(len(corners), radius_px, of_bytes=True).stored(left, corners, slots).grey
    expected_px = corners - np.stack([12 + corners @ slope, np.zeros(len(corners))], axis=1)
    disparity_px = 12 + corners @ slope + np.random.default_rng(6).uniform(-0.7, 0.7, len(corners))
    p = StereoProjection(200.0, 120.0, 120.0, 80.0, 0.1, 240, 160)
    rows = Rows.unknown(p, Config())
    rows.mean[0] = 0.5  # px, the estimated row difference
    near = RightSides(rows, np.zeros(3), np.zeros(6)), corners, slots
    config = Config(frontend=FrontendConfig(window_radius_px=radius_px))
    kind, tolerances = TemplateAligner.empty(config, np.ones((160, 240), bool)), (2.0, PointRules())
    found, z_px, _, slopes, _ = match_new_points(left, right, stored, kind, *near, disparity_px, *tolerances)
    assert len(found) > 0.9 * len(corners)
    assert np.abs(z_px - np.concatenate([corners, expected_px], axis=1)[found]).max() < 0.03
    assert np.abs(slopes - slope).max() < 0.01
    far_px = disparity_px - 5.0
    assert len(match_new_points(left, right, stored, kind, *near, far_px, *tolerances)[0]) == 0


@pytest.mark.parametrize("vergence_rad", [0.0, 0.05])
def test_views_stay_on_their_point_without_drifting(vergence_rad: float) -> None:
    """After 20 frames a view is at the point of its first frame, within its covariance."""
    stereo, wall, poses = rig(vergence_rad), Wall(3), camera_path(20)
    front = SteppedFrontEnd(stereo)
    p, c = front.rectifier.projection, np.eye(4)
    c[:3, :3] = front.rectifier.rect_from_cam
    normal, origin = wall.world_from_wall[:3, 2], wall.world_from_wall[:3, 3]
    born: dict[int, np.ndarray] = {}
    errors, squares = [], []
    for n, pose in enumerate(poses):
        observations = front.step(wall.frame(stereo, pose, n))
        world_from_rect = pose @ c.T
        for i, z, cov in zip(observations.track_ids, observations.z_px, observations.cov_px, strict=True):
            if int(i) not in born:
                ray = world_from_rect[:3, :3] @ [*p.rays(z), 1]
                start = world_from_rect[:3, 3]
                born[int(i)] = start + ray * (normal @ (origin - start)) / (normal @ ray)
            elif n >= 10:
                error = z - p.project(se3.transform(se3.inverse(world_from_rect), born[int(i)][None]))[0]
                if np.isfinite(error).all():
                    errors.append(error)
                    squares.append(error @ np.linalg.solve(cov, error) / 4)
        assert observations.cam_from_previous is None or n > 0
    errors = np.array(errors)
    assert len(observations.track_ids) > 60
    # a bias of 0.02 px is a tenth of a tracked patch's deviation; 4 standard errors of correlated views beyond it
    assert (np.abs(np.median(errors, axis=0)) < 0.03).all()
    assert (1.4826 * np.median(np.abs(errors), axis=0) < 0.15).all()
    assert 0.1 < np.median(squares) < 10
