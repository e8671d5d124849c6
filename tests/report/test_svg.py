"""Charts: thinning keeps what matters, nothing is drawn of nothing, names are escaped."""

import numpy as np
import pytest

from stream_sfm.report.svg import Chart, Series, draw, round_numbers, thinned


def test_thinning_keeps_extremes_and_ends() -> None:
    y = np.sin(np.arange(20_000) / 50)
    y[7_777], y[12_345] = 9.0, -9.0
    rows = thinned(np.arange(len(y)), y, 500)
    assert len(rows) <= 510
    assert {0, 7_777, 12_345, len(y) - 1} <= set(rows.tolist())
    assert (np.diff(rows) > 0).all()


def test_thinning_keeps_breaks() -> None:
    y = np.ones(5_000)
    y[2_500:2_600] = np.nan
    assert np.isnan(y[thinned(np.arange(5_000), y)]).any()


@pytest.mark.parametrize("y", [[], [np.nan, np.nan]])
def test_nothing_to_draw_is_said(y: list[float]) -> None:
    text = draw(Chart("t", "x", "y", [Series("a", np.arange(len(y)), np.array(y), "m-ekf")]))
    assert "No data." in text and "<svg" not in text


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("y", [[0.0], [0.0, 0.0], [5.0, 5.0], [1e-9, 2e-9], [-1.0, 1e7], [3.0, np.nan, 4.0]])
def test_any_values_give_finite_coordinates(y: list[float], log: bool) -> None:
    text = draw(Chart("t", "x", "y", [Series("a", np.arange(len(y)), np.array(y), "m-ekf")], log_y=log, zero=True))
    assert "nan" not in text.replace("m-", "") and "inf" not in text


def test_names_are_escaped() -> None:
    text = draw(Chart("<script>", "x<y", "&", [Series('"><script>', np.arange(2), np.arange(2.0), "m-ekf")]))
    assert "<script" not in text and "&lt;script" in text


def test_numbers_on_whole_axes_are_round() -> None:
    assert round_numbers(83, 8) == [0, 20, 40, 60, 80]
    assert round_numbers(7, 8) == list(range(8))
    assert round_numbers(1234, 4) == [0, 500, 1000]
    assert round_numbers(0, 4) == [0]


def test_what_the_page_explains_has_no_legend_of_its_own() -> None:
    x = np.arange(3)
    methods = [Series(name, x, x, "m-ekf") for name in ("cross-frame", "EKF")]
    assert "legend" not in draw(Chart("t", "x", "y", methods))
    assert "legend" in draw(Chart("t", "x", "y", [*methods, Series("new", x, x, "m-ekf")]))
    assert "y (logarithmic)" in draw(Chart("t", "x", "y", [Series("a", x + 1, x + 1, "m")], log_y=True))
