"""How results are printed: JSON, numbers, and warnings on standard error. All text is made printable here."""

import json
import sys
from collections.abc import Iterable
from typing import Any

from ..files import json_bytes
from ..wording import printable


def print_json(value: Any) -> None:
    """One JSON object; NaN and infinity become null. Characters that a terminal would obey are escaped."""
    print("\n".join(map(_escaped, json_bytes(value).decode().split("\n"))), end="")


def _escaped(line: str) -> str:
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in line) if not line.isprintable() else line


def print_notes(kind: str, notes: Iterable[str], stderr: bool = True) -> None:
    """One line each, such as "warning: …", on standard error, or on standard output where they are the result."""
    for note in notes:
        print(f"{kind}: {printable(note)}", file=sys.stderr if stderr else sys.stdout)


def number(value: float | str | None, form: str = ".2f") -> str:
    """A number in the given format; a dash for None."""
    if value is None:
        return "–"
    return value if isinstance(value, str) else format(value, form)


def factors_text(spans: list[dict[str, Any]]) -> str:
    """How large errors of relative motion are, and over how many frames."""
    factors, frames = (
        ", ".join(format(span[key], form) for span in spans) for key, form in (("factor", ".2f"), ("frames", "d"))
    )
    return f"{factors} × the estimated σ over {frames} frames"
