"""Trials, statistics, the laws of the bound, and small studies with wide tolerances (100 trials: the command)."""

from collections.abc import Iterator
from contextlib import nullcontext
from functools import partial

import numpy as np
import pytest

from stream_sfm.simulation.measure import Method, measure
from stream_sfm.simulation.rates import SPANS, WINDOWS, drift_rates, structure_law, structure_over_window
from stream_sfm.simulation.scenes import Scene
from stream_sfm.simulation.studies import Job, Pool, Study, exponent, mean, ratio, stacked
from stream_sfm.system.executors import processes

SCENE = Scene(track_length=8)


def test_the_progress_of_a_study_ends_at_its_total():
    done: list[int] = []
    jobs = {"a": Job(lambda seed: {"x": {"y": np.zeros(1)}}), "b": Job(lambda seed: {"x": {"y": np.ones(1)}}, 0.1)}
    study = Study(lambda: jobs, lambda measured: {name: len(data["x"]["y"]) for name, data in measured.items()})
    assert study.run(30, seed=0, progress=done.append).report == {"a": 30, "b": 3}
    assert sum(done) == study.total_trials(30) == 33


def drawn(seed: np.random.SeedSequence) -> dict[str, dict[str, np.ndarray]]:
    return {"x": {"y": np.random.default_rng(seed).normal(size=1)}}


def test_any_number_of_workers_gives_the_same_numbers():
    study = Study(lambda: {"a": Job(drawn)}, lambda measured: measured["a"]["x"]["y"].ravel().tolist())
    serial = study.run(7, seed=3).report
    assert study.run(7, 3, partial(processes, 2)).report == serial
    assert study.run(3, 3).report == serial[:3] and len(set(serial)) == 7


@pytest.mark.parametrize("pool", [nullcontext, partial(processes, 2)])
def test_an_interrupted_study_reports_the_trials_that_it_has(pool: Pool) -> None:
    """All of its jobs are at the same share of their trials, whose numbers are those of the whole study.

    An error of the pool's own thread, which is killed meanwhile, would fail this test as a warning.
    """
    study = Study(lambda: {"a": Job(drawn), "b": Job(drawn, 0.5)}, lambda measured: measured)
    whole = study.run(20, seed=5).report
    for last in (1, 11, 30):
        calls = iter(range(1, 99))

        def interrupt(_: int, last: int = last, calls: Iterator[int] = calls) -> None:
            if next(calls) == last:
                raise KeyboardInterrupt

        if last == 1:
            with pytest.raises(KeyboardInterrupt):  # too few for an interval
                study.run(20, 5, pool, interrupt)
            continue
        found, trials = study.run(20, 5, pool, interrupt)
        a, b = (found[name]["x"]["y"][:, 0] for name in "ab")
        assert len(a) + len(b) == last and abs(len(a) - 2 * len(b)) <= 2
        assert trials == {11: 6, 30: 20}[last]
        for name, values in zip("ab", (a, b), strict=True):
            assert (values == whole[name]["x"]["y"][: len(values), 0]).all()


def test_statistics_of_known_numbers():
    rng = np.random.default_rng(0)
    x = np.arange(1, 31)
    found = exponent(x, x**1.5 * rng.chisquare(3, size=(400, 30)) / 3)
    assert found.low < 1.5 < found.high
    assert found.high - found.low < 0.15  # 4 σ: σ² of a log of 400 means is 2/3/400, of 30 points over log x 0.02²
    noise = rng.normal(size=(400, 10)) ** 2
    assert ratio(2 * noise, noise).high == pytest.approx(2), "paired: the same noise cancels"
    with_lost = np.where(rng.random(noise.shape) < 0.1, np.nan, noise)
    assert mean(with_lost).low < 1 < mean(with_lost).high


def test_the_laws_of_structure_and_drift_are_those_of_the_bound():
    """Within 10 and 12 %: parallax, and the first L frames, add what the laws leave out (docs/accuracy.md)."""
    trials = [structure_over_window(np.random.SeedSequence(k)) for k in range(2)]
    values = stacked(trials)["bound"]["local_structure"].mean(axis=0)
    assert values / values[0] == pytest.approx([structure_law(16, b) for b in WINDOWS], rel=0.1)
    rates = drift_rates(np.random.SeedSequence(0))["bound"]["rotation"]
    assert rates / rates[0] == pytest.approx([3 / (n**2 - 1) for n in SPANS], rel=0.12)


def test_estimators_are_consistent_and_the_window_is_near_the_bound():
    """Of eight trials the mean of NEES (6 and 3 are expected) has a deviation of about 1.2 and 0.06."""
    methods = (Method("cross-frame"), Method("ekf"), Method("frame-to-frame"))
    job = partial(measure, scene=SCENE, methods=methods, frames=(15, 20, 25, 30))
    small = Study(lambda: {"": Job(job)}, lambda measured: measured[""]).run(8, seed=1).report
    for method in ("cross-frame", "ekf"):
        assert 2.4 < np.nanmean(small[method]["nees_pose"]) < 10.5
        assert 2.75 < np.nanmean(small[method]["nees_point"]) < 3.25
    window, pairs = small["cross-frame"], small["frame-to-frame"]
    local = ratio(window["local_structure"], window["bound_local_structure"]).value
    assert local == pytest.approx(1.0, abs=0.1)  # 0.99 over 100 trials
    assert 0.5 < ratio(window["rotation"], window["bound_rotation"]).value < 1.6  # 0.97, with a deviation of 0.25
    assert ratio(pairs["local_structure"], window["local_structure"]).value > 1.7  # 1.97 over 100 trials
    assert not np.isnan(small["bound"]["position"]).any()
