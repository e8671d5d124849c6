"""What the front-end measures, against exact images of a wall."""

import numpy as np
import pytest

from stream_sfm.core import match_along_rows
from stream_sfm.frontend.corners import corner_strength, detect
from stream_sfm.geometry import se3
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.wall import Wall, camera_path, rig


def test_detect_covers_evenly_and_keeps_its_distance() -> None:
    image = Wall(1).image(rig().left, np.eye(4))
    taken = np.array([[50.0, 60.0], [200.0, 100.0]])
    corners = detect(corner_strength(image), taken, np.ones(image.shape, bool), 80, 10.0, 1e-5)
    every = np.concatenate([taken, corners])
    gap = np.linalg.norm(every[:, None] - every[None], axis=2) + 1e9 * np.eye(len(every))
    assert gap.min() > 9.0
    quarters = [((corners[:, 0] < 160) == a) & ((corners[:, 1] < 120) == b) for a in (0, 1) for b in (0, 1)]
    assert min(q.sum() for q in quarters) > 0.15 * len(corners)
    assert len(detect(corner_strength(image), taken, np.zeros(image.shape, bool), 80, 10.0, 1e-5)) == 0


def test_row_search_finds_shifts_and_refuses_repetition() -> None:
    image = Wall(2).image(rig().left, np.eye(4))
    points = np.array([[150, 100], [200, 60], [120, 180]])
    found, unique = match_along_rows(image, np.roll(image, -17, axis=1), points, 0, 60)
    assert unique.all() and (found == 17).all()
    stripes = np.tile(np.array([0] * 8 + [200] * 8, np.uint8), (240, 20))
    assert not match_along_rows(stripes, stripes, points, -5, 60)[1].any()


@pytest.mark.parametrize("vergence_rad", [0.0, 0.05])
def test_views_stay_on_their_point_without_drifting(vergence_rad: float) -> None:
    """After 20 frames a view is where the point of its first frame is; its covariance says how far it may be off."""
    stereo, wall, poses = rig(vergence_rad), Wall(3), camera_path(20)
    front = SteppedFrontEnd(stereo)
    rectifier = front.rectifier
    c = np.eye(4)
    c[:3, :3] = rectifier.rect_from_cam
    normal, origin = wall.world_from_wall[:3, 2], wall.world_from_wall[:3, 3]
    born: dict[int, np.ndarray] = {}
    errors, squares = [], []
    for n, pose in enumerate(poses):
        observations = front.step(wall.frame(stereo, pose, n))
        world_from_rect = pose @ c.T
        p = rectifier.projection
        for i, z, cov in zip(observations.track_ids, observations.z_px, observations.cov_px, strict=True):
            if int(i) not in born:
                ray = world_from_rect[:3, :3] @ [(z[0] - p.cx_left_px) / p.f_px, (z[1] - p.cy_px) / p.f_px, 1]
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
