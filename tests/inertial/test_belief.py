"""Whether samples are believed: by evidence of many frames, for as long as it lasts."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.window.inertia.belief import Belief, Innovation, Steadiness
from stream_sfm.estimators.window.inertia.inertia import Inertia
from stream_sfm.estimators.window.inertia.interval import JOINT, Known
from stream_sfm.estimators.window.inertia.rules import InertiaRules
from stream_sfm.estimators.window.inertia.trial import beside, corrected
from stream_sfm.geometry import se3
from stream_sfm.inertial.state import GRAVITY, STATE
from stream_sfm.methods import REFERENCE
from stream_sfm.types import Ambiguity, ExpectedMotion
from tests.helpers.imu_views import FRAME_NS, PROJECTION, observed

RULES, STD_ACCELERATION = InertiaRules(), np.full(6, 3.0)
AGREES_RAD, CONTRADICTS_RAD = 1e-5, 3e-3


def frames_of(apart_rad: float, count: int) -> Iterator[Innovation]:
    """Motions of a camera that sways by 2 mrad a frame, each as far as this from one known to a tenth of it."""
    cov = np.diag(np.full(6, 1e-4**2))
    for k in range(count):
        apart = np.array([0.0, 0, 0, apart_rad, 0, 0])
        yield Innovation(apart, cov, 0.05, apart + 2e-3 * np.sin(1.5 * k + np.arange(6.0)), 3e-3)


def test_samples_that_have_agreed_for_long_are_trusted_after_one_frame_that_contradicts_them() -> None:
    inertia, trusted = Inertia(Config()), []
    for apart_rad, count in ((AGREES_RAD, 1), (CONTRADICTS_RAD, 1), (AGREES_RAD, 30), (CONTRADICTS_RAD, 26)):
        for found in frames_of(apart_rad, count):
            inertia._distance2, inertia._belief = found.weighed.distance2, inertia._belief.after(found)
            trusted.append(inertia.is_trusted)
    assert trusted[:33] == [True, False, *[True] * 31]
    assert not any(trusted[33:])


def test_contradictions_and_agreement_have_to_last_for_the_same_time() -> None:
    belief, out = Belief.begun(RULES, STD_ACCELERATION), []
    for apart_rad, count in ((AGREES_RAD, 25), (CONTRADICTS_RAD, 25), (AGREES_RAD, 30)):
        for found in frames_of(apart_rad, count):
            belief = belief.after(found)
            out.append(belief.is_out)
    first, last = out.index(True), len(out) - 1 - out[::-1].index(True)
    assert 20 <= first - 25 <= 24  # two frames until the odds turn, and a second
    assert 20 <= last - 50 <= 24
    assert belief.is_proven


def test_a_unit_that_predicts_worse_than_an_even_motion_is_of_no_use() -> None:
    """However large its covariance is, and though it never contradicts the images."""
    belief, rng = Belief.begun(RULES, STD_ACCELERATION), np.random.default_rng(3)
    for _ in range(60):
        found = Innovation(
            rng.normal(size=6) * 3e-2, np.diag(np.full(6, 3e-2**2)), 0.05, rng.normal(size=6) * 1e-3, 1e-3
        )
        assert found.weighed.distance2 < RULES.apart
        belief = belief.after(found)
    assert belief.is_out


def test_impossible_states_put_a_unit_out_only_if_it_is_not_proven_in_between() -> None:
    belief = Belief.begun(RULES, STD_ACCELERATION)
    for _ in range(3):
        for found in frames_of(AGREES_RAD, 25):
            belief = belief.after(found)
        belief = belief.restarted()
        assert not belief.is_out and not belief.is_proven
    assert belief.restarted().is_out


def test_an_even_motion_allows_no_jump_that_images_could_not_follow() -> None:
    evenly = Belief.begun(RULES, STD_ACCELERATION).evenly
    jump = np.array([0.0, 0, 0, 0.3, 0, 0])  # rad within 50 ms, where rates are given in degrees
    assert evenly.allows(jump, 0.05, RULES.most_change)  # nothing is known yet
    evenly = evenly.after(np.zeros(6), 0.05)
    assert not evenly.allows(jump, 0.05, RULES.most_change)
    assert evenly.allows(0.3 * jump, 0.05, RULES.most_change)


def known(gravity: np.ndarray, std: float, stamp_ns: int) -> Known:
    state = np.zeros(STATE)
    state[GRAVITY] = gravity
    return beside(stamp_ns, np.eye(4), 1e-6 * np.eye(6), state, std**2 * np.eye(STATE))


def test_gravity_may_move_as_far_as_it_becomes_known_and_no_farther() -> None:
    """Estimates of a constant move by √(P_then − P_now)."""
    rng, said, true = np.random.default_rng(1), 0, np.array([0.0, 9.81, 0.0])
    for _ in range(200):
        estimate, variance, steadiness = true + rng.normal(size=3) * 0.5, 0.25, Steadiness(RULES)
        for k in range(20):
            gain = variance / (variance + 1.0)
            estimate, variance = estimate + gain * (true + rng.normal(size=3) - estimate), (1 - gain) * variance
            steadiness, moved = steadiness.after(known(estimate, np.sqrt(variance), k * FRAME_NS))
            said += moved
    assert said <= 3
    steadiness, when = Steadiness(RULES), []
    for k in range(30):  # one that creeps away while its σ stays
        at = true + np.array([0.05 * max(k - 10, 0), 0.0, 0.0])
        steadiness, moved = steadiness.after(known(at, 0.1, k * FRAME_NS))
        when += [k] * moved
    assert when[0] == 15  # 0.25 m/s² away, where 0.2 are allowed: √16 times half of σ


def test_a_trial_is_the_update_of_a_filter() -> None:
    """Against least squares over the prediction and the motion of the images."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(JOINT.size, JOINT.size)) * 1e-2
    prior, of_images = root @ root.T + 1e-6 * np.eye(JOINT.size), np.diag(rng.uniform(1e-5, 1e-4, 6))
    then = Known(7, np.eye(4), rng.normal(size=STATE), prior)
    apart, h = rng.normal(size=6) * 1e-2, np.eye(6, JOINT.size)
    found = corrected(then, Innovation(apart, prior[:6, :6] + of_images, 0.05, apart, 0.0))
    information = np.linalg.inv(prior) + h.T @ np.linalg.inv(of_images) @ h
    step = np.linalg.solve(information, h.T @ np.linalg.solve(of_images, apart))
    assert found.state - then.state == pytest.approx(step[6:], rel=1e-6, abs=1e-9)
    assert found.cov_state == pytest.approx(np.linalg.inv(information)[6:, 6:], rel=1e-5, abs=1e-10)
    assert not found.cov_pose.any() and found.stamp_ns == 7


def test_nothing_is_learnt_from_an_ambiguous_frame() -> None:
    estimator, learnt = make_estimator(REFERENCE, PROJECTION, Config()), []
    for k, (_, observations) in enumerate(observed(21, 30)):
        estimator.step(replace(observations, ambiguity=Ambiguity(misfit=True) if k >= 12 else None))
        learnt.append(estimator.inertia._densities)
    assert learnt[12] is not learnt[10]
    assert all(of is learnt[20] for of in learnt[21:])  # once those of before have left the window


def test_innovations_are_weighed_as_numpy_weighs_them() -> None:
    """Distance, likelihoods, and the generalised least squares of apart = late · per_second, whatever the units."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        a, scale = rng.normal(size=(6, 6)), np.repeat(10.0 ** rng.uniform(-4, 0, 2), 3)
        cov = (a @ a.T + np.eye(6)) * np.outer(scale, scale)
        apart, twist = scale * rng.normal(size=6), rng.normal(size=6)
        expected_pose, by_images = (se3.exp(rng.normal(size=6)) for _ in range(2))
        expected = ExpectedMotion(0, expected_pose, cov, twist)
        found = Innovation.of(expected, se3.inverse(by_images), cov, 0.1, 0.05)
        assert np.allclose(se3.exp(found.apart), se3.inverse(expected_pose) @ by_images)
        assert np.allclose(se3.exp(found.motion), by_images)
        assert np.isclose(found.turned_rad, np.linalg.norm(se3.log_so3(expected_pose[:3, :3])))
        assert np.allclose(found.cov, 2 * cov + np.diag([0, 0, 0, 0.01, 0.01, 0.01]))
        weighed = Innovation(apart, cov, 0.05, apart, 0.0, twist).weighed
        assert np.isclose(weighed.distance2, apart @ np.linalg.solve(cov, apart))
        for k, at in enumerate((slice(3, 6), slice(0, 3))):
            of = apart[at] @ np.linalg.solve(cov[at, at], apart[at]) + np.linalg.slogdet(cov[at, at])[1]
            assert np.isclose(weighed.log_likelihoods[k], -0.5 * of)
        of_time = np.linalg.solve(cov, -twist)
        assert np.isclose(weighed.var_s2, 1 / (of_time @ -twist), rtol=1e-5)
        assert np.isclose(weighed.late_s, weighed.var_s2 * (of_time @ apart), rtol=1e-5)
