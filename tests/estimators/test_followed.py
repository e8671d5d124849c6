"""The reported pose in the world, which continues by the newest motion and is pulled towards the filter's pose."""

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.config import Config, WindowConfig
from stream_sfm.config.rules import Rules
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.triangulation import points_to_world
from stream_sfm.estimators.window.cross_frame import CrossFrame
from stream_sfm.estimators.window.reported.followed import followed
from stream_sfm.estimators.window.reported.marginals import Marginals
from stream_sfm.estimators.window.reported.relative import newest_motion
from stream_sfm.estimators.window.reported.rules import ReportedRules
from stream_sfm.geometry import se3
from stream_sfm.record import changed
from stream_sfm.simulation.scenes import Scene

SCENE = Scene(frames=30, track_length=8, visible=80, std_px=0.1, round_off=False, autocorrelation=0.75)
B = 8
MOST = ReportedRules().most_followed
MOTION = se3.exp(np.array([0.02, -0.01, 0.2, 0.01, 0.03, -0.02]))
STD = np.array([0.01, 0.02, 0.03, 0.002, 0.003, 0.001])


@pytest.fixture(scope="module")
def some() -> Marginals:
    """Marginals of a map, with σ of the newest pose STD."""
    sequence = Scene(frames=2).sequence(np.random.SeedSequence(3))
    estimator = make_estimator("cross-frame", sequence.projection, Config())
    for o in sequence.observations:
        estimator.step(o)
    assert isinstance(estimator, CrossFrame) and estimator.map is not None
    return changed(estimator.map.marginals, cov_pose=np.diag(STD**2))


def at(of: Marginals, pose: np.ndarray) -> Marginals:
    """The marginals of another pose of the filter."""
    return changed(of, world_from_cam=pose, points_in_world=se3.transform(pose, of.points_in_cam))


def test_uncertainty_of_the_pose_adds_to_the_points_seen_from_it(some):
    """Covariances of points grow as in eq. (6) for points seen from an uncertain pose, and stay symmetric."""
    root = np.random.default_rng(1).normal(size=(6, 6)) * STD[:, None]
    pose = some.world_from_cam
    widened = core.widened_points(some.points_in_cam, some.cov_points_in_world, pose, root @ root.T)
    _, by_pose = points_to_world(pose, root @ root.T, some.points_in_cam, np.zeros_like(some.cov_points))
    assert widened == pytest.approx(some.cov_points_in_world + by_pose, rel=1e-9, abs=1e-15)
    assert np.array_equal(widened, np.swapaxes(widened, 1, 2))


def from_filter(reported: Marginals, pose: np.ndarray) -> np.ndarray:
    return np.asarray(se3.log(se3.inverse(reported.world_from_cam) @ pose))


def test_a_constant_bias_of_motions_adds_up_over_one_window_only(some):
    """A bias of every motion, small against σ, moves the reported pose by b − 1 times the bias, and no farther."""
    bias, pose = 1e-3 * STD, some.world_from_cam
    reported, distances = some, []
    for _ in range(200):
        pose = se3.orthonormalise(pose @ se3.exp(bias))
        reported = followed(reported, at(some, pose), np.eye(4), B, MOST)
        distances.append(from_filter(reported, pose))
    assert np.linalg.norm(distances, axis=1) == pytest.approx(
        np.linalg.norm(bias) * (B - 1) * (1 - (1 - 1 / B) ** np.arange(1, 201)), rel=1e-3
    )


@pytest.mark.parametrize("size", [0.3, 3.0, 300.0])
def test_it_is_never_beyond_half_of_the_filters_own_sigma(some, size):
    """So a large correction of the path is reported at once, and the pose does not jump by σ later."""
    rng, reported = np.random.default_rng(5), some
    for _ in range(50):
        pose = some.world_from_cam @ se3.exp(size * STD * rng.normal(size=6) / 6)
        now = at(some, pose)
        reported = followed(reported, now, np.eye(4), B, MOST)
        assert np.linalg.norm(from_filter(reported, pose) / STD) < MOST + 1e-9


def test_it_is_exact_if_the_filter_agrees_with_the_motion(some):
    pose, reported = some.world_from_cam, some
    for _ in range(5):
        pose = se3.orthonormalise(pose @ MOTION)
        reported = followed(reported, at(some, pose), MOTION, B, MOST)
    assert reported.world_from_cam == pytest.approx(pose, abs=1e-9)


def test_a_window_of_one_frame_reports_the_filter(some):
    pose = some.world_from_cam @ se3.exp(0.5 * STD)
    reported = followed(some, at(some, pose), np.eye(4), 1, MOST)
    assert reported.world_from_cam == pytest.approx(pose, abs=1e-12)


def test_the_covariance_is_that_of_the_pose_reported(some):
    """Monte Carlo: the change of the filter's pose is independent of its remaining error."""
    rng, squares = np.random.default_rng(6), []
    for _ in range(400):
        reported, pose = some, some.world_from_cam
        for _ in range(12):
            pose = se3.orthonormalise(pose @ MOTION @ se3.exp(0.2 * STD * rng.normal(size=6)))
            reported = followed(reported, at(some, pose), MOTION, B, MOST)
        xi = from_filter(reported, pose @ se3.exp(STD * rng.normal(size=6)))
        squares.append(xi @ np.linalg.solve(reported.cov_pose, xi))
    assert np.mean(squares) == pytest.approx(6, abs=3 * np.std(squares) / 20)


def test_points_stay_where_they_are_in_the_camera(some):
    now = at(some, some.world_from_cam @ se3.exp(0.9 * STD))
    reported = followed(some, now, np.eye(4), B, MOST)
    assert (reported.points_in_cam == now.points_in_cam).all()
    in_world = se3.transform(reported.world_from_cam, reported.points_in_cam)
    assert reported.points_in_world == pytest.approx(in_world, abs=1e-9)
    more = reported.cov_points_in_world[now.finite] - now.cov_points_in_world[now.finite]
    assert (np.linalg.eigvalsh(more) > -1e-9 * np.abs(more).max()).all()


def apart_from_newest_motions(rules: ReportedRules) -> float:
    """Mean squared difference of the motion between two reported poses and the newest motion, in its σ."""
    sequence = SCENE.sequence(np.random.SeedSequence([8, 1]))
    estimator = make_estimator("cross-frame", sequence.projection, Config(rules=Rules((rules,))))
    before, found = np.eye(4), []
    for o in sequence.observations:
        solution = estimator.step(o)
        pose = solution.world_from_cam
        assert solution.window_world_from_cam[-1] == pytest.approx(pose, abs=1e-9)
        in_world = se3.transform(pose, solution.points_in_cam)
        assert solution.points_in_world == pytest.approx(in_world, abs=1e-6)
        if solution.relative is not None:
            apart = se3.log(solution.relative.frame_from_newest[-1] @ se3.inverse(pose) @ before)
            found.append(apart @ np.linalg.solve(solution.relative.cov[-1], apart))
        before = pose
    return float(np.mean(found))


def test_reported_poses_move_by_the_newest_motions():
    """With correlated errors in simulation they do so more closely than poses of the filter, and all outputs agree."""
    of_filter = apart_from_newest_motions(ReportedRules(most_followed=0.0))
    assert apart_from_newest_motions(ReportedRules()) < of_filter / 2


def test_an_unreliable_motion_is_not_followed():
    """The reported pose is then that of the filter, within half of σ of the followed one."""
    sequence = SCENE.sequence(np.random.SeedSequence([8, 2]))
    estimator = make_estimator("cross-frame", sequence.projection, Config(window=WindowConfig(frames=4)))
    assert isinstance(estimator, CrossFrame)
    for o in sequence.observations[:-1]:
        estimator.step(o)
    current = estimator.map
    assert current is not None
    of_filter = current.newest_marginals()
    start = at(of_filter, of_filter.world_from_cam @ newest_motion(current) @ se3.exp(0.01 * np.ones(6)))
    current = changed(current, read=start)
    sure, unsure = (estimator._with_marginals(current, current, each)[0].marginals for each in (False, True))
    assert unsure.world_from_cam == pytest.approx(of_filter.world_from_cam, abs=1e-12)
    apart = from_filter(sure, unsure.world_from_cam)
    assert 0 < apart @ np.linalg.solve(unsure.cov_pose, apart) < 0.26
