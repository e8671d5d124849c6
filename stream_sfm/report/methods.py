"""How methods and runs are named and drawn; a method by its name in METHODS, or by its key in report.json."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

LABELS = {
    "cross-frame": "cross-frame",
    "cross-frame-loops": "cross-frame with loops",
    "cross-frame-wc": "per-point WC",
    "cross-frame-cc": "per-point CC",
    "ekf": "EKF",
    "iterated-ekf": "iterated EKF",
    "ekf-cv": "constant-velocity EKF",
    "frame-to-frame": "frame-to-frame",
}
_IN_COLOUR = (
    "cross-frame",
    "ekf",
    "frame-to-frame",
    "iterated-ekf",
)  # four lines are the most that a chart shows well
_LONGEST = 20  # characters of a name beside a line
_SHORT = {"ekf-cv": "const.-velocity EKF"}  # where a chart has no room


class Look(NamedTuple):
    """The name of a line in a chart, its CSS class, and whether it is grey."""

    name: str
    style: str
    quiet: bool


def label(name: str) -> str:
    """A method's name in tables and sentences."""
    return LABELS.get(_plain(name), name)


def short(name: str) -> str:
    """A method's name in charts."""
    return _SHORT.get(_plain(name), label(name))


def style(name: str) -> str:
    """The CSS class of a method's lines."""
    return f"m-{_plain(name)}" if _plain(name) in _IN_COLOUR else "m-other"


def of_method(name: str) -> Look:
    """How a method is drawn."""
    return Look(short(name), style(name), _plain(name) not in _IN_COLOUR)


def of_runs(names: Sequence[str]) -> Callable[[str], Look]:
    """How runs are drawn, by the names of their folders: the first four in colour."""
    styles = [f"m-{method}" for method in _IN_COLOUR] + ["m-other"] * len(names)
    last = [Path(name).name for name in names]
    told = [
        name if last.count(name) == 1 else f"{Path(whole).parent.name}/{name}"
        for name, whole in zip(last, names, strict=True)
    ]
    looks = {
        name: Look(text if len(text) <= _LONGEST else f"…{text[1 - _LONGEST :]}", style, style == "m-other")
        for name, text, style in zip(names, told, styles, strict=False)
    }
    return looks.__getitem__


def _plain(name: str) -> str:
    return name.replace("_", "-")
