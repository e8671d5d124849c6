"""What a finished run can be asked: its errors against ground truth, and to be shown."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import stream_sfm as sfm
from tests.helpers.places import ROOM

FRAMES = 8


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two runs of the sample log, which holds its ground truth."""
    folder = tmp_path_factory.mktemp("runs")
    found = []
    for method in ("cross-frame", "ekf"):
        sfm.replay(ROOM, folder / method, sfm.Config(method=method), sfm.Selection(max_frames=FRAMES))
        found.append(folder / method)
    return found


def test_figures_are_those_of_the_replay(runs: list[Path], cli) -> None:
    for run, found in zip(runs, cli("evaluate", *runs, "--json").json["runs"], strict=True):
        summary = json.loads((run / "summary.json").read_bytes())
        assert (found["run"], found["method"], found["log"]) == (str(run), run.name, str(ROOM))
        told, figures = summary["ground_truth"], found["ground_truth"]
        same = {key for key in told if key in figures and not key.startswith("local_")}
        assert {"ate_rmse_m", "nees_pose_mean", "relative_consistency", "std_truth"} <= same
        assert {key: figures[key] for key in same} == {key: told[key] for key in same}  # poses are stored exactly


def test_the_table_has_the_figures_that_any_run_has(runs: list[Path], tmp_path: Path, cli) -> None:
    assert "Sim(3)" not in (table := cli("evaluate", runs[0]).out) and "motion" in table
    for std in ("0,0", "0.1,0.1"):
        given = (runs[0], "--ground-truth-std", std)
        (found,) = cli("evaluate", *given, "--json").json["runs"]
        factor = found["ground_truth"]["relative_consistency"][0]["factor_own"]
        assert f"{factor:#.3g}" in cli("evaluate", *given).out
    sfm.replay(ROOM, tmp_path, sfm.Config(mono=True), sfm.Selection(max_frames=FRAMES))
    figures = cli("evaluate", tmp_path, "--json").json["runs"][0]["ground_truth"]
    assert f"{1e3 * figures['ate_rmse_sim3_m']:#.3g}" in cli("evaluate", tmp_path).out  # mm


def test_the_truth_is_taken_as_exact_until_its_errors_are_given(runs: list[Path], tmp_path: Path, cli) -> None:
    (exact,) = cli("evaluate", runs[0], "--json").json["runs"]
    (known,) = cli("evaluate", runs[0], "--ground-truth-std", "0.1,0.1", "--json").json["runs"]
    assert known["ground_truth"]["nees_pose_mean"] < 0.1 * exact["ground_truth"]["nees_pose_mean"]
    command = ("replay", ROOM, "--max-frames", FRAMES, "--out")
    assert "against a truth taken as exact" in cli(*command, tmp_path / "a").out
    said = cli(*command, tmp_path / "b", "--ground-truth-std", "0.1,0.1").out
    assert "expected: 6" in said and "exact" not in said


def test_two_batches_say_which_one_drifts_less(runs: list[Path], tmp_path: Path, cli) -> None:
    for batch in ("a", "b"):
        for n in range(3):
            copy = shutil.copytree(runs[0], tmp_path / batch / f"log{n}")
            summary = json.loads((copy / "summary.json").read_bytes())
            (link := tmp_path / f"log{n}.mcap").unlink(missing_ok=True)
            link.symlink_to(ROOM)
            (copy / "summary.json").write_text(json.dumps(summary | {"log": str(link)}))
    (tmp_path / "a/report.html").touch()  # of the batch, which is no run
    said = cli("evaluate", tmp_path / "a", tmp_path / "b").out
    assert f"{tmp_path / 'b'} over {tmp_path / 'a'}, 3 logs: ATE aligned ×1.00 [1.00, 1.00]" in said.replace("\n", " ")
    assert "these 3 logs do not tell which one drifts less" in said
    found = cli("evaluate", tmp_path / "a", tmp_path / "b", "--json").json
    assert len(found["runs"]) == 6 and found["paired"]["ratios"]["t_rel_percent"]["logs"] == 3
    assert cli("evaluate", tmp_path / "a", "--json").json["paired"] is None


def test_runs_stand_side_by_side_on_a_page(runs: list[Path], tmp_path: Path, cli) -> None:
    page = tmp_path / "page.html"
    said = cli("evaluate", *runs, "--out", page).out
    assert "cross-frame" in said and "ekf" in said and "ATE" in said and "NEES" in said
    html = page.read_text()
    assert html.count('class="chart"') == 4 and "No data" not in html
    for run in runs:
        ate = json.loads((run / "summary.json").read_bytes())["ground_truth"]["ate_rmse_aligned_m"]
        assert f">{1e3 * ate:#.3g}</td>" in html, "in millimetres"
        assert f">{run.name}</span>" in html, "its lines are named"
    before = page.read_bytes()
    said = cli("evaluate", runs[0], "--out", tmp_path / "page.pdf", code=2).err
    assert "the name must end in .html" in said and page.read_bytes() == before


@pytest.mark.parametrize("offset", ["1e10", "-1e308", "9.2e9"])
def test_an_offset_beyond_the_stamps_is_told(offset: str, runs: list[Path], tmp_path: Path, cli) -> None:
    truth = tmp_path / "late.tum"
    truth.write_text("1e9 0 0 0 0 0 0 1\n1.1e9 0 0 0 0 0 0 1\n")
    given = ("evaluate", runs[0], "--ground-truth", truth, "--ground-truth-offset", offset)
    assert "leads beyond stamps of 64 bits" in cli(*given, code=(2, 3)).err


def test_a_file_is_the_truth_in_its_own_time(runs: list[Path], tmp_path: Path, cli) -> None:
    """A run compared with its own path, whose stamps are a second early: no error once they are moved."""
    shifted = tmp_path / "path.tum"
    lines = [line.split() for line in (runs[0] / "trajectory.tum").read_text().splitlines()]
    shifted.write_text("\n".join(" ".join([f"{float(t) - 1:.9f}", *pose]) for t, *pose in lines))
    given = ["--ground-truth", str(shifted), "--json"]
    at_another_time = cli("evaluate", runs[0], *given, code=3)
    assert at_another_time.json["runs"][0]["ground_truth"]["frames_compared"] == 0
    assert "no pose belongs to a frame; an offset of 1.000 s would let both begin" in at_another_time.err
    figures = cli("evaluate", runs[0], *given, "--ground-truth-offset", "1").json["runs"][0]["ground_truth"]
    assert figures["frames_compared"] == FRAMES
    assert figures["ate_rmse_m"] < 1e-6, "a micrometre: the digits of the file"
    ignored = ["--ground-truth-offset", "1", "--ignore-ground-truth", "0:3"]
    (found,) = cli("evaluate", runs[0], *given, *ignored).json["runs"]
    assert found["ground_truth"]["frames_compared"] == FRAMES - 3


def test_what_cannot_be_read_of_a_run_is_told(runs: list[Path], tmp_path: Path, cli) -> None:
    damaged = Path(shutil.copytree(runs[0], tmp_path / "damaged"))
    content = bytearray((damaged / "estimates.mcap").read_bytes())
    content[len(content) // 2] ^= 1  # in the chunk of the first frames or in that of the last
    (damaged / "estimates.mcap").write_bytes(content)
    said = cli("evaluate", damaged, "--json", code=3)
    assert 0 < json.loads(said.out)["runs"][0]["ground_truth"]["frames_compared"] < FRAMES
    assert f"warning: {damaged / 'estimates.mcap'} at byte" in said.err


def test_one_run_that_cannot_be_read_does_not_cost_the_others(runs: list[Path], tmp_path: Path, cli) -> None:
    said = cli("evaluate", runs[0], tmp_path, runs[1], "--json", code=3)
    assert [run["run"] for run in said.json["runs"]] == [str(run) for run in runs]
    assert f"warning: {tmp_path} holds no results" in said.err


def test_what_is_not_a_run_is_named(tmp_path: Path, cli) -> None:
    assert f"{tmp_path} holds no results" in cli("evaluate", tmp_path, code=3).err


@pytest.mark.parametrize("with_log", [True, False])
def test_a_run_is_shown_with_the_images_of_its_log(with_log: bool, runs: list[Path], tmp_path: Path, cli) -> None:
    pytest.importorskip("rerun")
    run = runs[0]
    if not with_log:
        run = tmp_path / "moved"
        run.mkdir()
        (run / "estimates.mcap").write_bytes((runs[0] / "estimates.mcap").read_bytes())
    rrd = tmp_path / "run.rrd"
    assert ("shown without images" in cli("view", run, "--rrd", rrd).err) != with_log
    stats = [sys.executable, "-m", "rerun", "rrd", "stats", str(rrd)]
    told = subprocess.run(stats, capture_output=True, text=True, check=True).stdout
    assert "local_structure" in told and ("EncodedImage" in told) == with_log
