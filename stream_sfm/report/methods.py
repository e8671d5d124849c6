"""How methods and runs are named and drawn; a method by its name in METHODS, or by its key in report.json."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

REFERENCE = "cross-frame"  # errors of the others are given over its errors


class Look(NamedTuple):
    """The name of a line in a chart, and its colour, a variable of page.css."""

    name: str
    colour: str


Looks = Callable[[str], Look]
_LOOKS = {
    "cross-frame": Look("cross-frame", "c1"),
    "ekf": Look("EKF", "c2"),
    "iterated-ekf": Look("iterated EKF", "c3"),
    "frame-to-frame": Look("frame-to-frame", "c4"),
    "cross-frame-wc": Look("per-point WC", "c5"),
    "cross-frame-cc": Look("per-point CC", "c6"),
    "ekf-cv": Look("constant-velocity EKF", "c7"),
    "cross-frame-loops": Look("cross-frame with loops", "c8"),
}


def of_method(name: str) -> Look:
    """How a method is named and drawn."""
    return _LOOKS.get(name.replace("_", "-"), Look(name, "other"))


def of_runs(names: Sequence[str]) -> Looks:
    """How runs are drawn, by the names of their folders: in the colours of the methods one after the other."""
    colours = [look.colour for look in _LOOKS.values()]
    last = [Path(name).name for name in names]
    told = [name if last.count(name) == 1 else whole for name, whole in zip(last, names, strict=True)]
    return {name: Look(told[k], colours[k % len(colours)]) for k, name in enumerate(names)}.__getitem__
