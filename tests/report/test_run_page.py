"""The page of one run: what its sentence says, one unit for all lengths, what it shows where something is missing."""

import re
from typing import Any

import numpy as np
import pytest

from stream_sfm.camera.models import Camera
from stream_sfm.camera.refinement import TERMS
from stream_sfm.config import RigConfig
from stream_sfm.evaluation.association import without_frames
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.report.calibration_field import CalibrationError, calibration_error, picture
from stream_sfm.report.lengths import METRES, MILLIMETRES, LengthUnit, unit_for
from stream_sfm.report.records import RunRecord
from stream_sfm.report.run_page import conclusion_of_run, render_run
from stream_sfm.report.view import View
from stream_sfm.rig_model.estimate import RigEstimate
from stream_sfm.rig_model.model import RigModel
from stream_sfm.types import FrameEstimate, Status, StereoFrame, Trajectory

FRAMES = 30
STAMPS = np.arange(FRAMES) * 100_000_000


def record(status: Status = Status.OK) -> RunRecord:
    """Along an arc, with σ that grows with the frames."""
    found, pose, none = RunRecord("cross-frame"), np.eye(4), np.empty(0, np.int64)
    points, covs = np.empty((0, 3)), np.empty((0, 3, 3))
    for k in range(FRAMES):
        cov = k * np.diag([0.01**2] * 3 + [1e-6] * 3)
        counts = dict.fromkeys(("tracked", "new", "used", "rejected"), 100)
        local, times_ms = (none, points, covs, points, covs, none, np.empty((0, 4, 4))), {"estimator": 1.0}
        about = {"frame_index": k, "stamp_ns": int(STAMPS[k]), "counts": counts, "timings_ms": times_ms}
        found.add(FrameEstimate(status, "", pose, cov, *local, nis=1.0, nis_dof=1, **about))
        pose = pose @ se3.exp([0, 0, 0.1, 0, 0.02, 0])
    return found


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


def test_the_sentence_says_how_large_errors_and_sigma_are_and_what_went_wrong() -> None:
    text = conclusion_of_run(summary(ground_truth=TRUTH))
    assert "30 frames were estimated, none of them degraded or lost." in text
    assert "off by 1 mm RMS" in text and "0.5 % of its length" in text
    assert "2 times as large as the estimated σ (NEES 24, 6 expected)" in text
    frames = summary()["frames"] | {"lost": 3, "degraded": 2}
    text = conclusion_of_run(summary(frames=frames, complete=False, end={"std_position_m": 0.05}))
    assert "2 degraded, 3 lost." in text and "at the end is 0.05 m" in text and "not complete" in text


@pytest.mark.parametrize("truth", [True, False])
def test_the_page_is_one_file(truth: bool) -> None:
    found = {"ground_truth": TRUTH} if truth else {"end": {"std_position_m": 0.05}}
    page = render_run(summary(**found), record(), record().trajectory() if truth else None)
    assert "a &amp; b.mcap" in page and ("Position error and σ" in page) == truth
    outside = re.findall(r'(?:src|href)="(?!data:|#)[^"]*"|url\(|@import', page)
    assert outside == []


def test_frames_without_truth_are_left_out() -> None:
    known = without_frames(record().trajectory(), STAMPS, [(10, 20)])
    page = render_run(summary(ground_truth=TRUTH), record(Status.LOST), known)
    assert "Position error and σ" in page and "lost, frames 0 to 29" in page


@pytest.mark.parametrize(("off_m", "unit"), [(0.05, MILLIMETRES), (3.0, METRES)])
def test_chart_and_table_of_a_run_have_one_unit(off_m: float, unit: LengthUnit) -> None:
    poses = record().poses
    poses[1:] = poses[1:] @ se3.exp([off_m, 0, 0, 0, 0, 0])
    figures = TRUTH | {"ate_rmse_m": off_m, "ate_rmse_aligned_m": 0.5 * off_m}
    page = render_run(summary(ground_truth=figures), record(), Trajectory(STAMPS, poses))
    assert f"<th>ATE<br><small>{unit.name}</small></th>" in page
    assert f"<td>{off_m * unit.per_m:#.3g}</td>".replace(".<", "<") in page
    chart = re.search(r'aria-label="Position error and σ".*?</svg>', page, re.DOTALL)
    assert chart and f">{unit.name}</text>" in chart[0]


def test_small_lengths_are_in_millimetres() -> None:
    assert unit_for([0.001, np.nan, -0.9], None, np.zeros((2, 2))) == MILLIMETRES
    assert unit_for([0.001], [-1.5]) == METRES
    assert unit_for() == unit_for([np.nan]) == MILLIMETRES


def test_spans_are_columns_and_each_part_of_the_image_has_its_error_with_sigma() -> None:
    tracks = [{"frames": 1, "factor": 0.9}, {"frames": 2, "factor": 1.2}]
    rig = {"text": "agrees", "terms": list(TERMS[:1]), "error_px": [0.1], "std_px": [0.2]}
    error_px = np.array([[0.21, -0.4, 0.0], [0.1, -0.2, 0.3]])
    field = CalibrationError(rig, error_px, np.full((2, 3), 0.05))
    page = render_run(summary(ground_truth=TRUTH, self_test={"tracks": tracks}, rig=rig), record(), None, field)
    rows = dict(re.findall(r"<tr><th>([^<]*)</th>((?:<td>.*?</td>)+)</tr>", page))
    assert re.findall(r"[\d.]+|–", rows["against ground truth"]) == ["1.10", "–"]
    assert re.findall(r"[\d.]+|–", rows["halves of the tracks"]) == ["0.90", "1.20"]
    shown = re.findall(r">([+−][0-9.]+) ± 0.05<", page)
    assert [float(x.replace("−", "-")) for x in shown] == error_px.ravel().tolist()
    assert not picture(None)


def test_a_refined_calibration_is_told_whole() -> None:
    """Nothing is left to correct after a refinement; what is told is what the given calibration has wrong."""
    projection = StereoProjection(
        f_px=300.0, cx_left_px=160.0, cx_right_px=160.0, cy_px=120.0, baseline_m=0.1, width=320, height=240
    )
    n = len(RigModel.of(projection, RigConfig()))
    mean, cov = np.zeros(n), 1e-4 * np.eye(n)
    mean[0] = 0.25  # the right image is too far right: less disparity
    found = calibration_error(projection, RigEstimate(mean, cov, 1.0, mean, cov, np.ones(n), refined=mean))
    assert found is not None and found.disparity_px == pytest.approx(-0.25, abs=1e-9)
    assert "refined by 0.25 px of disparity" in found.numbers["text"]
    assert calibration_error(projection, None) is None


def test_the_view_is_of_the_second_half_and_shows_where_points_came_from() -> None:
    """A point on the optical axis moves right by ten pixels; one behind the camera is not shown."""
    view = View(Camera(64, 48, np.array([[50.0, 0, 32], [0, 50.0, 24], [0, 0, 1]])))
    assert not view.figure()
    for k in range(7):
        points = np.array([[0.2 * k, 0.0, 1.0], [0.0, 0.0, -1.0]])
        local = (np.array([7, 8]), points, np.zeros((2, 3, 3)), points, np.zeros((2, 3, 3)))
        window, about = (np.empty(0, np.int64), np.empty((0, 4, 4))), {"counts": {}, "timings_ms": {}}
        estimate = FrameEstimate(
            Status.OK, "", np.eye(4), np.eye(6), *local, *window, frame_index=k, stamp_ns=k, **about
        )
        view.write(estimate, StereoFrame(k, np.full((48, 64), 9 * k, np.uint8), np.zeros((48, 64), np.uint8)))
    figure = str(view.figure())
    assert "left image of frame 4: 1 points" in figure
    assert 'd="M62.0 24.0L72.0 24.0"' in figure  # 50 px · 0.6 and 0.8, from the middle
