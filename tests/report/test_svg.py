"""Charts: nothing is drawn of nothing, names are escaped and stand apart."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from stream_sfm.report.svg import Chart, Row, Series, draw, intervals


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


def labels(text: str) -> dict[str, float]:
    """The texts of a chart, with their heights."""
    root = ElementTree.fromstring(text[text.index("<svg") : text.index("</svg>") + 6].replace("xlink:", ""))
    found = {}
    for item in root.iter("text"):
        place = item.get("y") or re.findall(r"[-.\d]+", item.get("transform", ""))[1]
        found[item.text or ""] = float(place)
    return found


def test_lines_are_named_at_their_ends_without_overlap() -> None:
    x = np.arange(3)
    close = [Series(name, x, x * (1 + 0.001 * k), "m-ekf") for k, name in enumerate(("one", "two", "three"))]
    found = labels(draw(Chart("t", "x", "y", close)))
    places = sorted(found[name] for name in ("one", "two", "three"))
    assert np.diff(places).min() >= 12  # px; a label is 11.5 high
    quiet = Series("four", x, x * 1.0, "m-other", quiet=True)
    assert "four" not in labels(draw(Chart("t", "x", "y", [*close, quiet])))  # no room
    assert "one" not in labels(draw(Chart("t", "x", "y", close[:1])))
    assert "y (logarithmic)" in labels(draw(Chart("t", "x", "y", [Series("a", x + 1, x + 1, "m")], log_y=True)))


def test_a_path_has_its_ends_marked() -> None:
    x, y = np.array([0.0, 4.0]), np.array([0.0, 1.0])
    found = labels(draw(Chart("t", "x", "y", [Series("a", x, y, "m-ekf")], path=True)))
    assert found["end"] < found["start"]


def test_values_with_intervals_stand_on_one_axis() -> None:
    text = intervals("t", "ratio", [Row("EKF", 2.0, 1.0, 4.0, "m-ekf"), Row("", 1.0, 0.5, 2.0, "m-ekf")])
    assert "EKF" in labels(text) and labels(text)["EKF"] < labels(text)["ratio (logarithmic)"]
    assert "No data." in intervals("t", "ratio", [])


def test_equal_charts_are_equal_bytes_and_take_their_colours_from_the_page() -> None:
    one, other = (draw(Chart("t", "x", "y", [Series("a", np.arange(3), np.arange(3.0), "m-ekf")])) for _ in "ab")
    assert one == other and "stroke: var(--c4)" in one and not re.search("#[0-9a-f]{6}", one)
