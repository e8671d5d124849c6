"""The first line of a comparison: whose covariances hold, in few words however many methods there are."""

import pytest

from stream_sfm.report.drift import _which_hold


def methods(**factors: float) -> dict[str, dict[str, object]]:
    return {key: {"sigma_factor": factor, "sigma_factor_from": "truth"} for key, factor in factors.items()}


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({"cross_frame": 1.0}, "Covariances hold for cross-frame"),
        (
            {"cross_frame": 1.0, "ekf": 2.0, "frame_to_frame": 0.1},
            "Covariances hold for cross-frame, not for EKF (σ 2 times too small) and frame-to-frame (σ 10 times too "
            "large)",
        ),
        (
            {"cross_frame": 2.0, "ekf": 3.0, "iterated_ekf": 2.0, "frame_to_frame": 10.0},
            "Covariances do not hold for cross-frame (σ 2 times too small) and 3 others (σ 2 to 10 times too small)",
        ),
        (
            {"ekf": 0.1, "iterated_ekf": 2.0, "frame_to_frame": 10.0, "cross_frame_wc": 4.0},
            "Covariances do not hold for 4 methods (σ up to 10 times too large and 10 times too small)",
        ),
    ],
)
def test_it_says_whose_covariances_hold(factors, said):
    assert _which_hold(methods(**factors), as_is=True) == said


def test_it_says_that_nothing_is_left_for_the_calibration():
    """In two passes all methods take what the first one found for exact: their σ has no part for it."""
    assert _which_hold(methods(cross_frame=2.0), as_is=False) == (
        "Covariances, with the calibration taken for exact, do not hold for cross-frame (σ 2 times too small)"
    )
