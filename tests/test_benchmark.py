"""The benchmark against its baseline: a regression fails the gate, an improvement does not, and the page shows both."""

import json
import re
import tomllib

import pytest

from tests.helpers.places import ROOT
from tools.benchmark import BASELINE, METRICS, main, measure, steps_back, updated
from tools.benchmark_page import PAGE, PEERS, page

SOUND = {
    "frames": 100, "path_m": 9.0, "t_rel_percent": 0.6, "r_rel_deg_per_100m": 0.3, "ate_rmse_aligned_m": 0.01,
    "rpe_m": 0.001,
    "not_ok_percent": 2.0, "lost_percent": 0.0, "nees_pose_mean": 7.0, "factor_of_sigma": 1.1,
    "cpu_ms_per_frame": 20.0, "p99_ms": 40.0,
}  # fmt: skip
OLD = {"version": "0", "machine": "here", "sequences": {"clips/a": SOUND}}


@pytest.mark.parametrize("key", METRICS)
def test_a_regression_is_reported_in_every_metric_and_an_improvement_is_not(key):
    metric, value = METRICS[key], SOUND[key]
    least = metric.allowed(value)
    worse = value + 1.1 * least if metric.target is None else value * 1.1 * 2.718281828**least
    within = value + 0.9 * least if metric.target is None else value * 2.718281828 ** (0.9 * least)
    for changed, failures in ((worse, 1), (within, 0), (metric.target or value / 2, 0), (None, 1)):
        assert len(steps_back({"clips/a": SOUND | {key: changed}}, OLD, "here")) == failures
    other_machine = steps_back({"clips/a": SOUND | {key: worse}}, OLD, "there")
    assert len(other_machine) == (not metric.of_machine)


def test_covariances_that_grow_too_small_or_too_large_are_a_step_back():
    for nees in (0.5, 60.0):
        assert "NEES" in steps_back({"clips/a": SOUND | {"nees_pose_mean": nees}}, OLD, "here")[0]


def test_a_new_sequence_is_not_a_regression_and_a_failing_one_is():
    assert not steps_back({"clips/b": SOUND}, OLD, "here")
    assert steps_back({"clips/a": {"frames": 0}}, OLD, "here")


def test_the_figures_of_the_last_release_are_kept_and_shown():
    new = updated(OLD, {"clips/a": SOUND | {"ate_rmse_aligned_m": 0.02}, "clips/b": SOUND}, "here")
    assert new["release"]["version"] == "0" and set(new["sequences"]) == {"clips/a", "clips/b"}
    assert updated(new, {"clips/a": SOUND}, "here")["release"] == new["release"]
    text = page(new, tomllib.loads(PEERS.read_text(encoding="utf-8")))
    assert "| 20.0 (10.0) |" in text and "| 98, 2, 0 |" in text and "of version 0." in text


def test_the_page_is_made_of_the_baseline():
    baseline = json.loads(BASELINE.read_text(encoding="utf-8"))
    assert page(baseline, tomllib.loads(PEERS.read_text(encoding="utf-8"))) == PAGE.read_text(encoding="utf-8")


def test_every_published_figure_has_its_source():
    rows = tomllib.loads(PEERS.read_text(encoding="utf-8"))["published"]
    assert all(re.search(r"20\d\d", row["source"]) and row["causal"] and row["aligned"] for row in rows)


def test_a_recording_that_cannot_be_replayed_is_a_sentence(tmp_path):
    (tmp_path / "x.mcap").write_bytes(b"")
    assert "is empty" in measure(tmp_path / "x.mcap", [])


@pytest.mark.slow
def test_the_gate_fails_on_a_step_back(tmp_path, monkeypatch, capsys):
    """With the room's own figures, then with an engine that is made worse on purpose.

    The baseline is said to be another machine's, so that what else runs on this one does not count.
    """
    baseline = tmp_path / "baseline.json"

    def run(*options: str) -> int:
        command = ["benchmark.py", "clips", ROOT / "logs/room.mcap", "--baseline", baseline, *options]
        monkeypatch.setattr("sys.argv", list(map(str, command)))
        return main()

    assert run("--update-baseline") == 0
    baseline.write_text(json.dumps(json.loads(baseline.read_text()) | {"machine": "another"}))
    assert run("--gate") == 0
    assert run("--gate", "--set", "frontend.max_tracks=20") == 1
    said = capsys.readouterr().err
    assert re.search(r"clips/room: ATE went from [0-9.e-]+ to ", said), said
