"""Odometry is continuous: the chain of the motions between frames, with σ and velocity; corrections stay out of it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import stream_sfm as sfm
from stream_sfm.config import RigConfig
from stream_sfm.geometry import se3
from stream_sfm.motion import Odometry
from stream_sfm.types import CommonErrors, FrameEstimate, RelativeMotions
from tests.helpers.places import ROOM
from tests.results.test_estimates import estimate

Array = NDArray[np.float64]
PERIOD_S = 0.1  # of `estimate`
STEP = se3.exp([0.02, 0.0, 0.1, 0.0, 0.05, 0.01])


def frame(i: int, world_from_cam: Array, motion: Array | None, cov: Array, **fields: object) -> FrameEstimate:
    """An estimate with the motion to the frame before, and to one that is not asked for."""
    relative = None
    if motion is not None:
        wrong = np.full((4, 4), np.nan)
        relative = RelativeMotions(np.array([i - 2, i - 1]), np.stack([wrong, motion]), np.stack([cov, cov]))
    return replace(estimate(i), world_from_cam=world_from_cam, relative=relative, **fields)


def run(estimates: list[FrameEstimate]) -> list[Odometry]:
    """The odometry of each frame."""
    odometry: list[Odometry] = []
    for one in estimates:
        odometry.append(Odometry.after(odometry[-1] if odometry else None, one))
    return odometry


def test_it_is_the_chain_of_motions_and_corrections_are_beside_it() -> None:
    """The world is corrected twice, also where tracking was lost: each time world_from_odom moves by just that."""
    rng = np.random.default_rng(3)
    motions = [STEP @ se3.exp(0.01 * rng.normal(size=6)) for _ in range(12)]
    corrections = {4: se3.exp(0.1 * rng.normal(size=6)), 9: se3.exp(0.1 * rng.normal(size=6))}
    correction, chain = np.eye(4), np.eye(4)
    estimates, chains = [frame(0, np.eye(4), None, np.eye(6))], [chain]
    for i, motion in enumerate(motions, 1):
        correction = corrections.get(i, np.eye(4)) @ correction
        chain = chain @ motion
        estimates.append(frame(i, correction @ chain, None if i == 6 else motion, 1e-6 * np.eye(6)))
        chains.append(chain)
    found = run(estimates)
    known = np.eye(4)
    for i, odometry in enumerate(found):
        assert np.allclose(odometry.odom_from_cam, chains[i], atol=1e-12)
        product = odometry.world_from_odom @ odometry.odom_from_cam
        assert np.allclose(product, estimates[i].world_from_cam, atol=1e-12)
        moved = odometry.world_from_odom @ se3.inverse(known)
        assert np.allclose(moved, corrections.get(i, np.eye(4)), atol=1e-12)
        known = odometry.world_from_odom
    assert [i for i, odometry in enumerate(found) if odometry.twist is None] == [0, 6]


def test_without_motions_it_is_the_path_itself() -> None:
    """A method that has no covariances of motions: a filter."""
    found = run([replace(estimate(i), relative=None) for i in range(8)])
    for i, odometry in enumerate(found):
        assert np.allclose(odometry.odom_from_cam, estimate(i).world_from_cam, atol=1e-12)
        assert np.allclose(odometry.cov, estimate(i).cov_pose, atol=1e-15)
        assert odometry.twist is None and odometry.cov_twist is None


def test_its_covariance_and_that_of_the_velocity_are_those_of_its_errors() -> None:
    """Monte Carlo: every frame measures the common errors c once more, and is estimated with what it knows of them."""
    rng, trials, frames, m = np.random.default_rng(5), 4000, 10, 3
    j = np.concatenate([1e-3 * rng.normal(size=(6, m))])
    cov_own = np.diag(np.repeat([1e-6, 1e-8], 3))
    c = rng.normal(size=(trials, m))
    mean, cov_c = np.zeros((trials, m)), np.eye(m)
    errors, twists, found = np.zeros((trials, 6)), np.empty((trials, 6)), []
    for i in range(1, frames):
        gain = cov_c @ np.linalg.inv(cov_c + 4 * np.eye(m))
        mean = mean + (c + 2 * rng.normal(size=(trials, m)) - mean) @ gain.T
        cov_c = cov_c - gain @ cov_c
        step = (c - mean) @ j.T + rng.multivariate_normal(np.zeros(6), cov_own, trials)
        errors = errors @ se3.adjoint(se3.inverse(STEP)).T + step
        cov = cov_own + j @ cov_c @ j.T
        relative = RelativeMotions(np.array([i - 1]), STEP[None], cov[None], j[None])
        common = CommonErrors(mean[0], cov_c, np.zeros((6, m)))
        found.append(replace(estimate(i), relative=relative, common=common))
        twists = se3.log(STEP @ se3.exp(step)) / PERIOD_S
    last = run([replace(estimate(0), cov_pose=np.zeros((6, 6))), *found])[-1]
    assert last.twist is not None and last.cov_twist is not None
    for sample, expected in ((errors, last.cov), (twists - last.twist, last.cov_twist)):
        scale = np.sqrt(np.diag(expected))
        difference = (sample.T @ sample / trials - expected) / np.outer(scale, scale)
        assert abs(difference).max() < 5 * np.sqrt(2 / trials)  # standard errors of a variance


def test_on_a_recording_velocities_and_the_end_are_the_true_ones_within_their_covariances() -> None:
    """Against finite differences of the truth; 24 frames of 6 numbers that are not all independent.

    With the calibration taken for what it is in a rendered log, exact: else σ is of errors that are not there.
    """
    log = sfm.open_log(ROOM)
    engine = sfm.Engine(log.rig, sfm.Config(rig=RigConfig(exact=True)))
    found, truth = run([engine.step(f) for f in log.frames(sfm.Selection(max_frames=25))]), log.ground_truth()
    assert truth is not None
    assert [odometry.estimate.stamp_ns for odometry in found] == truth.stamps_ns[: len(found)].tolist()
    squares = []
    for i in range(1, len(found)):
        moved = se3.log(se3.inverse(truth.world_from_cam[i - 1]) @ truth.world_from_cam[i]) / found[i].seconds
        assert found[i].twist is not None and found[i].cov_twist is not None
        error = found[i].twist - moved
        squares.append(error @ np.linalg.solve(found[i].cov_twist, error))
        assert np.linalg.norm(moved[:3]) > 20 * np.linalg.norm(error[:3])  # it moves, so σ alone cannot pass
    assert 1 < np.mean(squares) < 12  # 6 expected
    end = se3.inverse(truth.world_from_cam[0]) @ truth.world_from_cam[len(found) - 1]
    error = se3.log(se3.inverse(found[-1].odom_from_cam) @ end)
    assert error @ np.linalg.solve(found[-1].cov, error) < 20  # beyond 99.7 % of six
