"""The reported minimum beside that of the filter, and the factors on σ from halves of the tracks."""

import numpy as np
import pytest

from stream_sfm.config import Config, WindowConfig
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.cross_frame.halves import SpanFactors, _poses_by, _quarters, squares_of_halves
from stream_sfm.estimators.cross_frame.inverse_depth import State, linearise
from stream_sfm.estimators.cross_frame.map import Map
from stream_sfm.estimators.cross_frame.normal_equations import System
from stream_sfm.estimators.cross_frame.reported import reported
from stream_sfm.estimators.cross_frame.track_noise import TrackNoise
from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import Scene, Sequence

SCENE = Scene(frames=20, track_length=8, visible=80, std_px=0.1, round_off=False)
SPANS = 8
UNKNOWN = SpanFactors.unknown(WindowConfig(frames=SPANS)), TrackNoise.unknown(WindowConfig())


def map_after(sequence: Sequence) -> Map:
    estimator = make_estimator("cross-frame", sequence.projection, Config())
    for o in sequence.observations:
        estimator.step(o)
    assert estimator.map is not None
    return estimator.map


def system_at(current: Map) -> tuple[State, System]:
    """The state of a map, and the normal equations there."""
    at = current.state()
    blocks = linearise(current.projection, at, current.views)
    known = np.searchsorted(current.points.ids, current.prior.ids)
    return at, System(current.prior, known, blocks, current.points.q, current.amplitudes)


@pytest.fixture(scope="module")
def current() -> Map:
    return map_after(SCENE.sequence(np.random.SeedSequence(4)))


def test_halves_add_up_to_all_tracks(current):
    """Their information and right-hand sides are those of all tracks, of the dense equations without the points."""
    at, system = system_at(current)
    quarters = _quarters(current, at, WindowConfig())
    assert np.bincount(quarters, minlength=4).min() > 0.15 * len(quarters)
    parts = _poses_by(current, system, at, quarters)
    every = _poses_by(current, system, at, np.zeros_like(quarters))[0]
    scale = np.abs(every[0]).max()
    assert np.abs(sum(p[0] for p in parts) - every[0]).max() < 1e-9 * scale
    assert sum(p[1] for p in parts) == pytest.approx(every[1], abs=1e-9 * np.abs(every[1]).max() + 1e-6)
    # given modes: points by their views and by the prior of each
    blocks, prior = linearise(current.projection, at, current.views), current.prior
    n, points = 6 * len(current.frames), len(at.ids)
    h, right = np.zeros((n + 3 * points,) * 2), np.concatenate([blocks.g_pose.ravel(), blocks.g_point.ravel()])
    for f, u in enumerate(blocks.u):
        h[6 * f : 6 * f + 6, 6 * f : 6 * f + 6] = u
    h[n:, :n] = blocks.w.reshape(-1, n)
    h[:n, n:] = h[n:, :n].T
    for i, v in enumerate(blocks.v):
        h[n + 3 * i : n + 3 * i + 3, n + 3 * i : n + 3 * i + 3] = v
    for i, row in enumerate(np.searchsorted(current.points.ids, prior.ids)):
        rows, information = slice(n + 3 * row, n + 3 * row + 3), np.linalg.inv(prior.cov[i])
        h[rows, rows] += information
        right[rows] -= information @ (current.points.q[row] - prior.mean[i] - prior.modes[i] @ current.amplitudes)
    gain = h[:n, n:] @ np.linalg.inv(h[n:, n:])
    assert np.abs(h[:n, :n] - gain @ h[n:, :n] - every[0]).max() < 1e-6 * scale
    assert right[:n] - gain @ right[n:] == pytest.approx(every[1], abs=1e-5 * np.abs(every[1]).max() + 1e-3)


@pytest.mark.parametrize("kind", ["even numbers", "left"])
def test_tracks_of_half_a_scene_have_both_kinds_of_halves(current, kind):
    """Tracks with even numbers only, or from one side of the image."""
    ids, x = current.points.ids, current.points.q[:, 0]
    kept = ids % 2 == 0 if kind == "even numbers" else x < np.median(x)
    at = current.state()._replace(ids=ids[kept], q=current.points.q[kept])
    assert np.bincount(_quarters(current, at, WindowConfig()), minlength=4).min() > 0.15 * kept.sum()


def test_one_step_leads_to_the_minimum(current):
    """Further steps move poses by less than a hundredth of their σ."""
    once, *_ = reported(current, *UNKNOWN, False)
    again = once
    for _ in range(4):
        again, *_ = reported(again, *UNKNOWN, False)
    moved = se3.log(once.cams_from_ref @ se3.inverse(again.cams_from_ref)).ravel()
    std = np.sqrt((once.system.root[: len(moved)] ** 2).sum(axis=1))
    assert (np.abs(moved) < 0.01 * std).all()


def test_nothing_is_fed_back(current):
    before = (
        current.cams_from_ref.copy(),
        current.points.q.copy(),
        current.amplitudes.copy(),
        current.views,
        current.prior,
    )
    read_off, *_ = reported(current, *UNKNOWN, True)
    assert read_off is not current
    for old, now in zip(before, (current.cams_from_ref, current.points.q, current.amplitudes), strict=False):
        assert (old == now).all()
    assert before[3:] == (current.views, current.prior)


def mean_squares(autocorrelation: float, trials: int) -> tuple[np.ndarray, np.ndarray]:
    """Means of δᵀC⁻¹δ/6 and their standard errors, of the halves by track number; independent trials."""
    found = []
    for seed in range(trials):
        scene = Scene(
            frames=10, track_length=10, visible=80, std_px=0.1, round_off=False, autocorrelation=autocorrelation
        )
        current = map_after(scene.sequence(np.random.SeedSequence([7, seed])))
        at, system = system_at(current)
        found.append(squares_of_halves(current, system, at, WindowConfig())[0])
    return np.mean(found, axis=0), np.std(found, axis=0) / np.sqrt(trials)


def test_factors_are_1_with_white_noise_and_grow_with_correlated_errors():
    """With correlated errors the poses of halves differ by more than their σ, increasingly with the span."""
    white, error = mean_squares(0.0, 30)
    assert (np.abs(white - 1) < 3 * error).all()
    lasting, error = mean_squares(0.9, 30)
    assert lasting[-1] > 1 + 3 * error[-1] and lasting[-1] > lasting[0] + 0.3


def test_factors_keep_their_bounds():
    """They are at least 1 and do not decrease with the span; one frame counts at most ten times the mean."""
    factors = SpanFactors.unknown(WindowConfig(frames=4))
    assert (factors.by_span == 1).all()
    found = np.array([[0.2, 3.0, 1.0], [0.2, 2.0, np.nan]])
    for _ in range(60):
        factors = factors.after(found)
    assert factors.by_span == pytest.approx([1, *np.sqrt([3.0, 3.0, 3.0])], rel=0.05)
    wild = factors.after(np.full((2, 4), 1e12))
    assert (wild.squares <= factors.squares * (1 + 9 / factors.frames) + 1e-9).all()
    assert factors.after(np.full((2, 4), np.nan)).squares.tolist() == factors.squares.tolist()
