"""Turns of the right camera: their effects, which are noticed, and which are accepted."""

import numpy as np
import pytest
import scipy.stats

from stream_sfm import core
from stream_sfm.config import RigConfig
from stream_sfm.frontend.learnt.right_turn import TurnWatch, with_turn
from stream_sfm.frontend.learnt.usual_turns import ApparentTurns, Turn, TurnRules, UsualTurns
from stream_sfm.geometry import se3
from stream_sfm.geometry.medians import MEMORY_FRAMES
from stream_sfm.geometry.sizes import SIZES, Sizes
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.rig_model.estimate import RigEstimate
from stream_sfm.rig_model.model import RigModel, disparity_error
from tests.helpers.rectified import scattered_points

P = StereoProjection(420.0, 255.0, 257.0, 190.0, 0.16, 512, 384)
N, STD_PX = 150, 0.08
YAW = np.array([0.0, 1e-3, 0.0])
NONE = np.zeros(3)
NOTHING = ApparentTurns(np.zeros((3, 3)), NONE, 0.0)


def right_view(p: np.ndarray, rad: np.ndarray) -> np.ndarray:
    """The positions (n, 2) at which a right camera turned by (3,) sees homogeneous points (n, 4)."""
    in_right = p[:, :3] - p[:, 3:] * np.array([P.baseline_m, 0, 0])
    turned = in_right @ se3.exp_so3(rad)  # its axes are the columns of the rotation
    return turned[:, :2] / turned[:, 2:] * P.f_px + (P.cx_right_px, P.cy_px)


def frame(rng: np.random.Generator, rad: np.ndarray, motion: np.ndarray) -> tuple[np.ndarray, ...]:
    """The input of a watch for a frame: points and views with covariances, and an approximate motion."""
    p = scattered_points(rng, N)
    cov_points = np.zeros((N, 4, 4))
    std_q = 0.03 / P.f_px * np.array([1, 1, 1 / P.baseline_m])
    cov_points[:, [0, 1, 3], [0, 1, 3]] = std_q**2
    p_known = p.copy()
    p_known[:, [0, 1, 3]] += std_q * rng.normal(size=(N, 3))
    in_cam = p @ motion.T
    in_cam = in_cam / in_cam[:, 2:3]
    z = np.concatenate([P.project_homogeneous(in_cam)[:, :2], right_view(in_cam, rad)], axis=1)
    z += STD_PX * rng.normal(size=z.shape)
    nearly = se3.exp(np.array([2e-3, 0, 3e-3, 2e-4, 1e-4, 0]) * rng.normal(size=6)) @ motion
    return p_known, cov_points, z, np.tile(STD_PX**2 * np.eye(4), (N, 1, 1)), nearly


def watched(turns: list[np.ndarray], seed: int = 0, by_delay_rad: np.ndarray = NONE) -> tuple[TurnWatch, list[bool]]:
    """A watch after frames with these turns, and which of them were unusual."""
    rng, watch, unusual = np.random.default_rng(seed), TurnWatch.begun(P, TurnRules()), []
    motion, apparent = se3.exp([0.01, 0, -0.05, 0, 0.01, 0]), ApparentTurns(np.zeros((3, 3)), by_delay_rad, 1.0)
    for rad in turns:
        watch, _ = watch.judge(*frame(rng, rad, motion), apparent)
        unusual.append(bool(watch.unusual))
    return watch, unusual


def test_the_effect_of_a_small_turn_is_that_of_a_rotated_camera() -> None:
    p = scattered_points(np.random.default_rng(1), N)
    still = right_view(p, NONE)
    numerical = np.stack([(right_view(p, 1e-5 * e) - right_view(p, -1e-5 * e)) / 2e-5 for e in np.eye(3)], axis=2)
    assert np.abs(core.effects_of_turn(P, still) - numerical).max() < 1e-5 * P.f_px


def test_a_turn_is_part_of_the_calibrations_error() -> None:
    """For distant points it is just a disparity field."""
    rad = np.array([2e-4, 1e-3, -5e-4])
    model = RigModel.of(P, RigConfig())
    zero, cov = np.zeros(len(model)), 1e-6 * np.eye(len(model))
    estimate = with_turn(model, RigEstimate(zero, cov, 0.0, zero, cov, np.ones(len(model))), rad)
    assert estimate.applied
    p = scattered_points(np.random.default_rng(3), N)
    p[:, 3] = 0
    left_px = P.project_homogeneous(p)[:, :2]
    moved_px = right_view(p, rad) - right_view(p, NONE)
    assert disparity_error(P, estimate, left_px)[0] == pytest.approx(-moved_px[:, 0], abs=2e-3)


def test_turns_to_and_fro_are_not_accepted_and_become_usual() -> None:
    """Cameras that are not quite synchronous seem to turn as the rig does."""
    watch, unusual = watched([NONE] * 12 + [YAW * (-1) ** k for k in range(40)])
    assert watch.lasting_rad is None
    assert sum(unusual[-20:]) == 0


def test_a_run_with_large_turns_needs_a_larger_one() -> None:
    rng = np.random.default_rng(4)
    restless = list(2e-4 * rng.normal(size=(30, 3)))
    assert not watched([*restless, YAW])[1][-1]
    assert watched([NONE] * 30 + [YAW])[1][-1]


def test_a_possible_effect_of_a_late_camera_is_no_knock() -> None:
    """A delay of 8 ms makes a turn at 0.2 rad/s about y look like one of 1.6 mrad."""
    delayed = [NONE] * 12 + [YAW] * 3
    assert watched(delayed)[1][-3:] == [True] * 3
    assert not any(watched(delayed, by_delay_rad=1.6 * YAW)[1])
    assert watched([NONE] * 12 + [YAW[[1, 0, 2]]], by_delay_rad=1.6 * YAW)[1][-1]  # not about x


def test_nobody_knows_at_the_start_how_much_a_rig_shakes() -> None:
    """A turn by 12 σ of the first guess is a knock after twelve frames without one, and not in the second frame."""
    assert not watched([NONE, 1.2 * YAW])[1][-1]
    assert watched([NONE] * 12 + [1.2 * YAW])[1][-1]


def test_unusual_turns_that_end_were_usual_ones() -> None:
    """They are learnt, each with χ² of at most `rules.turn.limit`: a rig that shakes does not stay unusual."""
    ended, _ = watched([NONE] * 12 + [YAW, -YAW, YAW, NONE])
    calm, _ = watched([NONE] * 16)
    assert not ended.unusual
    assert ended.usual.frames == calm.usual.frames
    assert ended.usual.real[1, 1] > 4 * calm.usual.real[1, 1]


def test_the_delay_is_one_unknown_of_the_run_and_hides_no_turns() -> None:
    """Turns about y that could be a delay of 8 ms are real if they are not in proportion to the rig's own turn."""
    rng = np.random.default_rng(6)
    shaking = 2e-4 * rng.normal(size=40)
    usual, apparent = UsualTurns.begun(TurnRules()), [8e-3 * np.array([0, r, 0]) for r in rng.normal(0.2, 0.1, 40)]
    for shaken, per_delay in zip(shaking, apparent, strict=True):
        at = ApparentTurns(np.zeros((3, 3)), per_delay, 1.0)
        usual = usual.learnt(Turn(np.array([0, shaken, 0]), 1e-10 * np.eye(3), 3.0, at))
    assert np.sqrt(usual.real[1, 1]) == pytest.approx(2e-4, rel=0.35)  # of 20 frames: 3 σ
    delayed = UsualTurns.begun(TurnRules())
    for per_delay in apparent:
        at = ApparentTurns(np.zeros((3, 3)), per_delay, 1.0)
        delayed = delayed.learnt(Turn(0.7 * per_delay, 1e-10 * np.eye(3), 3.0, at))
    assert np.sqrt(delayed.real[1, 1]) < 5e-5


def test_unusual_turns_that_differ_are_no_knock() -> None:
    """As of a car that shakes: each is clear, they have one sign, and differ by a third of their mean."""
    apart = watched([NONE] * 12 + [2.2 * YAW, 4.2 * YAW, 3.8 * YAW])[0]
    assert len(apart.unusual) == 3 and apart.lasting_rad is None
    same = watched([NONE] * 12 + 3 * [3.4 * YAW])[0]
    assert same.lasting_rad == pytest.approx(3.4 * YAW, abs=1e-4)


def test_a_turn_that_is_larger_than_those_before_is_where_resections_begin() -> None:
    """In the second frame it is no knock, as nobody knows how much this rig shakes."""
    watch = watched([NONE, 1.2 * YAW])[0]
    assert not watch.unusual
    assert watch.usual.root @ watch.larger == pytest.approx(1.2 * YAW, abs=1e-4)
    assert not len(watched([NONE] * 12)[0].larger)


def test_the_error_of_a_turn_rate_during_a_delay_is_no_knock() -> None:
    """A delay of 8 ms makes an error of 0.2 rad/s look like a turn of 1.6 mrad."""
    usual, turn = watched([NONE] * 12)[0].usual, Turn(YAW, 1e-10 * np.eye(3), 3.0, NOTHING)
    late = ApparentTurns(np.zeros((3, 3)), NONE, 0.0, 1.6e-3)
    assert usual.sized(turn)[1] > 12 > 0 > usual.sized(Turn(YAW, turn.cov, 3.0, late))[1]


def test_turns_of_the_present_have_their_own_size() -> None:
    calm = watched([NONE] * 30)[0].usual
    shaken = watched([NONE] * 30 + [0.4 * YAW, -0.4 * YAW])[0].usual
    assert calm.sizes.probable == 1 and shaken.sizes.probable > 1
    assert shaken.root[1, 1] > 3 * calm.root[1, 1]


def test_few_views_and_impossible_turns_are_no_evidence() -> None:
    rng, watch = np.random.default_rng(5), TurnWatch.begun(P, TurnRules())
    few = frame(rng, YAW, np.eye(4))
    few[2][25:, 2:] = np.nan
    assert watch.judge(*few, NOTHING)[1] is None
    assert watch.judge(*frame(rng, 20 * YAW, np.eye(4)), NOTHING)[1] is None


def test_turns_are_weighed_and_learnt_as_numpy_does_it() -> None:
    """Eq. (72f), likelihoods of each size, and a step of expectation maximisation, by other factors of the matrices."""
    rng, rules = np.random.default_rng(7), TurnRules()
    for frames in (3, 5, 20):
        a, b, c, d = (1e-4 * rng.normal(size=(3, 3)) for _ in range(4))
        usual = UsualTurns(rules, a @ a.T, b @ b.T, frames, Sizes(), rng.normal(size=2))
        turn = Turn(2e-4 * rng.normal(size=3), c @ c.T, 30.0, ApparentTurns(d @ d.T, 1e-4 * rng.normal(size=3), 0.5))
        sized, log_odds = usual.sized(turn)
        own, n = turn.cov + turn.apparent.cov, 3.0 * (max(frames - rules.guess_frames, 0) + 1)
        knocked = scipy.stats.multivariate_normal(cov=usual.measured + own + rules.std_rad**2 * np.eye(3))
        as_usual = scipy.stats.multivariate_t(shape=usual.measured + own, df=n)
        assert log_odds == pytest.approx(knocked.logpdf(turn.rad) - as_usual.logpdf(turn.rad), abs=1e-8)
        likely = [scipy.stats.multivariate_normal(cov=own + s**2 * usual.real).logpdf(turn.rad) for s in SIZES]
        assert np.allclose(sized.sizes.probabilities, usual.sizes.after(np.array(likely)).probabilities, atol=1e-10)
        learnt, per_s, others = usual.learnt(turn), turn.apparent.per_s, turn.cov + turn.apparent.cov_others
        at = min(frames + 1, MEMORY_FRAMES)
        by_delay = np.linalg.solve(usual.real + others, per_s)
        late = (1 - 1 / at) * usual.late + (by_delay @ per_s, by_delay @ turn.rad)
        var_s2 = 1 / (1 / 0.5 + late[0])
        rad, cov = turn.rad - var_s2 * late[1] * per_s, others + var_s2 * np.outer(per_s, per_s)
        gain, counts = usual.real @ np.linalg.inv(usual.real + cov), rules.limit / 30.0
        real = counts * gain @ np.outer(rad, rad) @ gain.T + usual.real - gain @ usual.real
        assert np.allclose(learnt.late, late)
        assert np.allclose(learnt.real, usual.real + (real - usual.real) / at, rtol=1e-6, atol=1e-14)
        measured = usual.measured + (counts * np.outer(turn.rad, turn.rad) - usual.measured) / at
        assert np.allclose(learnt.measured, measured, rtol=1e-9, atol=1e-16)
