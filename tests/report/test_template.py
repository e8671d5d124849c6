"""Numbers and names as the pages show them."""

import pytest

from stream_sfm.report.figures import ACCURACY, FURTHER, Figure, table
from stream_sfm.report.lengths import METRES, MILLIMETRES
from stream_sfm.report.template import breakable, num, sig, times


@pytest.mark.parametrize(
    ("value", "digits", "text"), [(0.1234, 2, "0.12"), (-0.126, 2, "−0.13"), (-0.001, 2, "0.00"), (12.0, 0, "12")]
)
def test_fixed_digits(value: float, digits: int, text: str) -> None:
    assert num(value, digits) == text


@pytest.mark.parametrize(
    ("value", "factor", "text"),
    [
        (0.00028, 1000, "0.280"),
        (57.44, 1, "57.4"),
        (879.0, 1, "879"),
        (10312.4, 1, "10312"),
        (-0.0123, 1, "−0.0123"),
        (2e9, 1, "2.00e+09"),
    ],
)
def test_significant_digits(value: float, factor: float, text: str) -> None:
    assert sig(value, factor) == text


def test_what_is_not_known_is_a_dash() -> None:
    assert "–" in num(None) and "–" in sig(None) and "–" in times(None)


def test_long_names_break_at_their_separators_and_are_escaped() -> None:
    assert breakable("/data/a_b-1.mcap") == "/<wbr>data/<wbr>a_<wbr>b-<wbr>1.<wbr>mcap"
    assert breakable("<b>") == "&lt;b&gt;"


def test_the_best_value_is_marked_and_a_covariance_that_is_too_small() -> None:
    runs = [{"t_rel_percent": 0.2, "nees_pose_mean": 240.0}, {"t_rel_percent": 0.1, "nees_pose_mean": 5.0}, {}]
    found = table(ACCURACY, runs, {"errors": METRES})
    columns = dict(zip((name for name, _ in found.headings), zip(*found.rows, strict=True), strict=True))
    assert [mark for _, mark in columns["t_rel"]] == ["", "best", ""]
    assert [mark for _, mark in columns["NEES"]] == ["bad", "", ""]
    assert [mark for _, mark in table(ACCURACY, runs[:1], {}).rows[0]] == ["", "", "", "", "bad"]  # one is not best


def test_a_turned_table_has_a_row_for_each_figure_that_is_known() -> None:
    figures = (Figure("a_m", "a", "errors"), *FURTHER)
    found = table(figures, [{"a_m": 0.002}, {"a_m": None}], {"errors": MILLIMETRES}).turned(["x", "y"])
    assert [name for name, _ in found.headings] == ["", "x", "y"]
    assert [[cell for cell, _ in row][:2] for row in found.rows] == [["a, mm", "2.00"]]
    assert table(ACCURACY, [], {}).rows == []
