"""Errors that last along a track: what is learnt about them, and what estimates are worth with it."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.core import view_inflation
from stream_sfm.estimators import make_estimator
from stream_sfm.frontend.persistence import _DECAY, _LEFT_FRACTION, Persistence
from stream_sfm.simulation.scenes import Scene, Sequence
from stream_sfm.types import LastingErrors
from tests.helpers.estimators import nees

STD_PX, FRAMES = 0.2, 60


def lasting(rng: np.random.Generator, shape: tuple[int, ...], variance: float) -> np.ndarray:
    """A Gauss-Markov process along the first axis."""
    values = rng.normal(size=shape)
    for n in range(1, shape[0]):
        values[n] = _DECAY * values[n - 1] + np.sqrt(1 - _DECAY**2) * values[n]
    return np.sqrt(variance) * values


@pytest.mark.parametrize("ratio", [0.0, 0.3, 4.0])
def test_information_adds_up_to_what_a_constant_can_be_known(ratio: float) -> None:
    """Against the dense covariance of all views of a track."""
    n = np.arange(60)
    cov = np.eye(60) + ratio * _DECAY ** np.abs(n[:, None] - n)
    total = [np.ones(k) @ np.linalg.solve(cov[:k, :k], np.ones(k)) for k in n + 1]
    assert np.cumsum(1 / view_inflation(n, ratio, 0.0, _DECAY)[:, 0]) == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("ratio", [0.0, 0.7, 3.0])
def test_the_ratio_is_learnt_from_rows(ratio: float) -> None:
    rng = np.random.default_rng(3)
    persistence, ids = Persistence(), np.arange(150)
    slow = lasting(rng, (FRAMES, 150), (1 + _LEFT_FRACTION) * ratio * STD_PX**2)  # of left and right together
    cov = np.broadcast_to(STD_PX**2 * np.eye(4), (150, 4, 4))
    for n in range(FRAMES):
        z = rng.normal(size=(150, 4)) * STD_PX
        z[:, 1] += slow[n] + 0.3  # a row offset of the whole frame is not an error of tracks
        persistence = persistence.after(ids, z, cov)
    # differences are limited at three deviations, which takes a few per cent; scatter of 150 independent tracks
    standard_error = np.sqrt(2 / 150) * ratio + 0.02
    assert abs(persistence.ratio - ratio) < 3 * standard_error + 0.15 * ratio * (ratio > 1)
    inflation = persistence.inflation
    assert (inflation >= 1).all() and (inflation[:, 1] >= inflation[:, 0]).all()


def with_lasting_errors(sequence: Sequence, ratio: float, rng: np.random.Generator) -> list:
    """Observations with a lasting part on top of their white noise."""
    slow = lasting(rng, (len(sequence.observations), len(sequence.points_in_world), 4), ratio * sequence.std_px**2)
    slow[..., :2] *= np.sqrt(_LEFT_FRACTION)
    return [replace(o, z_px=o.z_px + slow[o.frame_index, o.track_ids]) for o in sequence.observations]


def nees_of_short_motions(observations: list, sequence: Sequence, learnt: bool) -> float:
    """Mean NEES of the newest pose relative to the first one."""
    estimator, persistence = make_estimator("cross-frame", sequence.projection, Config()), Persistence()
    values = []
    for o in observations:
        persistence = persistence.after(o.track_ids, o.z_px, o.cov_px)
        solution = estimator.step(
            replace(o, lasting=LastingErrors(None, persistence.inflation if learnt else None))
        )
        if o.frame_index >= 8:
            values.append(nees(solution.world_from_cam, solution.cov_pose, sequence.world_from_cam[o.frame_index]))
    return float(np.mean(values))


def test_covariances_hold_with_lasting_errors() -> None:
    """White noise is assumed wrongly by more than a factor of two; with what is learnt the NEES of the pose is 6."""
    scene = Scene(frames=24, track_length=16, visible=80, std_px=STD_PX, round_off=False)
    white, learnt = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        sequence = scene.sequence(np.random.SeedSequence(seed))
        observations = with_lasting_errors(sequence, 2.0, rng)
        white.append(nees_of_short_motions(observations, sequence, learnt=False))
        learnt.append(nees_of_short_motions(observations, sequence, learnt=True))
    error = np.std(learnt) / np.sqrt(len(learnt))

    assert np.mean(white) > 12
    assert 3 < np.mean(learnt) < 6 + 3 * error


@pytest.mark.parametrize("every", [2, 5])
def test_views_that_no_estimator_takes_do_not_count(every: int) -> None:
    """Information of every k-th view, against the dense covariance of these views."""
    n = every * np.arange(20)
    cov = np.eye(20) + 0.7 * _DECAY ** np.abs(n[:, None] - n)
    total = [np.ones(k) @ np.linalg.solve(cov[:k, :k], np.ones(k)) for k in range(1, 21)]
    assert np.cumsum(1 / view_inflation(np.arange(20), 0.0, 0.7, _DECAY**every)[:, 1]) == pytest.approx(
        total, rel=1e-9
    )
    persistence, ids = Persistence(every), np.arange(50)
    cov_px = np.broadcast_to(STD_PX**2 * np.eye(4), (50, 4, 4))
    rng = np.random.default_rng(5)
    for frame in range(2 * every + 1):
        persistence = persistence.after(ids, STD_PX * rng.normal(size=(50, 4)), cov_px)
        if frame % every == 0:
            expected = view_inflation(np.array([frame // every]), 0.0, persistence.ratio, _DECAY**every)[0, 1]
            assert persistence.inflation[:, 1] == pytest.approx(expected)
