"""Growth exponents of known processes, and the paired ratio of a known factor."""

import numpy as np
import pytest

from stream_sfm.evaluation.relative import growth_exponents, paired_ratio, relative_errors, turning
from stream_sfm.geometry import se3

RNG = np.random.default_rng(5)


def chain(steps: np.ndarray) -> np.ndarray:
    poses = [np.eye(4)]
    for step in se3.exp(steps):
        poses.append(poses[-1] @ step)
    return np.array(poses)


def positions(p: np.ndarray) -> np.ndarray:
    return se3.from_rotation_translation(np.broadcast_to(np.eye(3), (len(p), 3, 3)), p)


TRUTH = positions(np.cumsum(np.tile([0.1, 0, 0], (1500, 1)), axis=0))


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (np.cumsum(RNG.normal(size=(1500, 3)), axis=0), 1.0),  # random walk
        (np.arange(1500)[:, None] * [0, 0, 1.0], 2.0),  # constant bias
        (RNG.normal(size=(1500, 3)), 0.0),  # no drift, only noise
    ],
)
def test_the_exponent_names_the_process(error: np.ndarray, expected: float) -> None:
    estimate = chain(RNG.normal(size=(1499, 6)) * [0, 0, 0, 1e-7, 1e-7, 1e-7])
    estimate[:, :3, 3] = TRUTH[:, :3, 3] + 1e-3 * error
    found = growth_exponents(estimate, TRUTH)
    assert found is not None
    # One sample path of 1500 frames; the interval of a constant bias has no width.
    assert found[0].value == pytest.approx(expected, abs=0.25)
    assert found[0].low <= found[0].value <= found[0].high
    assert found[1].value == pytest.approx(1.0, abs=0.25)  # the rotation walks at random


def test_too_short_or_exact_has_no_exponent_and_no_ratio() -> None:
    assert growth_exponents(TRUTH[:59], positions(RNG.normal(size=(59, 3)))) is None
    assert paired_ratio(*(positions(RNG.normal(size=(39, 3))) for _ in range(3))) is None
    assert growth_exponents(TRUTH, TRUTH) is None


def test_paired_ratio_of_a_scaled_error_is_the_scale() -> None:
    walk = np.cumsum(RNG.normal(size=(1500, 6)), axis=0) * 1e-5
    found = paired_ratio(TRUTH @ se3.exp(3 * walk), TRUTH @ se3.exp(walk), TRUTH)
    assert found is not None
    for ratio in found:  # to what three times an error of 1e-4 rad is not three times the motion
        assert [ratio.low, ratio.value, ratio.high] == pytest.approx([3, 3, 3], rel=0.02)


def test_relative_errors_do_not_see_a_common_motion() -> None:
    estimate = chain(RNG.normal(size=(40, 6)) * 0.1)
    moved = se3.exp(RNG.normal(size=6)) @ estimate
    for errors in relative_errors(moved, estimate, 3):
        np.testing.assert_allclose(errors, 0, atol=1e-6)  # the root of rounding in a cosine


def test_turning_is_told_by_the_rate() -> None:
    stamps = np.arange(31) * 100_000_000
    poses = chain(np.tile([0.1, 0, 0, 0, np.radians(0.6), 0], (30, 1)))
    assert turning(stamps, poses, 10).all()  # 6° per second
    assert not turning(2 * stamps, poses, 10).any()
