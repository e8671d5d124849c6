"""Many logs at once: a corrupt or killed one does not affect the others; a rerun does only what is missing."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.batch import job as jobs
from stream_sfm.batch.job import RESULTS, Job, run_job
from stream_sfm.config import Config, config_to_toml
from stream_sfm.results.trajectory_files import tum_line
from tests.batch.running import GOOD, NEEDS_PROC, in_the_midst, outcomes
from tests.helpers.same_results import assert_same_results

pytestmark = [NEEDS_PROC, pytest.mark.slow]


def test_a_corrupt_and_a_killed_log_do_not_harm_the_others(first: Any, logs: Path) -> None:
    out, found, page = first
    assert set(found) == {*GOOD, "corrupt", "victim"}
    for name in GOOD:
        assert found[name]["status"] == "done" and found[name]["summary"]["complete"], name
        assert {p.name for p in (out / name).iterdir()} == {*RESULTS, "job.json", "report.html"}
        assert f'href="{name}/report.html"' in page and name in (out / name / "report.html").read_text()
    assert found["corrupt"]["status"] == found["victim"]["status"] == "failed"
    assert "corrupt.mcap holds no message" in found["corrupt"]["reason"]
    assert "SIGKILL" in found["victim"]["reason"] and "memory" in found["victim"]["reason"]
    assert (out / "victim" / "trajectory.tum.part").read_text().count("\n") >= 1
    assert "3 of 5 logs done, 2 failed." in page
    shown = page.replace("<wbr>", "")
    assert found["corrupt"]["reason"] in shown and found["victim"]["reason"] in shown
    assert page.count('class="chart"') == len(GOOD)
    links = set(re.findall(r'<a href="([^"]*)">', page))
    assert links == {f"{name}/report.html" for name in GOOD} and all((out / link).is_file() for link in links)
    loads = re.sub("<a [^>]*>", "", page)
    assert not re.findall(r'(?:src|href)="(?!data:|#)|url\((?!#)|@import|https?://(?!www\.w3\.org/2000/svg)', loads)


def test_results_are_those_of_a_replay(first: Any, logs: Path, tmp_path: Path, cli) -> None:
    out, found, _ = first
    cli("replay", logs / "good2.mcap", "--out", tmp_path / "alone", "-q")
    assert_same_results(out / "good2", tmp_path / "alone")
    alone = json.loads((tmp_path / "alone" / "summary.json").read_text())
    assert found["good2"]["summary"]["ground_truth"] == alone["ground_truth"]


def test_a_rerun_does_only_what_is_missing(first: Any, logs: Path, cli) -> None:
    out, _, _ = first
    before = {name: (out / name / "estimates.mcap").stat().st_mtime_ns for name in GOOD}
    said = cli("batch", logs, "--out", out, "--json", code=3)
    content = json.loads(said.out)
    assert content == json.loads((out / "batch.json").read_text())
    assert content["counts"] == {"done": 4, "failed": 1} and content["reused"] == 3
    assert {name for name, log in outcomes(out).items() if not log["reused"]} == {"corrupt", "victim"}
    assert before == {name: (out / name / "estimates.mcap").stat().st_mtime_ns for name in GOOD}
    assert not list((out / "victim").glob("*.part"))


def test_done_means_the_same_log_configuration_selection_and_software(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_results(job: Job) -> tuple[str, str]:
        for name in RESULTS:
            (job.folder / name).write_text("{}")
        return "done", ""

    monkeypatch.setattr(jobs, "_replay", write_results)
    log, moved, calibration = tmp_path / "a.mcap", tmp_path / "moved.mcap", tmp_path / "c" / "left.toml"
    calibration.parent.mkdir()
    for path, text in ((log, "first"), (moved, "first"), (calibration, "[left]")):
        path.write_text(text)
    job = Job("a", log, tmp_path / "a", config_to_toml(Config()), (), (), tmp_path / "stop")

    def anew(**changes: Any) -> None:
        changed = replace(job, **changes)
        assert not run_job(changed).reused and run_job(changed).reused, changes

    anew()
    assert run_job(replace(job, log=moved)).reused
    for change in ({"config_toml": "x"}, {"options": ("--stride=2",)}, {"inputs": (calibration.parent,)}):
        anew(**change)
    calibration.write_text("[right]")
    anew(inputs=(calibration.parent,))
    log.write_text("second")
    anew()
    monkeypatch.setattr(jobs, "__version__", "9.9")
    elsewhere = run_job(job)  # made by another version than the worker's
    assert elsewhere.status == "failed" and "its worker has stream-sfm 9.9" in elsewhere.reason
    assert elsewhere.reason.endswith("install the same version on both")
    job = replace(job, software_version="9.9")
    anew()
    (job.folder / "trajectory.tum").unlink()
    assert not run_job(job).reused
    refused = run_job(replace(job, log=moved))
    assert refused.status == "failed" and "another log" in refused.reason and run_job(job).reused


def test_ctrl_c_keeps_what_is_done(logs: Path, tmp_path: Path) -> None:
    """To the whole group of processes, as a terminal does it: the victim's process must not hear of it twice."""
    out = tmp_path / "out"
    given = [logs / "good0.mcap", logs / "victim.mcap", logs / "good1.mcap"]
    command = [sys.executable, "-m", "stream_sfm", "batch", *map(str, given), "--out", str(out), "--workers", "1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True) as run:
        assert in_the_midst(logs / "victim.mcap", out / "victim") is not None
        os.killpg(run.pid, signal.SIGINT)
        _, errors = run.communicate(timeout=1800)
    assert run.returncode == 130 and b"Traceback" not in errors
    found = outcomes(out)
    assert {name: log["status"] for name, log in found.items()} == {
        "good0": "done", "victim": "interrupted", "good1": "interrupted",
    }  # fmt: skip
    frames = found["victim"]["summary"]["frames"]["estimated"]
    assert len(np.loadtxt(out / "victim" / "trajectory.tum", ndmin=2)) == frames > 0
    assert found["victim"]["reason"] == f"after {frames} frames"
    assert found["good1"]["reason"] == "not started" and not (out / "good1").exists()
    assert not (out / "stop").exists()


def test_wrong_use_begins_nothing(logs: Path, tmp_path: Path, cli) -> None:
    out = tmp_path / "out"
    (tmp_path / "empty").mkdir()
    good = logs / "good0.mcap"
    for arguments, code, said in (
        ((good, "--method", "magic"), 2, "magic"),
        ((good, "--set", "widow.frames=8"), 2, "widow"),
        ((good, "--calibration", "missing.toml"), 2, "missing.toml"),
        ((good, "--workers", os.cpu_count(), "--scheduler", "tcp://127.0.0.1:1"), 2, "exclude each other"),
        ((tmp_path / "empty",), 3, "empty"),
    ):
        assert said in cli("batch", *arguments, "--out", out, "--quiet", code=code).err
        assert not out.exists()


def test_a_missing_log_is_reported_and_the_others_done(logs: Path, tmp_path: Path, cli) -> None:
    said = cli("batch", "gone.mcap", logs / "good1.mcap", "--out", tmp_path, "--stride", "2", code=3)
    assert "stream-sfm: gone: failed: " in said.err and "gone.mcap: No such file" in said.err
    assert "1 of 2 logs done, 1 failed." in said.out and str(tmp_path / "report.html") in said.out
    assert outcomes(tmp_path)["good1"]["summary"]["frames"]["estimated"] == 2


def test_logs_are_compared_with_the_files_that_are_named_after_them(logs: Path, tmp_path: Path, cli) -> None:
    """The truth twice as large: the scale must say so."""
    truth = sfm.open_log(logs / "good2.mcap").ground_truth()
    assert truth is not None
    doubled = truth.world_from_cam.copy()
    doubled[:, :3, 3] *= 2
    lines = [tum_line(stamp, pose) for stamp, pose in zip(truth.stamps_ns.tolist(), doubled, strict=True)]
    (tmp_path / "good2.txt").write_text("".join(lines))
    cli("batch", logs / "good2.mcap", "--out", tmp_path / "out", "--ground-truth", tmp_path, "-q")
    found = outcomes(tmp_path / "out")["good2"]["summary"]["ground_truth"]["scale_error_percent"]
    assert found == pytest.approx(-50, abs=1)
