"""The sentences on top of the page: what they say of figures that are given."""

import math
from typing import Any

import pytest

from stream_sfm.report.verdict import frames_to_tell, verdict

LEVEL, MORE, LESS = (1.03, 0.9, 1.18), (1.44, 1.25, 1.64), (0.8, 0.7, 0.9)


def report(nees: dict[str, float] | None = None, **ratios: Any) -> dict[str, Any]:
    """The content of a report of 100 frames, with (value, low, high) of position and rotation by method."""
    methods = {
        key: {"failure": None, "nees_pose_mean": (nees or {}).get(key, 6.0)} for key in ("cross_frame", *ratios)
    }
    found = {
        key: {
            q: {"value": v, "ci95": [low, high]}
            for q, (v, low, high) in zip(("position", "rotation"), both, strict=True)
        }
        for key, both in ratios.items()
    }
    return {"frames_with_ground_truth": 100, "methods": methods, "error_over_cross_frame": found}


@pytest.mark.parametrize(
    ("ratios", "sentence"),
    [
        (
            {"ekf": (MORE, MORE)},
            "Cross-frame drifts least: EKF’s position errors are 1.44 [1.25, 1.64] times as large.",
        ),
        (
            {"ekf": (LEVEL, MORE), "frame_to_frame": (LEVEL, LEVEL)},
            "No method is shown to drift less than cross-frame: EKF’s rotation errors are 1.44 [1.25, 1.64] times as "
            "large; one other method cannot be told apart from it.",
        ),
        (
            {"ekf": (LESS, LEVEL), "frame_to_frame": (MORE, MORE)},
            "Cross-frame does not drift least: EKF’s position errors are 0.80 [0.70, 0.90] times as large; "
            "frame-to-frame’s position errors are 1.44 [1.25, 1.64] times as large.",
        ),
        (
            {key: (MORE, MORE) for key in ("ekf", "iterated_ekf", "ekf_cv", "frame_to_frame")},
            "Cross-frame drifts least: EKF’s position errors are 1.44 [1.25, 1.64] times as large, iterated EKF’s "
            "position errors 1.44 [1.25, 1.64] times and those of 2 other methods are larger, too.",
        ),
    ],
)
def test_the_sentence_names_who_drifts_more_and_by_how_much(ratios: dict[str, Any], sentence: str) -> None:
    assert verdict(report(**ratios)).drift == sentence


@pytest.mark.parametrize("both", [(LEVEL, LEVEL), (LESS, MORE)])
def test_where_nothing_can_be_said_a_longer_log_is_asked_for(both: Any) -> None:
    text = verdict(report(ekf=both)).drift
    assert text.startswith("This log cannot tell which method drifts least: over 100 frames none differs")
    assert "frames." in text


def test_the_length_of_a_log_that_tells() -> None:
    """An interval of the logarithm of ± .4 around .2 has to become half as wide, which takes four times the length."""
    figure = {"value": math.exp(0.2), "ci95": [math.exp(-0.2), math.exp(0.6)]}
    wanted, frames = frames_to_tell(figure, 100)
    assert wanted == pytest.approx(math.exp(0.2)) and 400 <= frames <= 410  # rounded up to two digits
    assert frames_to_tell(figure | {"value": 1.0}, 100)[0] == pytest.approx(1.1)


def test_covariances_are_judged_by_their_nees() -> None:
    text = verdict(report({"ekf": 240.0, "cross_frame": 5.0}, ekf=(LESS, LEVEL))).covariances
    assert text == "The covariance of cross-frame is right (NEES 5, 6 expected), that of EKF is 40 times too small."
    both = verdict(report({"ekf": 240.0, "ekf_cv": 60.0}, ekf=(LESS, LEVEL), ekf_cv=(LESS, LEVEL))).covariances
    assert both.endswith("those of EKF and constant-velocity EKF are 10 to 40 times too small.")
    assert "larger than needed" in verdict(report({"cross_frame": 0.5})).covariances
    assert "EKF" not in verdict(report({"ekf": 14.0}, ekf=(LEVEL, LEVEL))).covariances  # within 95 % of one pose


def test_what_is_certain_stands_first() -> None:
    for ratio, first in ((LEVEL, "The covariance of"), (MORE, "Cross-frame drifts least")):
        found = verdict(report({"ekf": 240.0}, ekf=(ratio, ratio)))
        assert found.sentences[0].startswith(first) and len(found.sentences) == 2
    assert verdict(report(ekf=(LEVEL, LEVEL))).sentences[0].startswith("This log cannot tell")


def test_why_there_is_no_comparison() -> None:
    content = report()
    assert "it takes cross-frame and another method" in verdict(content).drift
    content["methods"]["ekf"] = content["methods"]["cross_frame"] | {"failure": "stopped at frame 3: singular"}
    assert "EKF stopped at frame 3: singular." in verdict(content).drift
    content["methods"]["ekf"]["failure"] = None
    few = verdict(content | {"frames_with_ground_truth": 12}).drift
    assert "it takes 40 frames in a row with ground truth, and this log has 12" in few


def test_without_ground_truth_it_says_how_far_the_methods_are_apart() -> None:
    content = report(ekf=(LEVEL, LEVEL)) | {"frames_with_ground_truth": 0, "divergence_from_cross_frame_m": {}}
    assert verdict(content).drift == "This log cannot tell which method drifts least: it has no ground truth."
    content["divergence_from_cross_frame_m"] = {"ekf": 0.0089, "frame_to_frame": 0.0132}
    content["methods"]["cross_frame"]["end_std_position_m"] = 0.0312
    assert verdict(content).drift.endswith(
        "no ground truth. Positions of the others are 0.0089 to 0.013 m (RMS) away from those of cross-frame, whose σ "
        "at the end is 0.031 m."
    )
