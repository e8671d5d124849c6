"""Halves of the views separate a near body from a far background, although one motion between theirs fits both."""

from dataclasses import replace

import numpy as np

from stream_sfm.geometry import se3
from stream_sfm.geometry.point_views import PointViews
from stream_sfm.geometry.resection import Resection, resect
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.estimators import nees

P = StereoProjection(f_px=170, cx_left_px=160, cx_right_px=160, cy_px=90, baseline_m=0.12, width=320, height=180)
STD_PX = 0.15
TRUTH = se3.exp([0.002, 0, -0.009, 0, 0.002, 0])


def seen(seed: int, body_moves_m: float) -> tuple[PointViews, np.ndarray, Resection]:
    """Views of 40 points 5 m away and of 18 in the middle at 2 m, which of them are there, and what resection says."""
    rng, on_body = np.random.default_rng(seed), np.arange(58) >= 40
    place = rng.uniform([0.05, 0.1], [0.95, 0.9], (58, 2))
    place[on_body] = rng.uniform([0.45, 0.1], [0.65, 0.9], (18, 2))
    depth_m = np.where(on_body, rng.uniform(1.8, 2.2, 58), rng.uniform(4.5, 5.5, 58))
    rays = np.column_stack([P.rays(place * [320, 180]), np.ones(58)])
    points = rays * depth_m[:, None]
    now = np.where(on_body[:, None], points + np.array([body_moves_m, 0, 0]), points)
    z_px = P.project(se3.transform(TRUTH, now)) + rng.normal(size=(58, 4)) * STD_PX
    first_px = P.project(points) + rng.normal(size=(58, 4)) * STD_PX
    rho = P.inverse_depth(first_px)
    before = np.column_stack([P.rays(first_px), np.ones(58), rho])
    cov_points = np.zeros((58, 4, 4))
    cov_points[:, [0, 1], [0, 1]] = (STD_PX / P.f_px) ** 2
    cov_points[:, 3, 3] = 2 * (STD_PX / (P.f_px * P.baseline_m)) ** 2
    cov_px = np.broadcast_to(STD_PX**2 * np.eye(4), (58, 4, 4))
    views = PointViews(P, before, cov_points, z_px, cov_px)
    return views, on_body, resect(views, np.eye(4))


def test_a_body_that_takes_the_background_along_is_left_out() -> None:
    taken_along = 0
    for seed in range(20):
        views, on_body, found = seen(seed, -0.025)
        rigid = resect(views, np.eye(4), predicted=np.eye(4))
        taken_along += int(found.accepted[on_body].mean() > 0.5)
        assert rigid.accepted[on_body].mean() < 0.5 and rigid.accepted[~on_body].mean() > 0.9
        assert nees(se3.inverse(rigid.cam_from_ref), rigid.cov_pose, se3.inverse(TRUTH)) < 40  # P < 1e-6
        second = rigid.second
        assert second is not None and second.views[on_body].all()
        of_body = TRUTH @ se3.exp([-0.025, 0, 0, 0, 0, 0])  # not the motion in between that all views agreed with
        assert nees(se3.inverse(second.cam_from_ref), second.cov_pose, se3.inverse(of_body)) < 40
    assert taken_along > 5  # otherwise nothing is tested


def test_the_motion_of_a_rigid_scene_is_that_of_all_views() -> None:
    for seed in range(40):
        views, _, found = seen(seed, 0.0)
        rigid = resect(views, np.eye(4), predicted=np.eye(4))
        assert np.array_equal(rigid.cam_from_ref, found.cam_from_ref) and rigid.second is None


def test_far_points_are_not_led_along_by_a_few_near_points_of_a_body() -> None:
    """Far points agree with any translation that a rotation makes up for, each within its gate."""
    p = replace(P, f_px=400)
    moves_m, n_body, led_along = 0.05, 6, 0
    for seed in range(20):
        rng, on_body = np.random.default_rng(seed), np.arange(76) >= 70
        place = np.where(on_body[:, None], rng.uniform(0.4, 0.6, (76, 2)), rng.uniform(0.05, 0.95, (76, 2)))
        depth_m = np.where(on_body, rng.uniform(1.9, 2.1, 76), rng.uniform(10, 13, 76))
        rays = np.column_stack([p.rays(place * [320, 180]), np.ones(76)])
        points = rays * depth_m[:, None]
        now = np.where(on_body[:, None], points + np.array([moves_m, 0, 0]), points)
        z_px = p.project(now) + rng.normal(size=(76, 4)) * STD_PX
        before = np.column_stack([rays, 1 / depth_m])
        cov_points = np.zeros((76, 4, 4))
        cov_points[:, [0, 1], [0, 1]] = (STD_PX / p.f_px) ** 2
        cov_points[:, 3, 3] = 2 * (STD_PX / (p.f_px * p.baseline_m)) ** 2
        views = PointViews(p, before, cov_points, z_px, np.broadcast_to(STD_PX**2 * np.eye(4), (76, 4, 4)))
        of_body = se3.exp([moves_m, 0, 0, 0, -moves_m / 11.5, 0])  # a wall at 11.5 m hardly contradicts it
        votes = np.where(on_body, 1.0, 11.0)
        led_along += int(resect(views, of_body, votes).accepted[on_body].sum() >= n_body - 1)
        predicted = se3.exp([0.004, 0, -0.003, 0, 0, 0])
        found = resect(views, of_body, votes, predicted)
        assert not found.accepted[on_body].any() and found.accepted[~on_body].mean() > 0.9
        assert nees(se3.inverse(found.cam_from_ref), found.cov_pose, np.eye(4)) < 40  # P < 1e-6
    assert led_along > 5  # otherwise nothing is tested
