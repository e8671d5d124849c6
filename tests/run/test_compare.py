"""Compare: the same numbers as replay, the files, and reports on incomplete logs."""

import json
import os
import re
import signal
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.cli.main import main
from stream_sfm.config import read_config
from stream_sfm.estimators.baselines.frame_to_frame import FrameToFrame
from stream_sfm.estimators.window.cross_frame import CrossFrame
from stream_sfm.logs.recording.stereo_log import open_log
from stream_sfm.run.compare import compare
from stream_sfm.run.replay import replay
from stream_sfm.types import Selection, Trajectory
from tests.helpers.places import DEMO
from tests.helpers.stereo_logs import DISPARITY_PX, Calib, K, Spec, right_calib, write_log

pytestmark = pytest.mark.slow

SIZE = (256, 192)
FIGURES = {
    "ate_rmse_aligned_m", "final_drift_percent", "t_rel_percent", "r_rel_deg_per_100m", "nees_pose_mean",
    "growth_exponent", "ms_per_frame_p50",
}  # fmt: skip
FEW = "frontend.max_tracks=60"
EXACT = "rig.exact=true"  # otherwise the other methods get views without the errors that cross-frame has found
FAST = "cross-frame,ekf,frame-to-frame"


def spec(frames: Any = range(12), **changes: Any) -> Spec:
    k = K.copy()
    k[:2, 2] = SIZE[0] / 2, SIZE[1] / 2
    infos = tuple(Calib(*SIZE, K=k, P=np.c_[k, column]) for column in (np.zeros(3), right_calib().P[:, 3]))
    return Spec(size=SIZE, infos=infos, left=tuple(frames), right=tuple(frames), **changes)


def run(path: Path, out: Path, *more: str) -> tuple[dict[str, Any], str]:
    assert main(["compare", str(path), "--out", str(out), "--quiet", "--methods", FAST, "--set", FEW, *more]) == 0
    return json.loads((out / "report.json").read_text()), (out / "report.html").read_text()


def test_loops_are_a_row_of_their_own(tmp_path: Path) -> None:
    """Where nothing is seen again it says the same as the first method."""
    pytest.importorskip("gtsam")
    log = write_log(tmp_path / "log.mcap", spec(range(8), truth=True))
    report, page = run(log, tmp_path / "out", "--loops")
    first, second, *_ = report["methods"]
    assert (first, second) == ("cross_frame", "cross_frame_loops") and "cross-frame, with loops" in page
    assert report["methods"][first]["ate_rmse_m"] == report["methods"][second]["ate_rmse_m"]


def test_several_logs_are_samples_of_one_comparison(tmp_path: Path, cli) -> None:
    """Each has its folder; one that cannot be read is reported, and the others are compared without it."""
    parts = {"a": range(44), "b": range(10, 58)}
    logs = [write_log(tmp_path / f"{name}.mcap", spec(frames, truth=True)) for name, frames in parts.items()]
    given = (*logs, tmp_path / "none.mcap", "--methods", "cross-frame,frame-to-frame", "--set", FEW)
    said = cli("compare", *given, "--out", tmp_path / "out", code=3)
    assert "none.mcap" in said.err and (
        "These 2 logs cannot separate" in said.out or "Cross-frame errs less" in said.out
    )
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [log["name"] for log in report["logs"]] == ["a", "b"] and (tmp_path / "out" / "report.html").exists()
    alone = [json.loads((tmp_path / "out" / name / "report.json").read_text()) for name in "ab"]
    of_logs = [r["drift"]["verdict"]["ratios"]["frame_to_frame"]["position"]["value"] for r in alone]
    over = report["verdict"]["ratios"]["frame_to_frame"]["position"]
    assert over["value"] == pytest.approx(np.sqrt(np.prod(of_logs))) and over["logs"] == 2
    assert "none.mcap" in cli("compare", tmp_path / "none.mcap", logs[0].parent / "nor.mcap", code=3).err
    truth = tmp_path / "truth.txt"
    assert "one log" in cli("compare", *logs, "--ground-truth", truth, "--out", tmp_path / "o", code=2).err


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, dict[str, Any], str]:
    folder = tmp_path_factory.mktemp("compare")
    log = write_log(folder / "log.mcap", spec(range(26), truth=True))
    return log, folder / "out", *run(log, folder / "out", "--set", EXACT)


@pytest.mark.parametrize("method", FAST.split(","))
def test_numbers_and_files_are_those_of_replay(whole: Any, tmp_path: Path, method: str) -> None:
    log, out, numbers, _ = whole
    config = read_config(None, [f'method="{method}"', FEW, EXACT])
    truth = replay(log, tmp_path, config).summary["ground_truth"]
    key = method.replace("-", "_")
    figures = numbers["methods"][key]
    assert set(figures) >= FIGURES
    for name in FIGURES & set(truth):
        assert figures[name] == truth[name], name
    for name in ("trajectory.tum", "trajectory.kitti", "trajectory.csv", "config.toml"):
        assert (out / key / name).read_bytes() == (tmp_path / name).read_bytes(), name
    summary = json.loads((out / key / "summary.json").read_text())
    assert summary["method"] == method and summary["ground_truth"] == truth
    assert (out / key / "estimates.mcap").exists()


def test_all_methods_have_the_right_calibration_from_their_first_frame_on() -> None:
    """The demo's is a quarter of a pixel off: corrected frame by frame, as that is found, poses jump by up to 45 mm."""
    log, methods = open_log(DEMO), ("cross-frame", "frame-to-frame", "iterated-ekf")
    found = compare(log, selection=Selection(max_frames=20), methods=methods).comparison.runs
    truth = log.ground_truth()
    assert truth is not None
    assert [run.name for run in found] == ["cross-frame", "cross-frame-replayed", *methods[1:]]
    for run in found:
        assert run.stamps_ns.tolist() == truth.stamps_ns[:20].tolist()
        apart_m = np.linalg.norm((run.poses - truth.world_from_cam[:20])[:, :3, 3], axis=1)
        assert apart_m.max() < 0.012, run.name


def test_page_and_replay_do_not_contradict_each_other(whole: Any, tmp_path: Path) -> None:
    """The window that finds the calibration on the way has the row, and the figures, of a replay."""
    _, _, exact, _ = whole
    log = write_log(tmp_path / "log.mcap", spec(range(14), truth=True))
    report, page = run(log, tmp_path / "out")
    truth = replay(log, tmp_path / "alone", read_config(None, [FEW])).summary["ground_truth"]
    figures = report["methods"]["cross_frame_replayed"]
    for name in FIGURES & set(truth):
        assert figures[name] == truth[name], name
    assert figures["nees_pose_mean_without_common"] == pytest.approx(truth["nees_pose_mean"])
    assert "cross-frame, as replayed" in page and "As replayed, finding the calibration" in report["conclusion"]
    assert "cross_frame_replayed" not in exact["methods"]


def test_as_is_the_window_estimates_as_it_would_alone(whole: Any, tmp_path: Path) -> None:
    """It is in two rows, the second by its newest motions, which differ from its poses by corrections."""
    log, *_ = whole
    report, page = run(log, tmp_path / "out", "--methods", "cross-frame,iterated-ekf", "--as-is")
    replay(log, tmp_path, read_config(None, [FEW]))
    name = "trajectory.csv"
    assert (tmp_path / "out" / "cross_frame" / name).read_bytes() == (tmp_path / name).read_bytes()
    assert list(report["methods"]) == ["cross_frame", "cross_frame_added", "iterated_ekf"]
    assert report["drift"]["as_is"] and "cross-frame, motions added" in page
    poses, added = (report["methods"][key]["ate_rmse_m"] for key in ("cross_frame", "cross_frame_added"))
    assert 0 < added < 5 * poses and added != poses


def test_no_method_depends_on_the_others_or_their_order(whole: Any) -> None:
    """The window neither."""
    log, *_ = whole
    orders = ("cross-frame", "frame-to-frame"), ("frame-to-frame", "iterated-ekf", "cross-frame")
    found = [compare(log, config=read_config(None, [FEW]), methods=order).comparison.runs for order in orders]
    a, b = ({run.name: run for run in runs} for runs in found)
    for name in orders[0]:
        assert np.array_equal(a[name].poses, b[name].poses)


def test_without_ground_truth_there_is_a_report_all_the_same(tmp_path: Path) -> None:
    numbers, html = run(write_log(tmp_path / "log.mcap", spec()), tmp_path / "out")
    assert "no ground truth" in html
    for key, figures in numbers["methods"].items():
        assert figures["ate_rmse_aligned_m"] is None
        if key == "cross_frame_replayed":  # by the first pass, which writes no files
            continue
        end = json.loads((tmp_path / "out" / key / "summary.json").read_text())["end"]
        assert figures["end_std_position_m"] == end["std_position_m"]
        assert figures["end_std_heading_deg"] == end["std_heading_deg"]
    assert "away from cross-frame" in html and "ATE" not in html
    assert numbers["drift"]["against"] == "halves" and "σ would have to grow by" in html
    assert all(
        figures["sigma_factor"] > 0 for key, figures in numbers["methods"].items() if key != "cross_frame_replayed"
    )
    assert numbers["conclusion"] in html and "halves of the tracks" in numbers["conclusion"]
    assert len((tmp_path / "out" / "ekf" / "trajectory.tum").read_text().splitlines()) == 12


def test_the_page_is_one_file_and_nothing_in_it_is_code(tmp_path: Path) -> None:
    """Of a log with a jump in time, a name that is HTML, and too few frames for most figures."""
    log = write_log(tmp_path / "<script>alert(1).mcap", spec([*range(8), *range(20, 24)], truth=True))
    numbers, html = run(log, tmp_path / "out")
    outside = re.findall(r'(?:src|href)="(?!data:|#)[^"]*"|url\((?!#)|@import|https?://(?!www\.w3\.org/)', html)
    assert outside == [] and len(html) < 8e6
    assert "<script>alert" not in html and "&lt;script&gt;alert" in html
    assert numbers["gaps_before_frames"] == [8] and "Time gap before frame 8" in html
    assert numbers["ekf_over_cross_frame"] is None  # which takes 40 frames in a row


def test_the_matches_of_the_middle_frame_are_kept_with_its_image(tmp_path: Path) -> None:
    """The wall moves by 2 px per frame, and all of it has one disparity."""
    log = write_log(tmp_path / "log.mcap", spec(truth=True))
    found = compare(log, config=read_config(None, [FEW, EXACT]), methods=["frame-to-frame"]).comparison.needles
    assert found is not None and found.frame == 6 and found.image.shape == SIZE[::-1]
    moved = found.temporal_px[found.used_again]
    assert len(moved) > 20 and np.median(moved[:, 1] - moved[:, 0], axis=0) == pytest.approx([-2, 0], abs=0.1)
    left, right = found.stereo_px[found.used].swapaxes(0, 1)
    assert np.median(left - right, axis=0) == pytest.approx([DISPARITY_PX, 0], abs=0.1)


@pytest.mark.parametrize("part, said", [(slice(4, 9), "covers 5 of 12 frames"), (slice(0, 0), "none at the time")])
def test_ground_truth_of_a_part_or_of_another_time(part: slice, said: str, tmp_path: Path) -> None:
    log = open_log(write_log(tmp_path / "log.mcap", spec(truth=True)))
    truth = log.ground_truth()
    assert truth is not None
    other = Trajectory(np.arange(3, dtype=np.int64), np.tile(np.eye(4), (3, 1, 1)))
    log.use_ground_truth(Trajectory(truth.stamps_ns[part], truth.world_from_cam[part]) if part.stop else other)
    report = compare(log, tmp_path / "out", read_config(None, [FEW]), methods=("ekf",)).report
    assert report["frames_with_ground_truth"] == len(range(12)[part])
    assert report["methods"]["ekf"]["nees_pose_mean"] is None
    assert said in (tmp_path / "out/report.html").read_text()


@pytest.mark.parametrize("error", [ValueError("no such view"), KeyError(3), np.linalg.LinAlgError("singular")])
def test_a_method_fails_alone_whatever_it_raises(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And what finds the calibration may fail, too: then it is as found until then."""

    def fails(self: Any, observations: Any) -> Any:
        if observations.frame_index == 2:
            raise error
        return works(self, observations)

    works = CrossFrame.step
    monkeypatch.setattr(CrossFrame, "step", fails)
    log = write_log(tmp_path / "log.mcap", spec(range(5)))
    result = compare(log, methods=("cross-frame", "frame-to-frame"))
    failed, whole = result.comparison.runs
    assert failed.failure.startswith("stopped at frame 2: ") and str(error) in failed.failure
    assert len(failed) == 2 and len(whole) == 5 and not result.report["complete"]


def test_one_method_that_fails_does_not_cost_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli) -> None:
    """Nothing is written without a folder; a sink is given no estimate of another method."""
    works = FrameToFrame.step

    def broken_later(self: Any, observations: Any) -> Any:
        if observations.frame_index == 2:
            raise np.linalg.LinAlgError("singular")
        return works(self, observations)

    monkeypatch.setattr(FrameToFrame, "step", broken_later)
    log, poses = write_log(tmp_path / "log.mcap", spec(range(5), truth=True)), []
    watched = Mock(write=lambda estimate, _: poses.append(estimate.world_from_cam))
    monkeypatch.chdir(tmp_path)
    result = compare(log, methods=("frame-to-frame", "ekf"), sinks=[watched])
    failed, ekf = result.comparison.runs
    assert np.array_equal(poses, failed.poses) and len(poses) == 2 and watched.close.call_count == 1
    methods = result.report["methods"]
    assert methods["frame_to_frame"]["failure"] == "stopped at frame 2: singular" and not result.report["complete"]
    assert methods["ekf"]["ate_rmse_aligned_m"] is not None and len(ekf) == 5
    assert result.out_dir is None and [p.name for p in tmp_path.iterdir()] == ["log.mcap"]
    cli("compare", log, "--out", tmp_path / "out", "--quiet", "--methods", FAST, code=1)
    assert "stopped at frame 2" in (tmp_path / "out/report.html").read_text()


def test_an_interruption_still_gives_a_report(tmp_path: Path) -> None:
    def stop(estimate: Any, _: object) -> None:
        if estimate.frame_index == 4:
            os.kill(os.getpid(), signal.SIGINT)

    log = open_log(write_log(tmp_path / "log.mcap", spec()))
    result = compare(log, tmp_path / "out", methods=("frame-to-frame",), sinks=[Mock(write=stop)])
    assert result.comparison.interrupted and not result.report["complete"] and result.report["frames"] == 5
    assert "interrupted after 5 frames" in (tmp_path / "out" / "report.html").read_text()
    assert len((tmp_path / "out" / "frame_to_frame" / "trajectory.tum").read_text().splitlines()) == 5


def test_an_interruption_of_the_first_pass_leaves_what_was_observed_to_all_methods(tmp_path: Path) -> None:
    """A second one, in the second pass, ends that too, with all methods at the same frame."""
    count = iter(range(1, 100))

    def stop() -> None:
        if next(count) in (7, 7 + 3):
            os.kill(os.getpid(), signal.SIGINT)

    log = open_log(write_log(tmp_path / "log.mcap", spec()))
    result = compare(log, tmp_path / "out", methods=("frame-to-frame", "ekf"), on_frame=stop)
    assert [len(run) for run in result.comparison.runs] == [3, 3] and result.comparison.interrupted
    assert "interrupted after 7 frames" in result.report["warnings"][0]
    assert len((tmp_path / "out" / "ekf" / "trajectory.tum").read_text().splitlines()) == 3


def test_frames_whose_truth_is_wrong_can_be_left_out(tmp_path: Path) -> None:
    """One true pose is off by half a metre: nothing judges it, and without its frame the error is small."""
    log = write_log(tmp_path / "log.mcap", spec(range(30), truth=True))
    truth = open_log(log).ground_truth()
    assert truth is not None
    poses = truth.world_from_cam.copy()
    poses[14, 2, 3] += 0.5
    opened = open_log(log, ground_truth=Trajectory(truth.stamps_ns, poses))
    options = {"config": read_config(None, [FEW]), "methods": ("ekf",)}
    found, left_out = (compare(opened, ignore_ground_truth=r, **options).report for r in ((), [(14, 15)]))
    assert found["methods"]["ekf"]["ate_rmse_m"] > 0.05 > left_out["methods"]["ekf"]["ate_rmse_m"]  # 0.5/√30 = 0.09
    assert left_out["frames_ignored"] == [[14, 15]] and left_out["frames_with_ground_truth"] == 29


def test_ground_truth_that_is_not_a_rigid_motion_is_refused(tmp_path: Path, cli) -> None:
    log = write_log(tmp_path / "log.mcap", spec(range(3), truth=True))
    truth = open_log(log).ground_truth()
    assert truth is not None
    mirrored = truth.world_from_cam @ np.diag([1, -1, 1, 1.0])
    rows = np.c_[truth.stamps_ns / 1e9, mirrored[:, :3].reshape(-1, 12)]
    np.savetxt(tmp_path / "truth.txt", rows, fmt="%.9f")
    for command in ("replay", "compare"):
        given = ["--ground-truth", str(tmp_path / "truth.txt"), "--out", str(tmp_path / "out")]
        assert "mirrored" in cli(command, log, *given, code=3).err
    with pytest.raises(sfm.LogError, match="all zeros"):
        compare(open_log(log, ground_truth=Trajectory(truth.stamps_ns, 0 * mirrored)), methods=("frame-to-frame",))
