"""Row differences of left and right are learnt from matches, some of which are wrong."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.config import Config, RigConfig
from stream_sfm.config.rules import Rules
from stream_sfm.core import _core
from stream_sfm.frontend.learnt import rows as rows_of
from stream_sfm.frontend.learnt.rows import RowRules, Rows, row_terms
from stream_sfm.frontend.learnt.timing import Timing
from stream_sfm.geometry.stereo import StereoProjection, velocities
from stream_sfm.rig_model.field import field_over

P = StereoProjection(600.0, 320.0, 320.0, 240.0, 0.2, 640, 480)
STD_PX = 0.1  # of a match
N = 40  # matches per frame
AT_REST = np.zeros(1)
GRID = np.stack(np.meshgrid(np.linspace(30, 610, 12), np.linspace(30, 450, 9)), axis=2).reshape(-1, 2)


def places(rng: np.random.Generator, n: int = N) -> np.ndarray:
    return rng.uniform((0, 0), (639, 479), (n, 2))


def polynomial(left_px: np.ndarray) -> np.ndarray:
    x, y = ((left_px - (319.5, 239.5)) / 319.5).T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def smooth(left_px: np.ndarray) -> np.ndarray:
    """The row differences that a calibration leaves."""
    return polynomial(left_px) @ [0.3, -0.2, 0.1, 0.0, -0.5, 0.0]


def field(left_px: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    return field_over(P.width, P.height).at(left_px) @ amplitudes


def offsets_px(rows: Rows, left_px: np.ndarray, speed: np.ndarray = AT_REST) -> np.ndarray:
    """v_left − v_right (n,) of correct matches, with speeds (n,) across the rows."""
    return row_terms(P, left_px, speed) @ rows.mean


def agree(rows: Rows, left_px: np.ndarray, right_px: np.ndarray, speed: np.ndarray = AT_REST) -> np.ndarray:
    """Which matches lie on one row, with the right sides corrected by `offsets_px`."""
    return _core._on_one_row(rows, left_px, right_px, speed, 1.0)


def variance(rows: Rows) -> np.ndarray:
    """The variance of the row differences at rest, over the grid."""
    terms = row_terms(P, GRID, np.zeros(len(GRID)))
    return np.einsum("ni,ij,nj->n", terms, rows.cov, terms)


def learnt(
    rng: np.random.Generator, frames: int, amplitudes: np.ndarray, wrong: float = 0.0, delay_s: float = 0.0
) -> Rows:
    """Rows after frames of a rig with that field and delay, with the camera nodding at about 60 px/s."""
    rows = Rows.unknown(P, Config())
    for _ in range(frames):
        at = places(rng)
        speed = np.full(len(at), 60 * rng.normal()) + 10 * rng.normal(size=len(at))  # shared, and by depth
        seen = smooth(at) + field(at, amplitudes) - delay_s * speed + STD_PX * rng.normal(size=len(at))
        bad = rng.random(len(at)) < wrong
        seen[bad] += rng.uniform(-5, 5, int(bad.sum()))
        rows = rows.learnt(at, seen, speed)
    return rows


NO_FIELD = np.zeros(field_over(P.width, P.height).size)


def test_the_filter_is_a_dense_gaussian(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without robust weights and steps it equals least squares over all matches at once."""
    monkeypatch.setattr(rows_of, "CAUCHY_WIDTH", 1e9)
    monkeypatch.setattr(Rows, "_likely_field_std_px", lambda self, *_: self.field_std_px)
    rng = np.random.default_rng(1)
    prior = Rows.unknown(P, Config(rules=Rules((RowRules(step_px=0.0),))))
    at, speed = places(rng, 60), 30 * rng.normal(size=60)
    seen = smooth(at) + STD_PX * rng.normal(size=60)
    own = rng.normal(size=(60, 2))  # errors of this frame alone
    rows = prior.learnt(at, seen, speed, own)

    design = np.concatenate([polynomial(at), -speed[:, None], field_over(P.width, P.height).at(at)], axis=1)
    cov_seen = design @ prior.cov @ design.T + prior.unexplained_px**2 * np.eye(60) + own @ own.T
    gain = np.linalg.solve(cov_seen, design @ prior.cov).T
    cov = prior.cov - gain @ design @ prior.cov
    there = np.concatenate([polynomial(GRID), np.zeros((len(GRID), 1)), field_over(640, 480).at(GRID)], axis=1)
    assert offsets_px(rows, GRID) == pytest.approx(there @ gain @ seen, abs=1e-9)
    assert variance(rows) == pytest.approx(np.einsum("ni,ij,nj->n", there, cov, there), rel=1e-6)


@pytest.mark.parametrize("wrong", [0.0, 0.2])
def test_smooth_differences_are_learnt(wrong: float) -> None:
    rows = learnt(np.random.default_rng(2), 20, NO_FIELD, wrong)
    # six coefficients from 800 matches: STD_PX √(6/800) on average, twice that in the corners; and the share of wrong
    # matches that robust weights cannot distinguish from good ones
    assert np.abs(offsets_px(rows, GRID) - smooth(GRID)).max() < 5 * STD_PX * np.sqrt(6 / 800)
    # wrong matches, symmetric about it, increase the median deviation by a third
    assert 0.8 * STD_PX < rows.scatter_px < 1.5 * STD_PX
    down = np.array([0.0, 1.0])
    assert agree(rows, GRID, GRID + (offsets_px(rows, GRID) - smooth(GRID))[:, None] * down).all()
    assert not agree(rows, GRID, GRID + 6 * rows.scatter_px * down).any()


def test_rows_of_new_matches_err_as_those_of_the_run_do() -> None:
    """Their images may show σ of a third: then the right row gets the rest. If they show it all, nothing changes."""
    rows = learnt(np.random.default_rng(3), 20, NO_FIELD)
    noise, left, right = rows.unexplained_px, 0.2, 0.3
    seen, other = (np.diag([1, left**2, 1, right**2]) * share**2 * noise**2 for share in (1.0, 4.0))
    cov = rows.of_matches(np.stack([seen, seen]))
    assert np.all(cov[:, 1, 1] + cov[:, 3, 3] == pytest.approx(noise**2)) and np.all(cov[:, :3, :3] == seen[:3, :3])
    assert np.all(rows.of_matches(np.stack([other, other])) == other) and not len(rows.of_matches(np.empty((0, 4, 4))))
    assert np.all(Rows.unknown(P, Config()).of_matches(np.stack([seen, seen])) == seen)  # the run has shown nothing yet


def test_nothing_is_claimed_before_anything_is_seen() -> None:
    rows = Rows.unknown(P, Config())
    assert (offsets_px(rows, GRID) == 0).all()
    few = rows.learnt(GRID[:3], np.ones(3), np.zeros(3))  # too few to distinguish a surface from noise
    assert (offsets_px(few, GRID) == 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_no_field_is_seen_where_there_is_none(seed: int) -> None:
    """Rendered rigs have none: a field of 10 mpx would do them more harm than good."""
    assert learnt(np.random.default_rng(seed), 60, NO_FIELD).field_std_px < 5e-3


@pytest.mark.parametrize("std_px", [0.05, 0.15])
def test_the_size_of_a_field_is_learnt(std_px: float) -> None:
    """There are K amplitudes with σ = 1, so the estimate of their size scatters by at least 1/√(2K)."""
    ratios, off2, expected2 = [], [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        amplitudes = std_px * rng.normal(size=len(NO_FIELD))
        rows = learnt(rng, 60, amplitudes)
        ratios.append(rows.field_std_px / std_px)
        off2.append(((offsets_px(rows, GRID) - smooth(GRID) - field(GRID, amplitudes)) ** 2).mean())
        expected2.append(variance(rows).mean())
    scatter = 1 / np.sqrt(2 * len(NO_FIELD))
    assert np.mean(ratios) == pytest.approx(1, abs=3 * scatter)
    assert np.sqrt(np.mean(off2)) < 0.6 * std_px  # most of it is known
    assert 0.7 < np.sqrt(np.mean(off2) / np.mean(expected2)) < 1.4  # and σ covers the rest


def test_rows_that_drift_are_followed() -> None:
    """They drift by 2 px in 1200 frames, as in lenses that warm up: the rows of the last frames are right."""
    rng, rows, off = np.random.default_rng(3), Rows.unknown(P, Config()), []
    for frame in range(1200):
        at = places(rng, 12)  # new tracks per frame of a calm run
        drifted = 2 * frame / 1200
        off.append(np.abs(offsets_px(rows, GRID[::7]) - drifted).max())
        rows = rows.learnt(at, drifted + STD_PX * rng.normal(size=len(at)), np.zeros(len(at)))
    # a filter that lags by τ frames is off by τ · 2/1200; with 12 matches of 0.1 px and steps of 2 mpx τ is about 15
    assert max(off[50:]) < 3 * STD_PX
    assert rows.scatter_px < 1.3 * STD_PX


@pytest.mark.parametrize("delay_s", [0.0, 2e-3, -8e-3])
def test_a_late_camera_is_not_mistaken_for_row_differences(delay_s: float) -> None:
    rows = learnt(np.random.default_rng(4), 30, NO_FIELD, delay_s=delay_s)
    assert np.abs(offsets_px(rows, GRID) - smooth(GRID)).max() < 5 * STD_PX * np.sqrt(7 / 1200)
    at = rows_of._POLYNOMIAL
    mean, std = rows.mean[at], np.sqrt(rows.cov[at, at])
    assert abs(mean - delay_s) < 3 * std and std < 1e-3
    speed = np.full(len(GRID), 100.0)  # a match that has moved by the effect of the delay agrees
    difference = offsets_px(rows, GRID, speed) - (smooth(GRID) - delay_s * speed)
    assert agree(rows, GRID, GRID + np.stack([np.zeros(len(GRID)), difference], axis=1), speed).all()
    information, weighted = rows.delay  # from matches alone
    prior = Config().rig.std_delay_s ** -2.0
    assert (information, weighted) == pytest.approx((std**-2 - prior, mean / std**2), rel=1e-6)


def test_an_estimated_delay_counts_as_known() -> None:
    """One frame of a nodding camera hardly separates delay from row differences; with a given delay it does."""
    rng = np.random.default_rng(6)
    at, speed = places(rng), 60 + rng.normal(size=N)
    rows = Rows.unknown(P, Config()).learnt(at, smooth(at) + 8e-3 * speed + STD_PX * rng.normal(size=N), speed)
    assert np.abs(offsets_px(rows, GRID) - smooth(GRID)).max() > 0.2
    std = 1e-4
    known, d = rows.with_delay(-8e-3, std**2), rows_of._POLYNOMIAL
    information = np.linalg.inv(rows.cov)
    information[d, d] += std**-2 - 1 / rows.cov[d, d]
    assert known.cov == pytest.approx(np.linalg.inv(information), abs=1e-12, rel=1e-6)
    assert known.mean[d] == pytest.approx(-8e-3)
    off = np.abs(offsets_px(known, GRID) - smooth(GRID))
    assert (off < 4 * np.sqrt(variance(known)) + 0.02).all()
    assert rows.with_delay(0.0, 1.0) is rows  # a less certain delay is ignored


def test_an_impossible_delay_is_not_found() -> None:
    rng, rows = np.random.default_rng(5), Rows.unknown(P, Config(rig=RigConfig(exact=True)))
    for _ in range(20):
        at, speed = places(rng), np.full(N, 60 * rng.normal())
        rows = rows.learnt(at, -8e-3 * speed + STD_PX * rng.normal(size=N), speed)
    assert abs(rows.mean[rows_of._POLYNOMIAL]) < 1e-8


def test_errors_of_rows_are_those_of_the_right_sides() -> None:
    """Together with those of timing they have the dense covariance, and look like the turn that fits it best."""
    rng, twist = np.random.default_rng(7), np.array([0.3, -0.5, 0.2, 0.4, 0.1, -0.3])
    rows = learnt(rng, 5, 0.1 * rng.normal(size=len(NO_FIELD)))
    z_px = np.concatenate([places(rng), places(rng)], axis=1)
    z_px[::3, 2:] = np.nan
    points = np.column_stack([P.rays(z_px), np.ones(N), rng.uniform(0.05, 0.5, N)])
    timing = replace(Timing.unknown(P, RigConfig(), None), twist=0.5 * twist)
    std_twist = np.repeat([0.3, 0.1], 3)
    unknown, cov_turn = core.unknown_errors(timing, rows, points, points, z_px, twist, std_twist)
    cameras, moving = (P, timing.row_of), (points, 0.5 * twist, points, twist)
    others = core.timing_unknowns(*cameras, *moving, timing.mean, timing.cov, std_twist)
    seen = np.isfinite(z_px[:, 2])
    terms = row_terms(P, z_px[:, :2], velocities(P, points, twist)[:, 3])
    errors = seen[:, None] * (terms @ np.linalg.cholesky(rows.cov))
    dense = np.concatenate([others, np.zeros((N, 4, errors.shape[1]))], axis=2)
    dense[:, 3, others.shape[2] :] = errors
    dense, found = dense.reshape(4 * N, -1), unknown.reshape(4 * N, -1)
    assert found @ found.T == pytest.approx(dense @ dense.T, abs=0.02)  # px², except for negligible components
    by_turn = core.effects_of_turn(P, z_px[seen, 2:])
    turns = np.linalg.solve(np.einsum("nia,nib->ab", by_turn, by_turn), by_turn[:, 1].T @ errors[seen])
    assert cov_turn == pytest.approx(turns @ turns.T, rel=1e-9)


def shaken(delay_s: float, wrong: float = 0.0, std_turning: float = 0.5) -> Rows:
    """Rows after frames of a late camera that turns by 0.5 rad/s more or less than is expected, in each frame anew."""
    rng, rows = np.random.default_rng(8), Rows.unknown(P, Config())
    for _ in range(30):
        left_px = places(rng, 60)
        points = np.column_stack([P.rays(left_px), np.ones(60), rng.uniform(0.05, 0.5, 60)])
        z_px = P.project_homogeneous(points)
        expected, error = np.r_[np.zeros(3), 0.2 * rng.normal(size=3)], np.r_[np.zeros(3), 0.5 * rng.normal(size=3)]
        z_px += STD_PX * rng.normal(size=z_px.shape)
        z_px[:, 3] += delay_s * velocities(P, points, expected + error)[:, 3] + wrong * rng.normal(size=60)
        rows = rows.after(z_px, expected, std_turning)
    return rows


def test_an_unknown_turn_during_a_delay_explains_rows_and_nothing_else_does() -> None:
    """8 ms at 0.5 rad/s move all rows by up to 2 px, as exchanged images would move each."""
    noise = np.sqrt(2) * STD_PX
    late = shaken(8e-3)
    assert late.scatter_px > 0.5 > 2 * late.unexplained_px
    assert shaken(0.0).unexplained_px < 1.3 * noise
    assert shaken(0.0, wrong=1.0).unexplained_px > 0.5
    assert shaken(8e-3, wrong=1.0).unexplained_px > 0.5


def test_a_delay_is_as_certain_as_the_turn_rates_of_the_frames_allow() -> None:
    """A rate that errs by 0.5 rad/s in each frame moves all its rows alike, by more than the delay itself does."""
    information, weighted = shaken(8e-3).delay
    assert abs(weighted / information - 8e-3) < 3 / np.sqrt(information)
    information, weighted = shaken(8e-3, std_turning=0.0).delay
    assert abs(weighted / information - 8e-3) > 5 / np.sqrt(information)
