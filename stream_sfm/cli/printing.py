"""How results are printed: JSON, tables, and warnings on standard error."""

import sys
from collections.abc import Iterable
from typing import Any

from rich.console import Console
from rich.table import Table

from ..files import json_bytes

_PIPED_WIDTH = 110  # columns of a table that goes to a file or a pipe


def stdout_console(piped_width: int = _PIPED_WIDTH) -> Console:
    """Standard output: as wide as the terminal, else `piped_width` columns."""
    return Console(width=None if sys.stdout.isatty() else piped_width)


def print_json(value: Any) -> None:
    """One JSON object; NaN and infinity become null."""
    print(json_bytes(value).decode(), end="")


def print_notes(kind: str, notes: Iterable[str], console: Console | None = None) -> None:
    """One line each, such as "warning: …", on standard error unless a console is given."""
    for note in notes:
        (console or Console(stderr=True, soft_wrap=True)).print(f"{kind}: {note}", markup=False, highlight=False)


def facts_table(title: str | None = None) -> Table:
    """A table of labels and values without a heading."""
    table = Table(title=title, title_justify="left", show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    return table


def number(value: float | str | None, form: str = ".2f") -> str:
    """A number in the given format; a dash for None."""
    if value is None:
        return "–"
    return value if isinstance(value, str) else format(value, form)
