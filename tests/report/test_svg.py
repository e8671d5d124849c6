"""Charts: nothing is drawn of nothing, and names are escaped."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from stream_sfm.report.svg import Chart, Row, Series, draw, intervals


def line(y: object, **options: object) -> str:
    values = np.array(y, float)
    return draw(Chart("t", "x", "y", [Series("a", np.arange(len(values)), values, "c2")], **options))


@pytest.mark.parametrize("y", [[], [np.nan, np.nan]])
def test_nothing_to_draw_is_said(y: list[float]) -> None:
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


def test_equal_charts_are_equal_bytes_and_take_their_colours_from_the_page() -> None:
    text = line([0, 1, 2], path=True)
    assert text == line([0, 1, 2], path=True)
    assert "stroke: var(--c2)" in text and not re.search("#[0-9a-f]{6}", text)
