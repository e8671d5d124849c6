"""The content of pages: charts, numbers, names and tables, and the sentence about a calibration."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from stream_sfm.evaluation.figures import ACCURACY, CONSISTENCY, METRES, MILLIMETRES, Figure, unit_for
from stream_sfm.report.matches import Needles, matches
from stream_sfm.report.svg import Chart, Row, Series, draw, intervals
from stream_sfm.report.tables import Name, breakable, table, text_of


def line(y: object, **options: object) -> str:
    values = np.array(y, float)
    return draw(Chart("t", "x", "y", [Series("a", np.arange(len(values)), values, "c2")], **options))


@pytest.mark.parametrize("y", [[], [np.nan, np.nan]])
def test_nothing_to_draw_is_reported(y: list[float]) -> None:
    assert "No data." in line(y) and "<svg" not in line(y)


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("y", [[0.0], [0.0, 0.0], [5.0, 5.0], [1e-9, 2e-9], [-1.0, 1e7], [3.0, np.nan, 4.0]])
def test_any_values_give_finite_coordinates(y: list[float], log: bool) -> None:
    assert not re.search(r"\b(nan|inf)\b", line(y, log_y=log, zero=True))


def test_names_are_escaped_and_stand_above_the_chart() -> None:
    x = np.arange(2.0)
    text = draw(Chart("<script>", "x<y", "&", [Series(name, x, x, "c2") for name in ('"><script>', "other")]))
    assert "<script" not in text and "&lt;script" in text
    assert 'var(--c2)"></i>other</span>' in text


def test_values_with_intervals_are_named_on_one_axis() -> None:
    text = intervals("t", "ratio", [Row("EKF", 2.0, 1.0, 4.0, "c2"), Row("", 1.0, 0.5, 2.0, "c2")])
    root = ElementTree.fromstring(text[text.index("<svg") : text.index("</svg>") + 6].replace("xlink:", ""))
    assert {"EKF", "ratio (logarithmic)"} <= {item.text for item in root.iter("text")}


def test_matches_are_needles_on_the_image() -> None:
    """From the other place to the dot at the current one; rejected ones stand out; an empty frame is a picture too."""
    image = np.arange(48 * 64, dtype=np.uint8).reshape(48, 64)
    stereo = np.array([[[30.0, 10.0], [20.0, 10.0]], [[50.0, 30.0], [45.0, 30.0]]])
    found = Needles(7, image, stereo, stereo[:1], np.array([True, False]), np.array([True]))
    first, second = matches(found)
    assert "<b>Stereo matches</b>" in first and "frame 7" in first and "data:image/png;base64" in first
    assert "var(--ok)" in first and "var(--lost)" in first and "rejected" in first
    assert "var(--lost)" not in second and "rejected" not in second
    assert matches(None) == []
    none = Needles(0, image, stereo[:0], stereo[:0], np.zeros(0, bool), np.zeros(0, bool))
    assert len(matches(none)) == 2


def test_equal_charts_are_equal_bytes_and_take_their_colours_from_the_page() -> None:
    text = line([0, 1, 2], path=True)
    assert text == line([0, 1, 2], path=True)
    assert "stroke: var(--c2)" in text and not re.search("#[0-9a-f]{6}", text)


@pytest.mark.parametrize(
    ("value", "factor", "text"),
    [
        (0.00028, 1000, "0.280"), (879.0, 1, "879"), (10312.4, 1, "10312"), (-0.0123, 1, "−0.0123"),
        (2e9, 1, "2.00e+09"), (12, 1, "12"), (None, 1, '<span class="nil">–</span>'),
        ({"value": 1.416, "ci95": [1.1, 1.8]}, 1, "×1.42 <small>[1.10, 1.80]</small>"),
    ],
)  # fmt: skip
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
    found = table((*ACCURACY, *CONSISTENCY, Figure("a_m", "a", "errors")), names, runs, {"errors": MILLIMETRES})
    assert found.headings == [("t_rel", "%"), ("NEES", "6 expected"), ("a", "mm")]  # nothing else is known
    assert [mark for _, cells in found.rows for _, mark in cells] == ["", "bad", "", "best", "", "", "", "", ""]
    assert found.rows[0][1][2][0] == "2.00"
    assert table(ACCURACY, names[:1], runs[1:2], {}).rows[0][1][0][1] == ""  # one alone is not the best
