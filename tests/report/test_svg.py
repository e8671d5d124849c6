"""Charts: thinning keeps what matters, nothing is drawn of nothing, names are escaped."""

import re

import numpy as np
import pytest

from stream_sfm.report.svg import Chart, Row, Series, draw, intervals, round_numbers, thinned


def test_thinning_keeps_extremes_and_ends() -> None:
    y = np.sin(np.arange(20_000) / 50)
    y[7_777], y[12_345] = 9.0, -9.0
    rows = thinned(np.arange(len(y)), y, 500)
    assert len(rows) <= 510  # 500 and both ends of breaks
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


def test_lines_are_named_at_their_ends_without_overlap() -> None:
    x = np.arange(3)
    close = [Series(name, x, x * (1 + 0.001 * k), "m-ekf") for k, name in enumerate("abc")]
    text = draw(Chart("t", "x", "y", close))
    places = sorted(float(y) for y in re.findall(r'y="([\d.]+)" class="name', text))
    assert len(places) == 3 and np.diff(places).min() >= 12  # px; a label is 11.5 high
    quiet = Series("d", x, x * 1.0, "m-other", quiet=True)
    assert ">d<" not in draw(Chart("t", "x", "y", [*close, quiet]))  # no room
    assert 'class="name' not in draw(Chart("t", "x", "y", close[:1]))
    assert "y (logarithmic)" in draw(Chart("t", "x", "y", [Series("a", x + 1, x + 1, "m")], log_y=True))


def test_a_path_has_one_scale_and_its_ends_marked() -> None:
    x, y = np.array([0.0, 4.0]), np.array([0.0, 1.0])
    text = draw(Chart("t", "x", "y", [Series("a", x, y, "m-ekf")], path=True))
    (x0, y0), (x1, y1) = re.findall(r'class="(?:start|end)" cx="([\d.]+)" cy="([\d.]+)"', text)
    assert (float(x1) - float(x0)) == pytest.approx(4 * (float(y0) - float(y1)), abs=0.5)  # rounded to 0.1 px
    assert ">start<" in text and ">end<" in text


def test_values_with_intervals_stand_on_one_axis() -> None:
    text = intervals("t", "ratio", [Row("EKF", 2.0, 1.0, 4.0, "m-ekf"), Row("", 1.0, 0.5, 2.0, "m-ekf")])
    middles, lines = re.findall(r'cx="([\d.]+)"', text), re.findall(r'M([\d.]+) [\d.]+H([\d.]+)"/><circle', text)
    for middle, (low, high) in zip(middles, lines, strict=True):  # in the middle on a logarithmic axis
        assert float(middle) == pytest.approx((float(low) + float(high)) / 2, abs=0.11)
    assert "No data." in intervals("t", "ratio", [])
