"""Ground truth that is wrong is found, and one that is right is left alone."""

import numpy as np
import pytest

from stream_sfm.errors import ConfigError
from stream_sfm.evaluation.association import checked_ranges, matched, without_frames
from stream_sfm.evaluation.relative import paired_ratio
from stream_sfm.evaluation.truth_check import check_truth, find_doubts, frames_in_doubt, warnings_of
from stream_sfm.geometry import se3
from stream_sfm.types import Trajectory

FRAMES = 120
STAMPS = np.arange(FRAMES) * 100_000_000
NOISE = np.repeat([2e-3, 2e-4], 3)  # m and rad per frame: of a good satellite receiver, and of odometry


def steps(rng: np.random.Generator) -> np.ndarray:
    """A drive: speed and turning vary as a driver varies them, σ = NOISE on each step; (n − 1, 6)."""
    t = np.arange(FRAMES - 1) / FRAMES
    phase = rng.uniform(0, 2 * np.pi, 2)
    xi = np.zeros((FRAMES - 1, 6))
    xi[:, 2] = 0.9 + 0.3 * np.sin(4 * t + phase[0])
    xi[:, 4] = 0.03 * np.sin(6 * t + phase[1])
    xi[:, 0] = 0.8 * xi[:, 4]
    return xi + NOISE * rng.normal(size=xi.shape)


def path(xi: np.ndarray) -> np.ndarray:
    poses = [np.eye(4)]
    for motion in se3.exp(xi):
        poses.append(poses[-1] @ motion)
    return np.array(poses)


def ranges(poses: np.ndarray, *estimates: np.ndarray) -> list[tuple[int, int]]:
    truth = Trajectory(STAMPS, poses)
    return frames_in_doubt(find_doubts(STAMPS, truth, estimates, np.ones(FRAMES, bool)))


def test_good_truth_is_not_in_doubt() -> None:
    """In 200 drives with noise, by itself and beside an estimate; eight σ of Gaussian noise do not occur."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        true = steps(rng)
        assert ranges(path(true), path(true + NOISE * rng.normal(size=true.shape))) == []


def test_the_exact_truth_of_a_simulation_is_not_in_doubt() -> None:
    """Even motion is the rule there, and sharp turns are no jumps."""
    xi = np.zeros((FRAMES - 1, 6))
    xi[:, 2] = 0.1
    xi[30:60, 4] = 0.1 * np.sin(np.linspace(0, np.pi, 30)) ** 2
    assert ranges(path(xi)) == []


def test_interpolated_truth_is_found() -> None:
    """A speed that is constant for 14 frames, while every odometry sees it rise."""
    true = steps(np.random.default_rng(2))
    wrong = true.copy()
    wrong[:14] = [0, 0, 0.86, 0, 0, 0]
    found = check_truth(path(wrong), STAMPS)
    assert frames_in_doubt(found) == [(0, 15)]
    assert any("interpolated" in f.reason and "speed" in f.reason for f in found)


@pytest.mark.parametrize(("axis", "size", "unit"), [(2, 0.15, "mm"), (4, 0.01, "mrad")])
def test_jumps_are_found(axis: int, size: float, unit: str) -> None:
    """One pose is off: the step to it and the step from it."""
    poses = path(steps(np.random.default_rng(3)))
    poses[50] = poses[50] @ se3.exp(size * np.eye(6)[axis])
    found = [f for f in check_truth(poses, STAMPS) if "jumps" in f.reason]
    assert found and all(f.first >= 49 and f.last <= 51 and unit in f.reason for f in found)


def test_a_vehicle_that_slides_is_found() -> None:
    """A heading that is off by 3° for 20 frames: the path goes sideways."""
    poses = path(steps(np.random.default_rng(4)))
    poses[60:80] = poses[60:80] @ se3.exp([0, 0, 0, 0, np.radians(3), 0])
    found = [f for f in check_truth(poses, STAMPS) if "slides" in f.reason]
    assert found and min(f.first for f in found) in (59, 60) and max(f.last for f in found) in (79, 80, 81)


def test_truth_that_no_estimate_follows_is_found() -> None:
    """A slow bump of the true speed: smooth by itself, but two estimates agree that there was none."""
    rng = np.random.default_rng(5)
    true = steps(rng)
    one, other = (path(true + NOISE * rng.normal(size=true.shape)) for _ in range(2))
    bump = true.copy()
    bump[40:60, 2] += 0.1 * np.sin(np.linspace(0, np.pi, 20))
    (first, end), *more = ranges(path(bump), one, other)
    assert not more and 40 <= first <= 45 and 55 <= end <= 61
    assert ranges(path(true), path(bump), other) == [], "one estimate that differs is not the truth's fault"


def test_a_jump_of_the_estimate_is_not_the_truths() -> None:
    true = steps(np.random.default_rng(6))
    jump = true.copy()
    jump[50, 2] += 0.2
    assert ranges(path(true), path(jump)) == []


def test_what_is_told_is_bounded() -> None:
    poses = path(steps(np.random.default_rng(7)))
    for k in range(10, 110, 9):
        poses[k, 0, 3] += 0.2
    told = warnings_of(check_truth(poses, STAMPS))
    assert len(told) == 9 and "more places" in told[-1]


def test_ignored_frames_have_no_truth() -> None:
    true = path(steps(np.random.default_rng(8)))
    truth = Trajectory(STAMPS, true)
    rows, _ = matched(truth, without_frames(truth, STAMPS, [(0, 15), (40, 44)]))
    assert rows.tolist() == [*range(15, 40), *range(44, FRAMES)]
    sparse = Trajectory(STAMPS[::2] // 2, true[::2])  # truths at every second frame, 100 ms apart
    frames = Trajectory(STAMPS // 2, true)
    rows, _ = matched(frames, without_frames(sparse, frames.stamps_ns, [(40, 44)]))
    assert not set(range(40, 44)) & set(rows.tolist()) and {38, 45} <= set(rows.tolist())


def test_ratios_leave_ignored_frames_out() -> None:
    """A truth that is wrong over a tenth of the log tells nothing there; without it the ratio is what it was."""
    rng = np.random.default_rng(9)
    true = steps(rng)
    one, other = (path(true + f * NOISE * rng.normal(size=true.shape)) for f in (2.0, 1.0))
    right = paired_ratio(one, other, path(true))
    wrong = true.copy()
    wrong[40:52, 2] += 0.3
    masked = path(wrong)
    masked[40:53] = np.nan
    found = paired_ratio(one, other, masked)
    assert right is not None and found is not None
    for a, b in zip(found, right, strict=True):
        assert b.low < a.value < b.high


@pytest.mark.parametrize("given", [(5, 5), (-1, 4), (7, 2), (1, 2, 3)])
def test_what_is_no_range_is_refused(given: tuple[int, int]) -> None:
    with pytest.raises(ConfigError, match="range of frames"):
        checked_ranges([given])
