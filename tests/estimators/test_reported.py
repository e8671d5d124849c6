"""The reported minimum beside that of the filter, and the factors on σ from halves of the tracks."""

import pickle

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.window.inverse_depth import linearise
from stream_sfm.estimators.window.reported.equal_weights import reported
from stream_sfm.estimators.window.reported.halves import (
    SpanFactors,
    _poses_by,
    _quarters,
    _unselected,
    squares_of_halves,
)
from stream_sfm.estimators.window.reported.rules import ReportedRules
from stream_sfm.estimators.window.reported.track_noise import TrackNoise
from stream_sfm.estimators.window.state import WindowState
from stream_sfm.geometry import se3
from stream_sfm.record import changed
from stream_sfm.simulation.scenes import Scene, Sequence

SCENE = Scene(frames=20, track_length=8, visible=80, std_px=0.1, round_off=False)
SPANS = 8
RULES = ReportedRules()
UNKNOWN = SpanFactors.unknown(SPANS, RULES), TrackNoise.unknown(RULES)


def map_after(sequence: Sequence) -> WindowState:
    estimator = make_estimator("cross-frame", sequence.projection, Config())
    for o in sequence.observations:
        estimator.step(o)
    assert estimator.map is not None
    return estimator.map


@pytest.fixture(scope="module")
def current() -> WindowState:
    return map_after(SCENE.sequence(np.random.SeedSequence(4)))


def test_halves_add_up_to_all_tracks(current):
    """Their information and right-hand sides are those of all tracks, of the dense equations without the points."""
    alone = _unselected(current, RULES.halves_within)
    quarters = _quarters(alone, alone.state, RULES.halves_least)
    assert np.bincount(quarters, minlength=4).min() > 0.15 * len(quarters)
    parts = _poses_by(alone, quarters, 4)
    every = _poses_by(alone, np.zeros_like(quarters), 1)[0]
    scale = np.abs(every[0]).max()
    assert np.abs(sum(p[0] for p in parts) - every[0]).max() < 1e-9 * scale
    assert sum(p[1] for p in parts) == pytest.approx(every[1], abs=1e-9 * np.abs(every[1]).max() + 1e-6)
    # points by the views of the window alone, but for a millionth of what the prior knows
    blocks = linearise(alone.projection, alone.state, alone.views)
    n, points = 6 * len(alone.frames), len(alone.points)
    h, right = np.zeros((n + 3 * points,) * 2), np.concatenate([blocks.g_pose.ravel(), blocks.g_point.ravel()])
    for f, u in enumerate(blocks.u):
        h[6 * f : 6 * f + 6, 6 * f : 6 * f + 6] = u
    h[n:, :n] = blocks.w.reshape(-1, n)
    h[:n, n:] = h[n:, :n].T
    for i, v in enumerate(blocks.v):
        h[n + 3 * i : n + 3 * i + 3, n + 3 * i : n + 3 * i + 3] = v
    gain = h[:n, n:] @ np.linalg.inv(h[n:, n:])
    assert np.abs(h[:n, :n] - gain @ h[n:, :n] - every[0]).max() < 1e-4 * scale
    assert right[:n] - gain @ right[n:] == pytest.approx(every[1], abs=1e-3 * np.abs(every[1]).max())


def test_halves_have_no_memory_and_no_selection(current):
    """They are apart as far whatever the prior knows, whichever views were gated, and whatever the views count."""
    found, views = squares_of_halves(current, RULES), current.views
    assert np.isfinite(found[:, :-1]).all()
    rare = views.ids % 7 == 0
    known = changed(current, prior=changed(current.prior, cov=current.prior.cov / 100))
    gated = changed(current, views=changed(views, used=views.used & ~rare))
    lighter = changed(current, views=changed(views, root=0.6 * views.root, weight=0.6 * views.weight))
    for other in (known, gated, lighter):
        assert squares_of_halves(other, RULES)[:, :-1] == pytest.approx(found[:, :-1], rel=1e-3)
    shifted = changed(views, z_px=views.z_px + np.where(rare, 2.0, 0.0)[:, None])
    wrong = changed(current, views=shifted)  # gross mismatches are no part of the halves
    without = _unselected(wrong, RULES.halves_within)
    assert not without.views.used[rare].any() and without.views.used[~rare].mean() > 0.9


@pytest.mark.parametrize("kind", ["even numbers", "left"])
def test_tracks_of_half_a_scene_have_both_kinds_of_halves(current, kind):
    """Tracks with even numbers only, or from one side of the image."""
    ids, x = current.points.ids, current.points.q[:, 0]
    kept = ids % 2 == 0 if kind == "even numbers" else x < np.median(x)
    at = current.state._replace(ids=ids[kept], q=current.points.q[kept])
    assert np.bincount(_quarters(current, at, RULES.halves_least), minlength=4).min() > 0.15 * kept.sum()


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
    """The second reading of the window is a copy."""
    before = pickle.dumps(current)
    smoothed, *_ = reported(current, *UNKNOWN, True)
    assert smoothed is not current
    assert pickle.dumps(current) == before


def mean_squares(autocorrelation: float, trials: int) -> tuple[np.ndarray, np.ndarray]:
    """Means of δᵀC⁻¹δ/6 and their standard errors, of the halves by track number; independent trials."""
    found = []
    for seed in range(trials):
        scene = Scene(
            frames=10, track_length=10, visible=80, std_px=0.1, round_off=False, autocorrelation=autocorrelation
        )
        current = map_after(scene.sequence(np.random.SeedSequence([7, seed])))
        found.append(squares_of_halves(current, RULES)[0, :-1])
    return np.mean(found, axis=0), np.std(found, axis=0) / np.sqrt(trials)


def test_factors_are_1_with_white_noise_and_grow_with_correlated_errors():
    """With correlated errors the poses of halves differ by more than their σ, increasingly with the span."""
    white, error = mean_squares(0.0, 30)
    assert (np.abs(white - 1) < 3 * error).all()
    lasting, error = mean_squares(0.9, 30)
    assert lasting[-1] > 1 + 3 * error[-1] and lasting[-1] > lasting[0] + 0.3


def test_factors_keep_their_bounds():
    """They are at least 1 and do not decrease with the span; one frame counts at most ten times the mean."""
    factors = SpanFactors.unknown(4, RULES)
    assert (factors.by_span == 1).all()
    found = np.array([[0.2, 3.0, 1.0], [0.2, 2.0, np.nan]])
    for _ in range(60):
        factors = factors.after(found)
    assert factors.by_span == pytest.approx([1, *np.sqrt([3.0, 3.0, 3.0])], rel=0.05)
    wild = factors.after(np.full((2, 4), 1e12))
    assert (wild.squares <= factors.squares * (1 + 9 / factors.frames) + 1e-9).all()
    assert factors.after(np.full((2, 4), np.nan)).squares.tolist() == factors.squares.tolist()
