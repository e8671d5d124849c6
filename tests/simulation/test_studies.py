"""Trials, statistics, the laws of the bound, and small studies with wide tolerances (100 trials: the command)."""

from functools import partial

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.executors import processes
from stream_sfm.simulation import measure as measuring
from stream_sfm.simulation.measure import Method, measure, stacked
from stream_sfm.simulation.rates import SPANS, WINDOWS, drift_rates, structure_law, structure_over_window
from stream_sfm.simulation.scenes import Scene
from stream_sfm.simulation.statistics import exponent, mean, ratio
from stream_sfm.simulation.trials import run_trials
from tests.simulation.iterated_ekf import IteratedEkf

pytestmark = pytest.mark.slow

SCENE = Scene(track_length=8)


def draw(seed: np.random.SeedSequence) -> float:
    return float(np.random.default_rng(seed).normal())


def test_any_number_of_workers_gives_the_same_numbers():
    done: list[int] = []
    serial = run_trials(draw, 7, seed=3, progress=done.append)
    with processes(2) as pool:
        assert run_trials(draw, 7, seed=3, executor=pool) == serial
    assert run_trials(draw, 3, seed=3) == serial[:3]
    assert sum(done) == 7
    assert len(set(serial)) == 7


def test_statistics_of_known_numbers():
    rng = np.random.default_rng(0)
    x = np.arange(1, 31)
    values = x**1.5 * rng.chisquare(3, size=(400, 30)) / 3
    found = exponent(x, values)
    assert found.low < 1.5 < found.high
    assert found.high - found.low < 0.15
    noise = rng.normal(size=(400, 10)) ** 2
    assert ratio(2 * noise, noise).value == pytest.approx(2)
    assert ratio(2 * noise, noise).high == pytest.approx(2), "paired: the same noise cancels"
    with_lost = np.where(rng.random(noise.shape) < 0.1, np.nan, noise)
    assert mean(with_lost).low < 1 < mean(with_lost).high


def test_structure_law():
    """Variance over the window against (1/L)(H_b + (L−b)/b): within 10 %."""
    values = np.mean([structure_over_window(np.random.SeedSequence(k)) for k in range(2)], axis=0)
    assert values / values[0] == pytest.approx([structure_law(16, b) for b in WINDOWS], rel=0.1)


def test_drift_law():
    """Drift rate over L against 3/(L²−1): within 12 %."""
    values = drift_rates(np.random.SeedSequence(0))[:, 0]
    assert values / values[0] == pytest.approx([3 / (n**2 - 1) for n in SPANS], rel=0.12)


@pytest.fixture(scope="module")
def small():
    """Twelve trials at frames 15, 20, 25, 30."""
    job = partial(
        measure,
        scene=SCENE,
        methods=(Method("cross-frame"), Method("cross-frame-cc"), Method("ekf"), Method("frame-to-frame")),
        frames=(15, 20, 25, 30),
    )
    return stacked(run_trials(job, 12, seed=1))


@pytest.mark.parametrize("method", ["cross-frame", "ekf"])
def test_covariances_are_consistent(small, method):
    """12 trials: the mean of NEES (6 and 3 expected) has a deviation of about 1 and 0.05."""
    assert 3.0 < np.nanmean(small[method]["nees_pose"]) < 9.5
    assert 2.75 < np.nanmean(small[method]["nees_point"]) < 3.25


def test_window_is_near_the_bound_and_frame_to_frame_is_not(small):
    window, pairs = small["cross-frame"], small["frame-to-frame"]
    local = ratio(window["local_structure"], window["bound_local_structure"]).value
    assert local == pytest.approx(1.0, abs=0.1)
    assert 0.5 < ratio(window["rotation"], window["bound_rotation"]).value < 1.6
    assert ratio(pairs["local_structure"], window["local_structure"]).value > 1.7
    assert not np.isnan(small["bound"]["position"]).any()


def test_negative_control_is_biased():
    """The relinearised world-centred filter with b = 1: variance more than four times the bound (3 trials: 20×)."""
    variance, bound = np.zeros(2), np.zeros(2)
    for k in range(3):
        sequence = SCENE.sequence(np.random.SeedSequence(k))
        estimator = IteratedEkf(sequence.projection, Config())
        for o in sequence.observations:
            solution = estimator.step(o)
        found = measuring.errors(sequence, 30, solution)
        limit = measuring.traces(measuring._bound(sequence, 30), slice(None))
        variance += [found["rotation"], found["position"]]
        bound += [limit["rotation"], limit["position"]]
    assert (variance / bound > 4).all()
