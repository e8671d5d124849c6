"""Errors by span, errors that all methods share, and halves of the tracks where the truth cannot separate methods."""

import numpy as np
import pytest
from numpy.typing import NDArray

from stream_sfm.evaluation.common import NONE, Common, common_errors
from stream_sfm.evaluation.drift import Compared, curves, separates, table
from stream_sfm.geometry import se3

Array = NDArray[np.float64]
FRAMES = 160
STD = np.repeat([1e-3, 3e-4], 3)  # m and rad per frame


def path(seed: int, std: Array | float = STD, straight: bool = False) -> Array:
    """A path (n, 4, 4) of motions that err; of seed 0 and σ 0 the true one."""
    rng = np.random.default_rng(seed)
    steps = np.tile([0.01, 0, 0.3, 0, 0, 0], (FRAMES - 1, 1))
    if not straight:
        k = np.arange(FRAMES - 1)
        steps[:, 3:] = 0.03 * np.stack([np.sin(k / 9), np.cos(k / 7), np.sin(k / 5)], axis=1)
    motions = se3.exp(steps) @ se3.exp(std * rng.normal(size=(FRAMES - 1, 6)))
    poses = [np.eye(4)]
    for motion in motions:
        poses.append(poses[-1] @ motion)
    return np.stack(poses)


TRUTH, METHODS = path(0, 0.0), [path(seed) for seed in (1, 2, 3)]


def test_methods_with_independent_errors_share_nothing() -> None:
    assert common_errors(METHODS, TRUTH) is NONE or not common_errors(METHODS, TRUTH).any
    assert NONE.applied(TRUTH) is TRUTH and NONE.in_words() == ""


@pytest.mark.parametrize("straight", [False, True])
def test_errors_that_all_methods_share_are_found_and_removed(straight: bool) -> None:
    """Turns about the direction of a straight motion show only in rotations, of which it has none."""
    truth = path(0, 0.0, straight)
    methods = [path(seed, straight=straight) for seed in (1, 2, 3)]
    given = Common(np.array([0.006, -0.008, 0.0]), 0.02, np.array([0.01, 0.03, 0.0]))
    # the errors of the truth are the other way round: what it would need to be like the methods
    wrong = truth.copy()
    wrong[:, :3, 3] /= 1 + given.scale
    start, turn = (se3.exp(np.r_[np.zeros(3), rad]) for rad in (given.start_rad, given.turn_rad))
    wrong[1:] = se3.inverse(start) @ wrong[1:]
    wrong = turn @ wrong @ se3.inverse(turn)
    found = common_errors(methods, wrong)
    assert found.turn_rad[:2] == pytest.approx(given.turn_rad[:2], abs=1e-3)
    assert found.scale == pytest.approx(given.scale, abs=2e-3)
    assert found.start_rad[:2] == pytest.approx(given.start_rad[:2], abs=8e-3)  # drift turns all of it a little
    assert "of the first true pose" in found.in_words() and "too long" in found.in_words()
    apart = [np.linalg.norm((m - t)[:, :3, 3]) for t in (wrong, found.applied(wrong)) for m in methods]
    assert min(apart[:3]) > 3 * max(apart[3:])


def test_a_turn_that_rotations_contradict_is_drift() -> None:
    """Positions swing to one side, as by a turn of the first pose, and rotations are right."""
    start = se3.exp(np.array([0, 0, 0, 0.01, 0.03, 0.0]))
    swung = TRUTH.copy()
    swung[1:] = se3.inverse(start) @ swung[1:]
    assert common_errors(METHODS, swung).start_rad.any()
    swung[:, :3, :3] = TRUTH[:, :3, :3]
    assert not common_errors(METHODS, swung).start_rad.any()


def test_frames_without_truth_stay_without() -> None:
    truth = TRUTH.copy()
    truth[[0, 7]] = np.nan
    applied = Common(np.array([0.0, 0.1, 0.0]), 0.1, np.zeros(3)).applied(truth)
    assert np.isnan(applied[[0, 7]]).all() and np.isfinite(np.delete(applied, [0, 7], axis=0)).all()
    assert applied[1] == pytest.approx(np.eye(4), abs=1e-12)


def test_errors_grow_as_the_root_of_the_span() -> None:
    found = curves({"a": Compared(METHODS[0], TRUTH)})
    rms = np.array([value for value, _, _ in found["methods"]["a"]["rotation_rms_rad"]])
    slope = np.polyfit(np.log(found["frames"]), np.log(rms), 1)[0]
    assert 0.3 < slope < 0.7 and found["frames"][-1] == FRAMES // 4
    assert rms[0] == pytest.approx(np.sqrt(3) * STD[3], rel=0.15)


def test_halves_show_the_errors_of_the_whole() -> None:
    """Each half has twice the variance of the whole, so half their difference has that of the whole."""
    halves = np.stack([path(seed, np.sqrt(2) * STD) for seed in (4, 5)])
    (of_halves,) = curves({"a": Compared.of_halves(halves)})["methods"].values()
    assert of_halves["rotation_rms_rad"][0][0] == pytest.approx(np.sqrt(3) * STD[3], rel=0.15)


def test_where_the_truth_errs_more_than_methods_differ_halves_are_asked() -> None:
    rng = np.random.default_rng(9)
    rough = TRUTH @ se3.exp(20 * STD * rng.normal(size=(FRAMES, 6)))
    methods = {name: Compared(poses, rough) for name, poses in zip("ab", METHODS, strict=False)}
    halves = {
        name: Compared.of_halves(np.stack([path(seed + 2 * k, size * STD) for seed in (11, 12)]))
        for k, (name, size) in enumerate((("a", 3.0), ("b", 1.5)))
    }
    (first, *_), (without, *_) = table(methods, "b", halves), table(methods, "b")
    assert separates(methods["a"], methods["b"], 1) == (False, False)
    assert first["methods"]["a"]["position_from_halves"]
    assert first["methods"]["a"]["rotation_over_b"]["value"] == pytest.approx(2.0, rel=0.2)
    assert without["methods"]["a"]["position_over_b"] is None and without["methods"]["a"]["position_from_halves"]
    (line, *_) = table({name: Compared(m.poses, TRUTH) for name, m in methods.items()}, "b")
    assert not line["methods"]["a"]["position_from_halves"] and line["methods"]["a"]["position_over_b"]["ci95"]


def test_methods_are_compared_over_the_same_motions() -> None:
    """The ratio of two methods is that of the errors shown, also where one of them has lost its way for a while."""
    lost = METHODS[1].copy()
    lost[20:60] = np.nan
    rough = METHODS[0].copy()
    rough[20:60, :3, 3] += np.random.default_rng(5).normal(size=(40, 3))  # metres off where the other is lost
    line = table({"a": Compared(rough, TRUTH), "b": Compared(lost, TRUTH)}, "b")[0]["methods"]
    quotient = line["a"]["position_rms_m"] / line["b"]["position_rms_m"]
    assert line["a"]["position_over_b"]["value"] == pytest.approx(quotient)
    assert 0.7 < quotient < 1.4  # within three standard errors of 1


def test_a_method_that_is_mostly_lost_takes_no_motions_from_the_others() -> None:
    both = {"a": Compared(METHODS[0], TRUTH), "lost": Compared(METHODS[1][:20], TRUTH[:20])}
    alone = curves({"a": both["a"]})["methods"]["a"]
    assert curves(both)["methods"]["a"] == alone
