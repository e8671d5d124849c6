"""Tables on standard output, by Rich, which takes a twentieth of a short run to import."""

import sys
from collections.abc import Iterable, Sequence

from rich.console import Console as RichConsole
from rich.table import Table
from rich.text import Text

from ..wording import printable

_PIPED_WIDTH = 110  # columns of a table that goes to a file or a pipe


class Console(RichConsole):
    """A console that lets `main` handle a closed output pipe."""

    def on_broken_pipe(self) -> None:
        """Pass the error on; Rich would exit here with code 1."""
        raise BrokenPipeError


def print_table(
    rows: Iterable[Sequence[str]],
    headings: Sequence[str] = (),
    *,
    title: str = "",
    width: int = _PIPED_WIDTH,
    text_columns: int = 1,
) -> None:
    """Print a table as wide as the terminal, or in `width` columns elsewhere.

    The first `text_columns` hold words, which may be folded; the others numbers, on the right. Without headings it is
    a list of facts: labels and sentences.
    """
    heading = _text(title) if title else None
    table = Table(title=heading, title_justify="left", show_header=bool(headings))
    for number, name in enumerate(headings):
        words = number < text_columns
        table.add_column(
            name,
            justify="left" if words else "right",
            overflow="fold",
            no_wrap=not words,
            min_width=8 if words else 0,
        )
    if not headings:
        table.add_column(style="bold", no_wrap=True)
        table.add_column(overflow="fold")
    for row in rows:
        table.add_row(*map(_text, row))
    Console(width=output_width(width)).print(table)


def output_width(otherwise: int = _PIPED_WIDTH) -> int:
    """The columns of standard output: those of the terminal, or `otherwise`."""
    return Console().width if sys.stdout.isatty() else otherwise


def _text(cell: str) -> Text:
    """A cell as it is, not as Rich's markup; it may have several lines."""
    return Text("\n".join(map(printable, cell.split("\n"))))
