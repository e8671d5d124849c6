"""The turn of the right camera that rows show, against turned cameras and lenses that differ."""

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.frontend.learnt.row_turn import turn_by_rows
from stream_sfm.frontend.learnt.rows import Rows
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.rig_model.terms import effects_of_turn

P = StereoProjection(600.0, 320.0, 320.0, 240.0, 0.2, 640, 480)
STD_PX = 0.15


def rows_of(seed: int, turn_rad: np.ndarray, radial_px: float = 0.0, frames: int = 10) -> Rows:
    """Rows learnt from matches of a right camera that is turned, whose lens differs by `radial_px` at the corner."""
    rng, rows = np.random.default_rng(seed), Rows.unknown(P, Config())
    for _ in range(frames):
        left_px = rng.uniform((0, 0), (640, 480), (80, 2))
        slopes = (left_px - (320, 240)) / 400  # 1 at the corner
        lens_px = radial_px * slopes[:, 1] * (slopes**2).sum(axis=1)
        shift_px = effects_of_turn(P, left_px)[:, 1] @ turn_rad + lens_px
        rows = rows.learnt(left_px, shift_px + STD_PX * rng.normal(size=80), np.zeros(80))
    return rows


def test_a_turn_about_x_and_z_is_found_with_its_uncertainty() -> None:
    """χ² of two values over 40 seeds has the mean 2 and a σ of 0.32; the rows of one frame say more than they claim."""
    true = np.array([3e-3, 0.0, -2e-3])
    chi2 = []
    for seed in range(40):
        turn = turn_by_rows([rows_of(seed, true)])
        away = turn.rad - true[[0, 2]]
        chi2.append(away @ np.linalg.solve(turn.cov, away))
        assert turn.is_real and turn.left < 0.1
    assert 0.5 < np.mean(chi2) < 3.0


def test_two_logs_know_more_than_one() -> None:
    logs = [rows_of(seed, np.array([3e-3, 0.0, -2e-3])) for seed in (1, 2)]
    assert (np.diag(turn_by_rows(logs).cov) < np.diag(turn_by_rows(logs[:1]).cov)).all()


def test_rows_that_no_turn_explains_are_no_turn() -> None:
    """As those of lenses that differ; nor are rows that hardly differ."""
    assert not turn_by_rows([rows_of(0, np.zeros(3), radial_px=2.0)]).is_real
    assert not turn_by_rows([rows_of(0, np.array([5e-5, 0.0, 0.0]))]).is_real


def test_rms_of_the_rows_leaves_out_places_without_matches() -> None:
    rows = rows_of(0, np.array([1e-3, 0.0, 0.0]))
    assert rows.rms_px == pytest.approx(0.637, abs=0.03)  # 600 px · (1 + y²) · 1 mrad, |y| up to 0.4
    assert np.isnan(Rows.unknown(P, Config()).rms_px)
    difference_px, std_px = rows.over_image(3, 5)
    assert difference_px.shape == std_px.shape == (15,) and (std_px < 0.1).all()
