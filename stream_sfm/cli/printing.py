"""How results are printed: JSON, tables, and warnings on standard error."""

import json
import sys
from collections.abc import Iterable
from typing import Any

from rich.console import Console as RichConsole
from rich.table import Table

from ..files import json_bytes
from ..wording import printable

_PIPED_WIDTH = 110  # columns of a table that goes to a file or a pipe


class Console(RichConsole):
    """A console that leaves it to `main` what follows when the reader of our output has gone."""

    def on_broken_pipe(self) -> None:
        """Pass the error on; Rich would exit here with code 1."""
        raise BrokenPipeError


def stdout_console(piped_width: int = _PIPED_WIDTH) -> Console:
    """Standard output: as wide as the terminal, else `piped_width` columns."""
    return Console(width=None if sys.stdout.isatty() else piped_width)


def print_json(value: Any) -> None:
    """One JSON object; NaN and infinity become null. Characters that a terminal would obey are escaped."""
    print("\n".join(map(_escaped, json_bytes(value).decode().split("\n"))), end="")


def _escaped(line: str) -> str:
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in line) if not line.isprintable() else line


def cleaned(value: Any) -> Any:
    """What is about to be printed, a text or anything that holds texts, with every text made printable."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, dict):
        return {key: cleaned(content) for key, content in value.items()}
    if isinstance(value, list | tuple):
        return [cleaned(content) for content in value]
    return value


def print_notes(kind: str, notes: Iterable[str], console: Console | None = None) -> None:
    """One line each, such as "warning: …", on standard error unless a console is given."""
    for note in notes:
        (console or Console(stderr=True, soft_wrap=True)).print(
            f"{kind}: {printable(note)}", markup=False, highlight=False
        )


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


def factors_text(spans: list[dict[str, Any]]) -> str:
    """How large errors of relative motion are, and over how many frames."""
    factors, frames = (
        ", ".join(format(span[key], form) for span in spans) for key, form in (("factor", ".2f"), ("frames", "d"))
    )
    return f"{factors} × the estimated σ over {frames} frames"
