"""The paragraph on top of the report: what it says of figures that are given."""

from typing import Any

import pytest

from stream_sfm.report.conclusion import conclusion as conclude

LEVEL, MORE, LESS = (1.03, 0.9, 1.18), (1.44, 1.25, 1.64), (0.8, 0.7, 0.9)


def conclusion(content: dict[str, Any]) -> tuple[str, str]:
    found = conclude(content)
    return found.style, found.text


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
    return {
        "frames_with_ground_truth": 100,
        "methods": methods,
        "error_over_cross_frame": found,
    }


@pytest.mark.parametrize(
    ("both", "style", "sentence"),
    [
        (
            (LEVEL, MORE),
            "larger",
            "EKF against cross-frame: in rotation ×1.44 [1.25, 1.64]; "
            "position cannot be told apart (×1.03 [0.90, 1.18]).",
        ),
        (
            (LEVEL, LEVEL),
            "open",
            "EKF and cross-frame cannot be told apart: position ×1.03 [0.90, 1.18], rotation ×1.03 [0.90, 1.18].",
        ),
        (
            (MORE, MORE),
            "larger",
            "EKF has larger errors than cross-frame: position ×1.44 [1.25, 1.64], rotation ×1.44 [1.25, 1.64].",
        ),
        (
            (LESS, MORE),
            "open",
            "EKF against cross-frame: in position ×0.80 [0.70, 0.90]; in rotation ×1.44 [1.25, 1.64].",
        ),
        ((LESS, LEVEL), "smaller", "EKF against cross-frame: in position ×0.80 [0.70, 0.90]; rotation cannot be"),
    ],
)
def test_each_quantity_has_its_own_word(both: Any, style: str, sentence: str) -> None:
    found = conclusion(report(ekf=both))
    assert found[0] == style and found[1].startswith(sentence)
    assert "motions over 2 to 5 frames" in found[1]


def test_every_method_is_named_as_in_the_tables() -> None:
    _, text = conclusion(
        report(
            ekf=(MORE, MORE),
            frame_to_frame=(LEVEL, LEVEL),
            cross_frame_wc=(LEVEL, LEVEL),
            cross_frame_cc=(LEVEL, MORE),
            ekf_cv=(LESS, LEVEL),
        )
    )
    assert "Frame-to-frame and cross-frame cannot be told apart: position ×1.03" in text
    assert "Constant-velocity EKF against cross-frame: in position ×0.80 [0.70, 0.90]" in text
    assert "Not told apart from cross-frame in either: per-point WC." in text
    assert "Larger errors than cross-frame in position, rotation or both: per-point CC." in text


def test_a_covariance_that_does_not_hold_is_told_with_its_nees() -> None:
    said = "Errors more than three times as large as estimated (NEES, 6 expected): EKF 136."
    assert said in conclusion(report({"ekf": 136.0}, ekf=(LESS, LEVEL)))[1]
    assert "NEES" not in conclusion(report({"ekf": 53.0}, ekf=(LESS, LEVEL)))[1]  # 9 times 6 is three times σ


def test_why_there_is_no_comparison() -> None:
    content = report()
    assert "cross-frame and another method are needed" in conclusion(content)[1]
    content["methods"]["ekf"] = content["methods"]["cross_frame"] | {"failure": "stopped at frame 3: singular"}
    assert "cannot be compared on this log: EKF stopped at frame 3: singular." in conclusion(content)[1]
    content["methods"]["ekf"]["failure"] = None
    assert "fewer than 40 consecutive frames have ground truth" in conclusion(content)[1]
    assert "no ground truth" in conclusion(content | {"frames_with_ground_truth": 0})[1]
