"""Robust resection: its covariance against Monte Carlo, its breakdown against planted outliers."""

import numpy as np
import pytest
from scipy.stats import chi2

from stream_sfm.geometry import se3
from stream_sfm.geometry.point_views import PointViews
from stream_sfm.geometry.resection import Resection, combined, judged, refine, resect
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.estimators import nees

P = StereoProjection(620.0, 255.0, 255.0, 240.0, 0.25, 512, 480)
STD_PX = 0.3


def problem(seed: int, n: int, outliers: float = 0.0, mono: float = 0.0):
    """A motion; points with covariances and their views with covariances; which of these are outliers."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(2, 6, n)
    uv = np.stack([rng.uniform(0, 512, n), rng.uniform(0, 480, n)], axis=1)
    points = np.c_[(uv - (255, 240)) / 620 * depth[:, None], depth]
    cam_from_ref = se3.exp(rng.normal(size=6) * (0.1, 0.1, 0.1, 0.03, 0.03, 0.03))
    first = P.triangulate(P.project(points) + rng.normal(size=(n, 4)) * STD_PX)
    a = P.jacobian(first)
    cov_points = np.linalg.inv(np.swapaxes(a, 1, 2) @ a / STD_PX**2)
    z = P.project(se3.transform(cam_from_ref, points)) + rng.normal(size=(n, 4)) * STD_PX
    bad = rng.random(n) < outliers
    z[bad] += rng.normal(size=(int(bad.sum()), 4)) * 20
    z[rng.random(n) < mono, 2:] = np.nan
    return cam_from_ref, (first, cov_points, z, np.broadcast_to(STD_PX**2 * np.eye(4), (n, 4, 4))), bad


def resected(views: tuple, start: np.ndarray, **given) -> Resection:
    return resect(PointViews(P, *views), start, **given)


def error_of(found: Resection, truth: np.ndarray) -> np.ndarray:
    return se3.log(truth @ se3.inverse(found.cam_from_ref))


@pytest.mark.parametrize("mono", [0.0, 0.5])
def test_covariance_is_consistent(mono: float) -> None:
    trials = 150
    squares = []
    for seed in range(trials):
        truth, views, _ = problem(seed, 60, mono=mono)
        found = resected(views, np.eye(4))
        squares.append(nees(se3.inverse(found.cam_from_ref), found.cov_pose, se3.inverse(truth)))
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 6 * trials) / trials
    # the gate keeps 0.999 of good views and the finish is linearised: a few percent beyond pure statistics
    assert low * 0.95 < np.mean(squares) < high * 1.05


def test_two_motions_are_combined_as_their_covariances_say() -> None:
    trials, std_change = 150, np.array([0.004, 0.004, 0.004, 0.001, 0.001, 0.001])
    squares, shrunk = [], []
    for seed in range(trials):
        truth, views, _ = problem(seed, 12)
        change = np.random.default_rng([seed, 1]).normal(size=6) * std_change
        found = resected(views, truth)
        both = combined(found, se3.exp(change) @ truth, np.diag(std_change**2))
        squares.append(nees(se3.inverse(both.cam_from_ref), both.cov_pose, se3.inverse(truth)))
        shrunk.append(np.trace(both.cov_pose) / np.trace(found.cov_pose))
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 6 * trials) / trials
    assert low * 0.95 < np.mean(squares) < high * 1.05
    assert np.mean(shrunk) < 0.8  # so that both matter


def test_a_motion_of_some_views_is_judged_by_all() -> None:
    truth, views, bad = problem(5, 80, outliers=0.2)
    every, some = PointViews(P, *views), np.arange(80) % 2 == 0
    weights = np.random.default_rng(5).uniform(1, 2, 80)
    found = resect(every.select(some), truth)
    of_all = judged(found, every, weights)
    assert (of_all.cam_from_ref == found.cam_from_ref).all()
    assert (of_all.accepted[some] == found.accepted).all()
    assert not (of_all.accepted & bad).any() and of_all.accepted[~bad].mean() > 0.9
    assert np.isclose(of_all.share, weights[of_all.accepted].sum() / weights.sum(), rtol=1e-12)
    assert of_all.dof == 4 * np.count_nonzero(of_all.accepted)


def test_a_shared_error_is_sought_from_where_it_begins() -> None:
    """Half of the views have an error of 30 σ, the others none: each half is found from its own amplitude."""
    truth, (points, cov_points, z, cov), _ = problem(3, 60)
    shared = np.zeros((60, 4, 1))
    shared[:, 2:, 0] = STD_PX, -STD_PX
    moved, amplitude = np.arange(60) < 30, np.array([30.0])
    z = z + moved[:, None] * (shared @ amplitude)
    views = PointViews(P, points, cov_points, z, cov, shared=shared)
    for start, expected in ((np.zeros(1), ~moved), (amplitude, moved)):
        found = resect(views, truth, start_is_close=True, start_is_decided=True, find_second=False, amplitudes=start)
        assert (found.accepted == expected).mean() > 0.9
        assert abs(found.amplitudes[0] - start[0]) < 3  # points err as well, and the prior draws by 1.7 to zero


def test_shared_errors_are_columns_of_one_least_squares_problem() -> None:
    """One of the right side, as a delay, and one like a turn.

    At the motion found, gradient and covariance are those of all views with a prior of σ = 1, written out.
    """
    _, (points, cov_points, z, cov), _ = problem(3, 60)
    shared = np.zeros((60, 4, 2))
    shared[:, 2, 0] = 1.5
    shared[:, 0, 1] = shared[:, 2, 1] = 0.01 * (z[:, 0] - 255)
    views = points, cov_points, z + shared @ np.random.default_rng(1003).normal(size=2), cov
    found = resect(PointViews(P, *views, shared=shared), np.eye(4))
    points, cov_points, z, cov = (x[found.accepted] for x in views)
    r = found.cam_from_ref[:3, :3]
    in_cam = se3.transform(found.cam_from_ref, points)
    by_point = P.jacobian(in_cam) @ r
    roots = np.linalg.inv(np.linalg.cholesky(cov + by_point @ cov_points @ np.swapaxes(by_point, 1, 2)))

    def residual(x: np.ndarray) -> np.ndarray:
        moved = P.project(se3.transform(se3.exp(x[:6]) @ found.cam_from_ref, points))
        a = found.amplitudes + x[6:]
        off = z - moved - shared[found.accepted] @ a
        return np.concatenate([(roots @ off[..., None]).ravel(), -a])

    j = np.stack([(residual(-h) - residual(h)) / 2e-6 for h in 1e-6 * np.eye(8)], axis=1)
    joint = np.linalg.inv(j.T @ j)
    scale = np.sqrt(np.diag(joint))
    step = joint @ j.T @ residual(np.zeros(8))
    assert np.abs(step / scale).max() < 0.1  # iterations end at a tenth of σ
    # of ref_from_cam on the right: the same as of cam_from_ref on the left, except for the sign
    assert np.abs((found.cov_pose - joint[:6, :6]) / np.outer(scale[:6], scale[:6])).max() < 1e-2
    assert np.abs((found.cov_amplitudes - joint[6:, 6:]) / np.outer(scale[6:], scale[6:])).max() < 1e-2


@pytest.mark.parametrize("outliers", [0.2, 0.5])
def test_outliers_are_found_and_do_no_harm(outliers: float) -> None:
    for seed in range(20):
        truth, views, bad = problem(seed, 100, outliers)
        found = resected(views, np.eye(4))
        assert found.ok
        assert found.accepted[bad].mean() < 0.05  # some errors of 20 px are small ones
        assert found.accepted[~bad].mean() > 0.95  # the gate keeps 0.999, the start costs some
        assert np.linalg.norm(error_of(found, truth)[:3]) < 0.02  # m: some σ with half of the views


def test_from_a_close_start_noise_of_twice_its_size_is_not_a_reason_to_search() -> None:
    truth, (points, cov_points, z, cov), _ = problem(1, 80)
    ordinary = resected((points, cov_points, z, cov), np.eye(4))
    views = PointViews(P, points, cov_points / 4, z, cov / 4)
    found = resect(views, truth, start_is_close=True)
    near = refine(views, np.ones(80), truth, np.zeros(0))
    assert np.array_equal(found.cam_from_ref, near.cam_from_ref)  # a search would lead elsewhere
    assert not np.array_equal(found.cam_from_ref, resect(views, truth).cam_from_ref)
    assert found.ok and found.share < 0.8  # less than what ends a search from any other start
    assert nees(se3.inverse(found.cam_from_ref), ordinary.cov_pose, se3.inverse(truth)) < chi2.ppf(0.999, 6)


def test_a_close_start_that_the_views_contradict_is_left() -> None:
    _, views, _ = problem(1, 80, outliers=0.4)
    start = se3.exp([0.5, -0.4, 0.8, 0.2, -0.5, 0.3])
    found, ordinary = resected(views, start, start_is_close=True), resected(views, start)
    assert np.array_equal(found.cam_from_ref, ordinary.cam_from_ref) and found.ok


def test_points_at_infinity_fix_the_rotation_only() -> None:
    truth = se3.exp([0, 0, 0, 0.01, -0.02, 0.03])
    rng = np.random.default_rng(0)
    far = np.c_[rng.uniform(-0.4, 0.4, (50, 2)), np.ones(50), np.zeros(50)]
    z = P.project_homogeneous(far @ truth.T)
    found = resected((far, None, z, np.broadcast_to(np.eye(4), (50, 4, 4))), np.eye(4))
    assert np.allclose(found.cam_from_ref[:3, :3], truth[:3, :3], atol=1e-9)
    assert not found.ok  # the translation is not determined, and that is said


def test_too_few_views_are_refused() -> None:
    truth, views, _ = problem(0, 5)
    assert not resected(views, truth).ok


def crowd(seed: int, cover: float, bodies: int, mono: float = 0.0, left: bool = False):
    """160 views, a share `cover` of them on `bodies` that move by themselves: in the middle, or in the `left` part."""
    truth, (points, cov_points, z, cov), _ = problem(seed, 160, mono=mono)
    rng = np.random.default_rng(1000 + seed)
    body = np.full(160, -1)
    x, y = (points[:, i] / points[:, 2] for i in (0, 1))
    on_bodies = np.argsort(x if left else np.hypot(x, y))[: round(160 * cover)]
    on_bodies = on_bodies[np.argsort(x[on_bodies])]
    for k, rows in enumerate(np.array_split(on_bodies, bodies)):
        own = se3.exp(rng.normal(size=6) * (0.15, 0.15, 0.15, 0.05, 0.05, 0.05))
        moved = P.project(se3.transform(truth @ own, points[rows]))
        z[rows] = np.where(np.isnan(z[rows]), np.nan, moved + rng.normal(size=(len(rows), 4)) * STD_PX)
        body[rows] = k
    return truth, (points, cov_points, z, cov), body


@pytest.mark.parametrize("mono", [0.0, 1.0])
def test_the_largest_rigid_set_is_found_from_any_start_among_sixty_percent_of_movers(mono: float) -> None:
    for seed in range(12):
        truth, views, body = crowd(seed, 0.6, bodies=3, mono=mono)
        rng = np.random.default_rng(seed)
        start = se3.exp(rng.normal(size=6) * (0.5, 0.5, 0.5, 0.3, 0.3, 0.3))
        found = resected(views, start)
        # the noise of the largest set alone, 64 views: some millimetres, some tenths of a milliradian
        alone = resected(tuple(x[body < 0] for x in views), truth)
        std = np.sqrt(np.diag(alone.cov_pose))
        assert found.ok and found.accepted[body < 0].mean() > 0.95  # as above
        assert (np.abs(error_of(found, truth)) < 6 * std).all()
        assert np.array_equal(resected(views, start).cam_from_ref, found.cam_from_ref)


def test_history_decides_between_two_rigid_sets() -> None:
    """A body with 70 % of the views against a background that has been rigid with the map for long."""
    for seed in range(10):
        _, views, body = crowd(seed, 0.7, bodies=1)
        found = resected(views, np.eye(4), weights=np.where(body < 0, 10.0, 0.1))
        assert found.accepted[body < 0].mean() > 0.95 and found.accepted[body == 0].mean() < 0.3  # as above
        assert found.ambiguous is None


def test_two_rigid_sets_side_by_side_are_ambiguous() -> None:
    for seed in range(10):
        _, views, body = crowd(seed, 0.5, bodies=1, left=True)
        found = resected(views, np.eye(4))
        assert found.ambiguous is not None
        apart = []
        for of in (body == 0, body < 0):
            alone = resected(tuple(x[of] for x in views), np.eye(4))
            both = found.cam_from_ref, found.ambiguous.cam_from_ref
            apart.append([np.linalg.norm(error_of(alone, motion)) for motion in both])
        assert min(apart[0]) < 0.02 and min(apart[1]) < 0.02  # m and rad: some σ of half of the views
        assert np.argmin(apart[0]) != np.argmin(apart[1])


def test_corners_that_crowd_in_one_place_have_one_vote() -> None:
    """A body with 75 % of the views in a twentieth of the image, history for neither: the rest is the background."""
    for seed in range(10):
        truth, (points, cov_points, z, cov), _ = problem(seed, 160)
        on_body = np.arange(160) < 120
        rng = np.random.default_rng(seed)
        rays = np.stack([rng.uniform(0.1, 0.3, 120), rng.uniform(-0.1, 0.1, 120), np.ones(120)], axis=1)
        points[:120] = rays * points[:120, 2:]
        moved = P.project(se3.transform(truth @ se3.exp([0.1, 0.02, 0, 0, 0.02, 0]), points[:120]))
        z[:120] = moved + rng.normal(size=(120, 4)) * STD_PX
        found = resected((points, cov_points, z, cov), truth)
        assert found.accepted[~on_body].mean() > 0.95 and found.accepted[on_body].mean() < 0.1
        assert found.second is not None and found.second.views[on_body].mean() > 0.9
        assert found.second.odds < 0.5


def test_scattered_outliers_are_no_second_motion() -> None:
    for seed in range(10):
        _, views, _ = problem(seed, 160, outliers=0.6)
        assert resected(views, np.eye(4)).ambiguous is None


def test_a_distant_point_next_to_the_camera_plane_predicts_nothing() -> None:
    """A trial motion that turns a point of 75 m out of view predicts its view to 1e11 px."""
    truth, (points, cov_points, z, cov), _ = problem(2, 60)
    points[0], cov_points[0] = [-14.0, -3.0, 75.5], np.diag([6e-4, 7e-4, 250.0])
    views = PointViews(P, points, cov_points, z, cov)
    turned = se3.exp(np.array([0, 0, 0, 0.6, 1.8, 0.0]))
    turned[2, 3] = 2e-3 - turned[2, :3] @ points[0]  # just in front
    root, jacobian = views.linearise(turned)
    assert not root[0].any() and not jacobian[0].any()
    assert views.squared_residuals(truth, root)[0] == np.inf
    root, _ = views.linearise(truth)
    assert root.any(axis=(1, 2)).all()
