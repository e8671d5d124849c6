"""Comparisons over many logs: intervals over logs, failures beside them, the same numbers as one comparison."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stream_sfm.config import Config, RigConfig, read_config
from stream_sfm.errors import ConfigError
from stream_sfm.recording import open_log
from stream_sfm.run.compare import compare
from stream_sfm.run.many import compare_many, summarise_many
from stream_sfm.types import Selection
from tests.helpers.stereo_logs import write_log
from tests.helpers.wall_log import write_wall_log
from tests.run.test_compare import FEW, spec

METHODS = ("cross-frame", "frame-to-frame")


def sample(log: str, start_s: float, position: float, rotation: float) -> dict[str, Any]:
    """A run of 10 s whose own interval is 10 % to either side."""
    ratios = {"position": position, "rotation": rotation}
    ci95 = {q: [value / 1.1, value * 1.1] for q, value in ratios.items()}
    times = {"start_s": start_s, "end_s": start_s + 10}
    return {"log": log, **times, "failure": None, "ratios": {"ekf": ratios}, "ci95": {"ekf": ci95}}


def test_intervals_are_over_logs_and_starts_are_averaged_first() -> None:
    """Four logs, one with many starts that all say the same: it counts once."""
    samples = [sample("a", k, 4.0, 1.0) for k in range(50)]
    samples += [sample(name, 0, 1.0, 1.0) for name in "bcd"]
    found = summarise_many(samples, ("cross-frame", "ekf"))
    position = found["error_over_cross_frame"]["ekf"]["position"]
    assert position["value"] == pytest.approx(4 ** (1 / 4)) and position["samples"] == 4
    assert position["ci95"][0] < 1 < position["ci95"][1] and found["interval_over"] == "logs"
    assert "Errors in 4 logs, 53 starts," in found["conclusion"] and "Not told apart" in found["conclusion"]
    two = summarise_many(samples[-2:], ("cross-frame", "ekf"))  # two know nothing about their spread
    assert two["error_over_cross_frame"]["ekf"]["position"]["ci95"] is None


def test_intervals_hold_in_95_percent() -> None:
    """Both ratios of six logs, whose logarithms are Gaussian and independent, are in their intervals."""
    rng = np.random.default_rng(1)
    trials, inside = 1000, 0
    for _ in range(trials):
        values = np.exp(rng.normal(0.2, 0.3, (6, 2)))
        found = summarise_many(
            [sample(str(k), 0, *v) for k, v in enumerate(values.tolist())], ("cross-frame", "ekf")
        )
        ends = [f["ci95"] for f in found["error_over_cross_frame"]["ekf"].values()]
        inside += all(low <= np.exp(0.2) <= high for low, high in ends)
    assert inside / trials == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / trials))


def test_starts_of_one_log_are_not_logs() -> None:
    pieces = [sample("a", 20 * k, 1.1 + 0.01 * k, 1.0) for k in range(3)]
    found = summarise_many(pieces, ("cross-frame", "ekf"))
    assert found["interval_over"] == "starts" and "Errors in 3 starts of one log," in found["conclusion"]
    assert "position larger" in found["conclusion"] and "holds for this log" in found["conclusion"]
    # below the least of the three
    assert found["error_over_cross_frame"]["ekf"]["position"]["ci95"][0] > 1.1 / 1.05


def test_starts_that_share_frames_are_not_told_apart_more_often_than_one_run() -> None:
    """The interval is that of one run, or wider where the starts differ by more."""
    runs = [sample("a", k, 1.09 + 0.001 * k, 1.0) for k in range(3)]
    found = summarise_many(runs, ("cross-frame", "ekf"))
    assert found["interval_over"] == "frames" and "share frames" in found["conclusion"]
    position = found["error_over_cross_frame"]["ekf"]["position"]
    assert position["ci95"] == pytest.approx([position["value"] / 1.1, position["value"] * 1.1])
    assert "Not told apart from cross-frame in position or rotation: EKF." in found["conclusion"]
    differing = summarise_many([sample("a", k, 1.1**k, 1.0) for k in range(3)], ("cross-frame", "ekf"))[
        "error_over_cross_frame"
    ]["ekf"]["position"]
    assert differing["ci95"][1] / differing["value"] > 1.2  # wider than that of one run, 1.1
    one = summarise_many(runs[:1], ("cross-frame", "ekf"))
    assert one["error_over_cross_frame"]["ekf"]["rotation"]["ci95"] == pytest.approx([1 / 1.1, 1.1])


@pytest.mark.slow
def test_the_numbers_are_those_of_one_comparison(tmp_path: Path, cli) -> None:
    log = write_log(tmp_path / "log.mcap", spec(range(42), truth=True))
    short = write_log(tmp_path / "short.mcap", spec(range(6), truth=True))
    out = tmp_path / "out"
    arguments = ["batch", "compare", str(log), str(short), "--out", str(out), "--methods", ",".join(METHODS)]
    cli(*arguments, "--set", FEW, "--starts", "2", "--start-step", "0.1", "--workers", "1", code=3)
    content = json.loads((out / "comparison.json").read_text())
    alone = compare(log, None, read_config(None, [FEW]), Selection(start_s=0.1), methods=METHODS).report
    of_second = content["samples"][1]
    assert of_second["start_s"] == 0.1
    for quantity, found in alone["error_over_cross_frame"]["frame_to_frame"].items():
        assert of_second["ratios"]["frame_to_frame"][quantity] == pytest.approx(found["value"], rel=1e-9)
    assert all("too few frames" in s["failure"] for s in content["samples"][2:])
    assert "short.<wbr>mcap" in (out / "report.html").read_text()


@pytest.mark.slow
def test_an_interruption_keeps_what_has_been_compared(tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.mcap", spec(range(42), truth=True))

    def interrupt(name: str) -> None:
        raise KeyboardInterrupt

    arguments: dict[str, Any] = {"methods": METHODS, "starts": 3, "start_step_s": 0.1, "workers": 1}
    config = read_config(None, [FEW])
    content = compare_many([log], tmp_path / "out", config, **arguments, on_done=interrupt)
    assert content["interrupted"] and [s["failure"] for s in content["samples"]][1:] == 2 * [
        "interrupted before its end"
    ]
    assert content["samples"][0]["ratios"]
    assert json.loads((tmp_path / "out/comparison.json").read_text())["interrupted"]


@pytest.mark.slow
def test_every_run_learns_the_calibration_that_it_is_given(tmp_path: Path, cli) -> None:
    """The numbers are those of `compare(calibrate=True)` with that calibration, and not those without."""
    log, file, out = write_wall_log(tmp_path / "log.mcap", n=21, times=2), tmp_path / "wrong.toml", tmp_path / "out"
    wrong = open_log(log).stereo_rig
    k = wrong.left.K.copy()
    k[0, 2] += 3.0
    file.write_text(replace(wrong, left=replace(wrong.left, K=k)).to_toml(), encoding="utf-8")
    config, options = read_config(None, [FEW]), {"calibration": file, "methods": METHODS}
    learnt, given = (compare(log, None, config, calibrate=c, **options).report for c in (True, False))
    chosen = ["--calibrate", "--calibration", str(file), "--methods", ",".join(METHODS)]
    cli("batch", "compare", log, "--out", out, *chosen, "--set", FEW, "-q")
    found = json.loads((out / "comparison.json").read_text())["samples"][0]["ratios"]["frame_to_frame"]
    for quantity, ratio in learnt["error_over_cross_frame"]["frame_to_frame"].items():
        assert found[quantity] == pytest.approx(ratio["value"], rel=1e-9)
        before = given["error_over_cross_frame"]["frame_to_frame"][quantity]["value"]
        assert found[quantity] != pytest.approx(before, rel=1e-2)  # not by rounding


def test_what_cannot_be_compared_is_refused(tmp_path: Path, cli) -> None:
    with pytest.raises(ConfigError, match="name it among the methods"):
        compare_many([], methods=("ekf",))
    with pytest.raises(ConfigError, match="unknown method"):
        compare_many([], methods=("cross-frame", "magic"))
    with pytest.raises(ConfigError, match="0 starts"):
        compare_many([], starts=0)
    with pytest.raises(ConfigError, match="exact"):
        compare_many([], None, Config(rig=RigConfig(exact=True)), calibrate=True)
    with pytest.raises(ConfigError, match="missing"):
        compare_many([], calibration=tmp_path / "missing.toml")
    log = str(write_log(tmp_path / "log.mcap", spec(range(2))))
    for option, value in (("--method", "ekf"), ("--ground-truth", log)):
        said = cli("batch", "compare", log, "--out", tmp_path / "out", option, value, code=2)
        assert f"unknown option {option!r}" in said.err
