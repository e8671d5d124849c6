"""The page of one run: what its sentence says, and what it shows of runs that are short of something."""

import re
from typing import Any

import numpy as np
import pytest

from stream_sfm.evaluation.association import without_frames
from stream_sfm.geometry import se3
from stream_sfm.report.records import CalibrationError
from stream_sfm.report.run_page import RunColumns, _tube, conclusion_of_run, render_run
from stream_sfm.types import Status, Trajectory

FRAMES = 30
STAMPS = np.arange(FRAMES) * 100_000_000


def trajectory(std_m: float = 0.01) -> Trajectory:
    """Along an arc, with σ that grows with the frames."""
    poses = [np.eye(4)]
    for _ in range(FRAMES - 1):
        poses.append(poses[-1] @ se3.exp([0, 0, 0.1, 0, 0.02, 0]))
    cov = np.arange(FRAMES)[:, None, None] * np.diag([std_m**2] * 3 + [1e-6] * 3)
    return Trajectory(STAMPS, np.array(poses), cov)


def columns(statuses: list[Status] | None = None) -> RunColumns:
    ones = np.ones(FRAMES)
    counts = {name: 100 * ones for name in ("tracked", "new", "used", "rejected")}
    times = {name: ones for name in ("decode", "frontend", "estimator", "total")}
    return RunColumns(trajectory(), statuses or [Status.OK] * FRAMES, counts, ones, times)


def summary(**changes: Any) -> dict[str, Any]:
    frames = {"estimated": FRAMES, "paired": FRAMES, "degraded": 0, "lost": 0, "dropped": 0, "backwards": 0}
    plain = {
        "log": "/logs/a & b.mcap", "method": "cross-frame", "unscaled": False, "unit_of_length": "metre",
        "frames": frames, "problems": [], "warnings": [], "complete": True, "duration_s": 2.9, "path_length_m": 2.9,
        "frames_per_s": 30.0, "peak_rss_mib": 100.0,
    }  # fmt: skip
    return plain | changes


TRUTH = {
    "ate_rmse_m": 0.002, "ate_rmse_aligned_m": 0.001, "final_drift_percent": 0.5, "t_rel_percent": 0.1,
    "r_rel_deg_per_100m": 1.0, "scale_error_percent": 0.0, "nees_pose_mean": 24.0,
    "local_structure_median_m": None, "local_structure_error_over_sigma": None,
    "relative_consistency": [{"frames": 1, "factor": 1.1}],
}  # fmt: skip


def test_the_sentence_says_how_large_errors_and_sigma_are() -> None:
    text = conclusion_of_run(summary(ground_truth=TRUTH))
    assert "30 frames were estimated, none of them degraded or lost." in text
    assert "off by 1 mm RMS" in text and "0.5 % of its length" in text
    assert "2 times as large as the estimated σ (NEES 24 for 6)" in text


def test_the_sentence_names_what_went_wrong() -> None:
    frames = summary()["frames"] | {"lost": 3, "degraded": 2}
    text = conclusion_of_run(summary(frames=frames, complete=False, end={"std_position_m": 0.05}))
    assert "2 degraded, 3 lost." in text and "σ of 0.05 m" in text and "not complete" in text


@pytest.mark.parametrize("truth", [True, False])
def test_the_page_is_one_file(truth: bool) -> None:
    found = {"ground_truth": TRUTH} if truth else {"end": {"std_position_m": 0.05}}
    page = render_run(summary(**found), columns(), trajectory() if truth else None)
    assert "a &amp; b.mcap" in page and "±3σ" in page and ("Position error and σ" in page) == truth
    outside = re.findall(r'(?:src|href)="(?!data:|#)[^"]*"|url\(|@import', page)
    assert outside == []


def test_frames_without_truth_are_left_out() -> None:
    known = without_frames(trajectory(), STAMPS, [(10, 20)])
    page = render_run(summary(ground_truth=TRUTH), columns([Status.LOST] * FRAMES), known)
    assert "Position error and σ" in page and "lost, frames 0 to 29" in page


def test_the_tube_is_as_wide_as_it_says() -> None:
    """Three σ across the path on both sides, times the factor."""
    t = trajectory(std_m=0.01)
    assert t.cov_pose is not None
    edges, factor = _tube(t.world_from_cam, t.cov_pose, 0, 2)
    at = t.world_from_cam[:, [0, 2], 3]
    for edge in (edges[:FRAMES], edges[FRAMES + 1 :]):
        distance = np.linalg.norm(edge - at, axis=1)
        assert distance == pytest.approx(factor * 3 * 0.01 * np.sqrt(np.arange(FRAMES)))
    narrow = trajectory(std_m=1e-6)
    assert narrow.cov_pose is not None
    assert _tube(narrow.world_from_cam, narrow.cov_pose, 0, 2)[1] == 1000


def test_spans_are_columns_and_the_field_of_the_calibration_is_shown() -> None:
    tracks = [{"frames": 1, "factor": 0.9}, {"frames": 2, "factor": 1.2}]
    rig = {"text": "agrees", "terms": ["1"], "error_px": [0.1], "std_px": [0.2]}
    field = CalibrationError(rig, np.array([[-0.25, 0.1]]), np.array([[0.03, 0.03]]))
    page = render_run(summary(ground_truth=TRUTH, self_test={"tracks": tracks}, rig=rig), columns(), None, field)
    rows = dict(re.findall(r"<tr><th>([^<]*)</th>((?:<td>.*?</td>)+)</tr>", page))
    assert re.findall(r"[\d.]+|–", rows["against ground truth"]) == ["1.10", "–"]
    assert re.findall(r"[\d.]+|–", rows["halves of the tracks"]) == ["0.90", "1.20"]
    assert "−0.25 ± 0.03" in page
