"""The first line of a comparison: which method is ahead, and which covariances are consistent, in few words."""

import numpy as np
import pytest

from stream_sfm.evaluation.drift import Compared
from stream_sfm.geometry import se3
from stream_sfm.report.conclusion import _which_hold, verdict_of, who_is_ahead
from stream_sfm.report.drift import _truth_separates


def methods(**factors: float) -> dict[str, dict[str, object]]:
    return {key: {"sigma_factor": factor, "sigma_factor_from": "truth"} for key, factor in factors.items()}


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({"cross_frame": 1.0}, "Covariances are consistent for cross-frame"),
        (
            {"cross_frame": 1.0, "ekf": 2.0, "frame_to_frame": 0.1},
            "Covariances are consistent for cross-frame, not for EKF with plain weights (σ 2 times too small) and "
            "frame-to-frame (σ 10 times too large)",
        ),
        (
            {"cross_frame": 2.0, "ekf": 3.0, "iterated_ekf": 2.0, "frame_to_frame": 10.0},
            "Covariances are not consistent for cross-frame (σ 2 times too small) and 3 others (σ 2 to 10 times too "
            "small)",
        ),
        (
            {"ekf": 0.1, "iterated_ekf": 2.0, "frame_to_frame": 10.0, "cross_frame_wc": 4.0},
            "Covariances are not consistent for 4 methods (σ up to 10 times too large and 10 times too small)",
        ),
    ],
)
def test_it_says_which_covariances_are_consistent(factors, said):
    assert _which_hold(methods(**factors), as_is=True) == said


def test_it_says_that_nothing_is_left_for_the_calibration():
    """In two passes all methods take the result of the first one as exact: their σ has no part for it."""
    assert _which_hold(methods(cross_frame=2.0), as_is=False) == (
        "Covariances, with the calibration taken as exact, are not consistent for cross-frame (σ 2 times too small)"
    )


def ratio(value: float, low: float, high: float) -> dict[str, object]:
    return {"value": value, "ci95": [low, high]}


LESS, MORE, ALIKE = ratio(0.8, 0.7, 0.9), ratio(1.24, 1.1, 1.4), ratio(1.24, 0.94, 2.56)


def test_what_is_decided_against_the_window_comes_first():
    """Then what is decided for it, and then what this log cannot decide, whatever the ratio is."""
    verdict = {
        "ahead": ["ekf"],
        "behind": ["frame_to_frame"],
        "mixed": [],
        "level": ["iterated_ekf"],
        "ratios": {
            "ekf": {"position": LESS, "rotation": ALIKE},
            "frame_to_frame": {"position": ALIKE, "rotation": MORE},
            "iterated_ekf": {"position": ALIKE, "rotation": ALIKE},
        },
    }
    assert who_is_ahead(verdict) == [
        "EKF with plain weights (position ×0.80 [0.70, 0.90]) errs less than cross-frame",
        "Cross-frame errs less than frame-to-frame (rotation ×1.24 [1.10, 1.40])",
        "This log cannot separate cross-frame from iterated EKF with plain weights",
    ]
    assert who_is_ahead(None) == []


def random_path(rng: np.random.Generator, frames: int = 150) -> np.ndarray:
    """A path that errs by a random walk of positions and rotations."""
    return se3.exp(np.cumsum(rng.normal(0, 0.01, (frames, 6)), axis=0))


def test_between_equal_methods_a_winner_is_named_in_a_twentieth_of_logs():
    """Whatever both have in common; of methods that differ by a factor of two it is named in nearly all."""
    truth, named, logs = np.tile(np.eye(4), (150, 1, 1)), np.zeros(3), 120
    for seed in range(logs):
        rng = np.random.default_rng(seed)
        paths = [random_path(rng) for _ in range(2)]
        common = random_path(rng)
        pairs = (paths, [common @ x for x in paths], (paths[0], paths[1] @ random_path(rng) @ random_path(rng)))
        for k, (window, other) in enumerate(pairs):
            methods = {"cross_frame": Compared(window, truth), "ekf": Compared(other, truth)}
            verdict = verdict_of(methods)
            assert verdict is not None
            named[k] += not verdict["level"]
    error = np.sqrt(0.05 * 0.95 / logs)
    assert (named[:2] / logs < 0.05 + 3 * error).all() and named[2] / logs > 0.8


def test_a_log_that_is_too_short_has_no_verdict():
    truth, rng = np.tile(np.eye(4), (30, 1, 1)), np.random.default_rng(0)
    methods = {key: Compared(random_path(rng, 30), truth) for key in ("cross_frame", "ekf")}
    assert verdict_of(methods) is None


def line(frames: int, separated: bool, **others: bool) -> dict[str, object]:
    """A line of the table by span: whether the truth separates the window, and others, from frame-to-frame."""
    of = {key: {"position_from_halves": not each} for key, each in {"cross_frame": separated, **others}.items()}
    return {"frames": frames, "methods": {**of, "frame_to_frame": {"position_from_halves": False}}}


def test_the_truth_decides_if_it_does_in_most_comparisons():
    """One span of one method is not enough to judge covariances by it."""
    assert not _truth_separates([line(1, False, ekf=True), line(10, False, ekf=False)], "frame_to_frame")
    assert _truth_separates([line(1, False, ekf=True), line(10, True, ekf=True)], "frame_to_frame")
    assert _truth_separates([], "frame_to_frame")
