"""Numbers, names and tables as the pages show them."""

import numpy as np
import pytest

from stream_sfm.report.tables import (
    ACCURACY,
    METRES,
    MILLIMETRES,
    Figure,
    Name,
    breakable,
    table,
    text_of,
    unit_for,
)


@pytest.mark.parametrize(
    ("value", "factor", "text"),
    [
        (0.00028, 1000, "0.280"),
        (879.0, 1, "879"),
        (10312.4, 1, "10312"),
        (-0.0123, 1, "−0.0123"),
        (2e9, 1, "2.00e+09"),
        (12, 1, "12"),
        (None, 1, '<span class="nil">–</span>'),
        ({"value": 1.416, "ci95": [1.1, 1.8]}, 1, "×1.42 <small>[1.10, 1.80]</small>"),
    ],
)
def test_numbers_are_written_with_three_significant_digits(value: object, factor: float, text: str) -> None:
    assert text_of(value, factor) == text


def test_small_lengths_are_in_millimetres() -> None:
    assert unit_for([0.001, np.nan, -0.9], np.zeros((2, 2))) == unit_for() == MILLIMETRES
    assert unit_for([0.001], [-1.5]) == METRES


def test_long_names_break_at_their_separators_and_are_escaped() -> None:
    assert breakable("/data/a_b-1.mcap") == "/<wbr>data/<wbr>a_<wbr>b-<wbr>1.<wbr>mcap"
    assert breakable("<b>") == "&lt;b&gt;"


def test_a_table_marks_the_best_value_and_covariances_that_are_too_small() -> None:
    runs = [{"t_rel_percent": 0.2, "nees_pose_mean": 240.0, "a_m": 0.002}, {"t_rel_percent": 0.1}, {}]
    names = [Name(name) for name in "xyz"]
    found = table((*ACCURACY, Figure("a_m", "a", "errors")), names, runs, {"errors": MILLIMETRES})
    assert found.headings == [("t_rel", "%"), ("NEES", "6 expected"), ("a", "mm")]  # nothing else is known
    assert [mark for _, cells in found.rows for _, mark in cells] == ["", "bad", "", "best", "", "", "", "", ""]
    assert found.rows[0][1][2][0] == "2.00"
    assert table(ACCURACY, names[:1], runs[1:2], {}).rows[0][1][0][1] == ""  # one alone is not the best
