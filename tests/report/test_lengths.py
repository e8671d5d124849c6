"""One unit for all lengths of a family: chosen once, and used by charts and tables alike."""

import re

import numpy as np
import pytest

from stream_sfm.geometry import se3
from stream_sfm.report.lengths import METRES, MILLIMETRES, LengthUnit, unit_for
from stream_sfm.report.run_page import render_run
from stream_sfm.report.svg import Series
from stream_sfm.types import Trajectory
from tests.report.test_run_page import STAMPS, TRUTH, columns, summary, trajectory


def test_small_lengths_are_in_millimetres() -> None:
    assert unit_for([0.001, np.nan, -0.9], None, np.zeros((2, 2))) == MILLIMETRES
    assert unit_for([0.001], [-1.5]) == METRES
    assert unit_for() == unit_for([np.nan]) == MILLIMETRES


def test_a_series_and_its_band_are_scaled_together() -> None:
    line = Series("a", np.arange(2), np.array([0.001, 0.002]), "m-ekf", band=np.array([[0, 0.001], [0.002, 0.003]]))
    (scaled,) = MILLIMETRES.of([line])
    np.testing.assert_allclose(scaled.y, [1, 2])
    assert scaled.band is not None
    np.testing.assert_allclose(scaled.band, [[0, 1], [2, 3]])


@pytest.mark.parametrize(("off_m", "unit"), [(0.05, MILLIMETRES), (3.0, METRES)])
def test_chart_and_table_of_a_run_have_one_unit(off_m: float, unit: LengthUnit) -> None:
    poses = trajectory().world_from_cam.copy()
    poses[1:] = poses[1:] @ se3.exp([off_m, 0, 0, 0, 0, 0])
    figures = TRUTH | {"ate_rmse_m": off_m, "ate_rmse_aligned_m": 0.5 * off_m}
    page = render_run(summary(ground_truth=figures), columns(), Trajectory(STAMPS, poses))
    assert f"<th>ATE<br><small>{unit.name}</small></th>" in page
    assert f"<td>{off_m * unit.per_m:#.3g}</td>".replace(".<", "<") in page
    chart = re.search(r'aria-label="Position error and σ".*?</svg>', page, re.DOTALL)
    assert chart and f">{unit.name}</text>" in chart[0]
    assert f"{0.5 * off_m * unit.per_m:.3g} {unit.name} RMS after alignment" in page or unit == METRES
