"""`stream-sfm simulate` end to end, with few trials."""

import dataclasses
import json
import sys

import pytest

import stream_sfm as sfm
from stream_sfm.cli import simulate
from stream_sfm.cli.main import main
from stream_sfm.simulation import calibration, figure6, rates, studies
from stream_sfm.simulation.measure import Method
from stream_sfm.simulation.scenes import Scene


def run(capsys, *arguments):
    assert main(["simulate", *arguments]) == 0
    return capsys.readouterr()


@pytest.fixture
def short(monkeypatch):
    """The same experiments on short scenes."""
    small = Scene(frames=6, track_length=4)
    methods = (Method("cross-frame"), Method("ekf"))
    conditions = [dataclasses.replace(c, scene=small, methods=methods, frames=(3, 5)) for c in studies.CONDITIONS]
    monkeypatch.setattr(studies, "CONDITIONS", tuple(conditions))
    lasting = dataclasses.replace(small, std_px=0.15, round_off=False, autocorrelation=0.75)
    conditions = [dataclasses.replace(c, scene=lasting, frames=(3, 5)) for c in calibration.CONDITIONS[::2]]
    monkeypatch.setattr(calibration, "CONDITIONS", tuple(conditions))
    monkeypatch.setattr(figure6, "SCENE", Scene(frames=4))
    monkeypatch.setattr(figure6, "FRAMES", (1, 2, 3))
    run_short = rates.Run("general", small, (3, 4, 5))
    monkeypatch.setattr(rates, "RUNS", {"general_slow": run_short})
    monkeypatch.setattr(rates, "LAST_FRAMES", (3, 5))


@pytest.mark.parametrize("experiment", simulate.EXPLAINED)
def test_writes_results_and_figures(experiment, short, tmp_path, capsys):
    arguments = [experiment, "--trials", "2", "--workers", "1", "--out", str(tmp_path)]
    captured = run(capsys, *arguments, "--json", "--quiet")
    report = json.loads(captured.out)
    assert report == json.loads((tmp_path / "results.json").read_text())
    assert report["experiment"] == experiment
    assert (tmp_path / f"{experiment}.png").stat().st_size > 10_000
    assert "<svg" in (tmp_path / f"{experiment}.svg").read_text()
    assert all(line.startswith("simulate ") for line in captured.err.splitlines())  # a slow run shows progress


def test_efficiency_is_keyed_by_estimator_and_readable(short, tmp_path, capsys):
    text = run(capsys, "efficiency", "--trials", "2", "--workers", "1", "--out", str(tmp_path)).out
    assert "cross-frame" in text
    report = json.loads((tmp_path / "results.json").read_text())
    entry = report["conditions"]["nominal"]["estimators"]["ekf"]
    assert set(entry["over_bound"]) == set(entry["over_reference"])
    assert entry["over_bound"]["rotation"]["low"] <= entry["over_bound"]["rotation"]["value"]


def test_rates_prints_three_columns(short, tmp_path, capsys):
    text = run(capsys, "rates", "--trials", "2", "--workers", "1", "--out", str(tmp_path)).out
    assert "paper" in text
    assert "measured" in text
    assert "exact theory" in text
    report = json.loads((tmp_path / "results.json").read_text())
    assert set(report["table"][0]["exponents"]) == {"cross-frame", "cross-frame-wc", "cross-frame-cc"}
    over_window = report["estimators_over_window"]["variance_over_bound"]["cross-frame-cc"]["rotation"]
    assert len(over_window) == len(rates.BATCHES) and all(v["low"] <= v["value"] <= v["high"] for v in over_window)
    over_span = report["estimators_over_span"]["variance_relative"]["cross-frame-wc"]["position"]
    assert over_span[0]["value"] == pytest.approx(1) and len(over_span) == len(rates.SPANS)


def test_a_program_gets_the_same_report_and_unknown_experiments_are_refused(short, tmp_path, capsys):
    run(capsys, "efficiency", "--trials", "2", "--workers", "1", "--out", str(tmp_path))
    report = sfm.simulate("efficiency", trials=2, workers=1)
    assert report == json.loads((tmp_path / "results.json").read_text())
    with pytest.raises(sfm.ConfigError, match="known are efficiency"):
        sfm.simulate("magic")


def test_figures_that_cannot_be_drawn_lose_no_result(short, tmp_path, monkeypatch, capsys):
    """The studies take minutes; matplotlib is asked for at their end."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "stream_sfm.simulation.figures", raising=False)
    monkeypatch.delattr("stream_sfm.simulation.figures", raising=False)
    assert main(["simulate", "figure6", "--trials", "2", "--workers", "1", "--out", str(tmp_path), "-q"]) == 2
    assert "the package matplotlib is missing" in capsys.readouterr().err
    assert json.loads((tmp_path / "results.json").read_text())
