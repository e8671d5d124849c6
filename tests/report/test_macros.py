"""Numbers as the tables of the pages show them."""

import pytest

from stream_sfm.report.template import template


def shown(macro: str, *arguments: object) -> str:
    return str(getattr(template("macros.html.j2").module, macro)(*arguments))


@pytest.mark.parametrize(
    ("value", "digits", "text"), [(0.1234, 2, "0.12"), (-0.126, 2, "−0.13"), (-0.001, 2, "0.00"), (12.0, 0, "12")]
)
def test_fixed_digits(value: float, digits: int, text: str) -> None:
    assert shown("num", value, digits) == text


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
    assert shown("sig", value, factor) == text


def test_what_is_not_known_is_a_dash() -> None:
    assert "–" in shown("num", None) and "–" in shown("sig", None)
