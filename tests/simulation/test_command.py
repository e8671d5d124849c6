"""`stream-sfm simulate` end to end, with few trials of short scenes."""

import csv
import dataclasses
import json
import re
import sys
from contextlib import nullcontext
from typing import get_args

import pytest

import stream_sfm as sfm
from stream_sfm.cli import simulate
from stream_sfm.simulation import calibration, figure6, rates, studies
from stream_sfm.simulation.measure import Method
from stream_sfm.simulation.scenes import Scene
from stream_sfm.simulation.tables import tables

TRIALS = ("--trials", "2", "--workers", "1", "--out")


@pytest.fixture
def short(monkeypatch):
    """The same studies on short scenes."""
    small = Scene(frames=6, track_length=4)
    for name in studies.CONDITIONS:
        compared = studies.judged(small, (3, 5), (Method("cross-frame"), Method("ekf")), bound=name != "200_frames")
        monkeypatch.setitem(studies.CONDITIONS, name, compared)
    noisy = dataclasses.replace(small, std_px=0.15, round_off=False, autocorrelation=0.75)
    for name in calibration.CONDITIONS:
        short = calibration.condition(noisy, name != "lasting_errors", (3, 5))
        monkeypatch.setitem(calibration.CONDITIONS, name, short)
    monkeypatch.setattr(figure6, "SCENE", dataclasses.replace(small, frames=4))
    monkeypatch.setattr(figure6, "FRAMES", (1, 2, 3))
    monkeypatch.setattr(rates, "RUNS", {"general_slow": studies.judged(small, (3, 4, 5), rates.READINGS)})
    monkeypatch.setattr(rates, "LAST_FRAMES", (3, 5))
    monkeypatch.setattr(rates, "BATCHES", (1, 2))


@pytest.mark.parametrize("experiment", get_args(simulate.Experiment))
def test_writes_results_tables_and_figures(experiment, short, tmp_path, cli):
    captured = cli("simulate", experiment, "--latex", *TRIALS, tmp_path)
    assert "cross-frame" in captured.out
    assert all(line.startswith("simulate ") for line in captured.err.splitlines())  # a slow run shows progress
    report = json.loads((tmp_path / "results.json").read_text())
    assert (report["experiment"], report["trials"], report["seed"]) == (experiment, 2, 0)
    check_pictures({path.name: path for path in tmp_path.glob("figure6.*")}, experiment)
    page = (tmp_path / "report.html").read_text()
    assert ("<svg" in page) == (experiment != "consistency") and "<table" in page
    assert "_" not in re.sub(r"<(style|script|svg).*?</\1>|<[^>]*>|stream_sfm", "", page, flags=re.DOTALL)  # in words
    check_tables(report, tmp_path)


def test_an_interruption_keeps_the_finished_trials_and_leaves_no_empty_folder(short, tmp_path, cli, monkeypatch):
    class Advance:
        def __init__(self, most):
            self.left = most

        def __call__(self, *_args, **_known):
            self.left -= 1
            if not self.left:
                raise KeyboardInterrupt

    for most, kept in ((1, False), (4, True)):
        monkeypatch.setattr("stream_sfm.cli.progress.counter", lambda *_, n=most: nullcontext(Advance(n)))
        out = tmp_path / str(most)
        said = cli("simulate", "figure6", "--trials", "9", "--workers", "1", "--out", out, code=130)
        assert out.exists() == kept
        if kept:
            report = json.loads((out / "results.json").read_text())
            assert report["interrupted"] and 2 <= report["trials"] < 9
            assert f"interrupted: {report['trials']} of 9 trials are in the results" in said.err


def check_pictures(pictures, experiment):
    assert set(pictures) == ({"figure6.png", "figure6.svg"} if experiment == "figure6" else set())
    if pictures:
        assert pictures["figure6.png"].stat().st_size > 10_000  # an empty picture has 3 kB
        assert "<svg" in pictures["figure6.svg"].read_text()


def check_tables(report, folder):
    """No table has an empty column, and the CSV file has every value."""
    with open(folder / "results.csv", newline="") as stream:
        lines = list(csv.DictReader(stream))
    found = tables(report)
    assert found and all(float(line["low"] or line["value"]) <= float(line["value"]) for line in lines)
    for table in found:
        assert all(any(values[k] is not None for _, values in table.rows) for k in range(len(table.columns)))
        assert not any("_" in word for names, _ in table.rows for word in names)
    assert len(lines) == sum(value is not None for table in found for _, values in table.rows for value in values)
    latex = (folder / "results.tex").read_text()
    assert latex.count("\\begin{tabular}") == latex.count("\\end{tabular}") == sum(not t.whole for t in found)


def test_a_program_gets_the_report_of_the_command_and_unknown_experiments_are_refused(short, tmp_path, cli):
    report = sfm.simulate("rates", trials=2, workers=1)
    captured = cli("simulate", "rates", *TRIALS, tmp_path)
    assert "8 frames per point" in captured.out and report == json.loads((tmp_path / "results.json").read_text())
    assert set(report["table"]["general_slow rotation"]["exponents"]) == {
        "cross-frame",
        "cross-frame-wc",
        "cross-frame-cc",
    }
    over_window = report["estimators_over_window"]["variance_over_bound"]["cross-frame-cc"]["rotation"]
    assert len(over_window) == len(rates.BATCHES) and all(v["low"] <= v["value"] <= v["high"] for v in over_window)
    over_span = report["estimators_over_span"]["variance_relative"]["cross-frame-wc"]["position"]
    assert over_span[0]["value"] == 1  # it is its own reference
    with pytest.raises(sfm.ConfigError, match="known are efficiency"):
        sfm.simulate("magic")


def test_a_study_whose_figures_cannot_be_drawn_does_not_begin(tmp_path, monkeypatch, cli):
    """The studies take minutes; matplotlib is asked for before them."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "a study needs matplotlib" in cli("simulate", "figure6", *TRIALS, tmp_path, "-q", code=2).err
    assert not (tmp_path / "results.json").exists()
