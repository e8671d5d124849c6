"""The first line of a comparison: which method is ahead, and which covariances are consistent, in few words."""

import pytest

from stream_sfm.report.drift import _truth_separates, _which_hold, _who_is_ahead


def methods(**factors: float) -> dict[str, dict[str, object]]:
    return {key: {"sigma_factor": factor, "sigma_factor_from": "truth"} for key, factor in factors.items()}


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({"cross_frame": 1.0}, "Covariances are consistent for cross-frame"),
        (
            {"cross_frame": 1.0, "ekf": 2.0, "frame_to_frame": 0.1},
            "Covariances are consistent for cross-frame, not for EKF (σ 2 times too small) and frame-to-frame "
            "(σ 10 times too large)",
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


def line(frames: int, separated: bool, **others: bool) -> dict[str, object]:
    """A line of the table by span: the error of the window is 1.25 times that of frame-to-frame, by truth or halves."""
    of = {
        "position_over_frame_to_frame": {"value": 1.25, "ci95": [1.0, 1.5]},
        "position_from_halves": not separated,
    }
    of_others = {key: {"position_from_halves": not each} for key, each in others.items()}
    reference = {"frame_to_frame": {"position_from_halves": False}}
    return {"frames": frames, "methods": {"cross_frame": of, **reference, **of_others}}


def test_halves_are_not_called_level_where_the_truth_cannot_separate_them():
    """Even if it separates a third method from the reference."""
    content = {
        "reference": "frame_to_frame",
        "against": "truth",
        "table": [line(1, False, ekf=True), line(10, False, ekf=False)],
    }
    assert _who_is_ahead(content) == (
        "The truth cannot separate cross-frame from frame-to-frame; by halves of the tracks, the error of "
        "frame-to-frame is 0.80 [0.67, 1.00] times that of cross-frame over 1 frame, 0.80 [0.67, 1.00] times over 10"
    )


def test_the_truth_decides_if_it_does_in_most_comparisons():
    """One span of one method is not enough to judge covariances by it."""
    assert not _truth_separates([line(1, False, ekf=True), line(10, False, ekf=False)], "frame_to_frame")
    assert _truth_separates([line(1, False, ekf=True), line(10, True, ekf=True)], "frame_to_frame")
    assert _truth_separates([], "frame_to_frame")
