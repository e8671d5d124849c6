"""Several logs as one comparison: each is one sample, and what they cannot separate is not separated."""

from typing import Any

import numpy as np
import pytest

from stream_sfm.report.over_logs import numbers_over_logs, render_over_logs


def ratio(value: float) -> dict[str, object]:
    return {"value": value, "ci95": [0.9 * value, 1.1 * value]}


def report(ekf: float, *, frame_to_frame: float = 2.0, halves: bool = False, short: bool = False) -> dict[str, Any]:
    """The report of a log whose EKF errs `ekf` times as much as the window, over one frame and over all spans."""
    over = {"cross_frame": 1 / frame_to_frame, "ekf": ekf / frame_to_frame}
    of = {
        key: {f"{kind}_over_frame_to_frame": ratio(value) for kind in ("position", "rotation")}
        | {f"{kind}_from_halves": halves and key == "ekf" for kind in ("position", "rotation")}
        for key, value in over.items()
    }
    of["frame_to_frame"] = dict.fromkeys(("position_over_frame_to_frame", "rotation_over_frame_to_frame"))
    both = {kind: ratio(ekf) for kind in ("position", "rotation")}
    verdict = None if short else {"against": "truth", "ratios": {"ekf": both}}
    return {
        "complete": True, "log": "a.mcap", "frames": 60, "frames_with_ground_truth": 60, "conclusion": "…",
        "methods": {"cross_frame": {"sigma_factor": ekf}, "cross_frame_replayed": {}, "ekf": {"sigma_factor": None}},
        "drift": {"reference": "frame_to_frame", "verdict": verdict, "table": [{"frames": 1, "methods": of}]},
    }  # fmt: skip


def test_ratios_are_geometric_means_over_logs_with_intervals_over_them() -> None:
    found = numbers_over_logs({"a": report(1.2), "b": report(1.25), "c": report(1.22)})
    mean = float(np.cbrt(1.2 * 1.25 * 1.22))
    position = found["verdict"]["ratios"]["ekf"]["position"]
    assert position["value"] == pytest.approx(mean) and position["logs"] == 3
    assert found["verdict"]["behind"] == ["ekf"]
    assert found["conclusion"].startswith("Cross-frame errs less than EKF with plain weights (position ×1.22 [1.1")
    over_one = found["table"][0]["methods"]
    assert over_one["ekf"]["position"]["value"] == pytest.approx(mean)
    assert over_one["frame_to_frame"]["rotation"]["value"] == pytest.approx(2.0)
    assert found["sigma_factor"] == {"cross_frame": [1.2, 1.22, 1.25], "ekf": []}


def test_logs_that_disagree_separate_nothing_however_sure_each_is() -> None:
    found = numbers_over_logs({"a": report(0.5), "b": report(2.1), "c": report(1.6)})
    assert found["verdict"]["level"] == ["ekf"]
    assert found["conclusion"] == "These 3 logs cannot separate cross-frame from EKF with plain weights."


def test_logs_that_say_nothing_count_for_nothing() -> None:
    """Short ones have no ratios; and one from halves is not divided by one against the truth."""
    found = numbers_over_logs({"a": report(1.2), "b": report(1.3, halves=True), "c": report(1.2, short=True)})
    assert found["verdict"]["ratios"]["ekf"]["position"]["logs"] == 2
    assert found["table"][0]["methods"]["ekf"]["position"]["logs"] == 2
    one = numbers_over_logs({"a": report(1.2), "c": report(1.2, short=True)})
    assert one["verdict"] is None and "cannot separate" in one["conclusion"]
    assert "cannot separate" in render_over_logs(one)


def test_the_page_leads_to_the_page_of_each_log() -> None:
    page = render_over_logs(numbers_over_logs({"a": report(1.2), "b<c": report(1.3, halves=True)}))
    assert 'href="a/report.html"' in page and 'href="b%3Cc/report.html"' in page
    assert "b<c" not in page and "EKF with plain weights" in page


def test_between_equal_methods_a_winner_is_named_in_a_twentieth_of_comparisons() -> None:
    rng, trials, named = np.random.default_rng(3), 300, 0
    for _ in range(trials):
        logs = {str(n): report(float(np.exp(0.2 * rng.normal()))) for n in range(4)}
        named += not numbers_over_logs(logs)["verdict"]["level"]
    assert named / trials < 0.05 + 3 * np.sqrt(0.05 * 0.95 / trials)
