"""Prints results: JSON, numbers, tables, and warnings on standard error. All text is made printable here.

Rich makes the tables. It is imported where they are printed, as that takes a twentieth of a short run.
"""

import json
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from ..system.wording import printable

if TYPE_CHECKING:
    from rich.console import Console

_PIPED_WIDTH = 110  # columns of a table that goes to a file or a pipe


def print_json(value: Any) -> None:
    """Print one JSON object; NaN and infinity become null. Control characters for terminals are escaped."""
    from ..system.files import json_bytes

    lines = json_bytes(value).decode().split("\n")
    print("\n".join("".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in line) for line in lines), end="")


def print_notes(kind: str, notes: Iterable[str], stderr: bool = True) -> None:
    """Print one line each, such as "warning: …", on standard error, or on standard output if they are the result."""
    for note in notes:
        print(f"{kind}: {printable(note)}", file=sys.stderr if stderr else sys.stdout)


def print_error(message: str) -> None:
    """Print one line on standard error; `batch` finds the errors of a replay by this prefix."""
    print(f"stream-sfm: {printable(message)}", file=sys.stderr)


def number(value: float | None, form: str = ".2f") -> str:
    """Return a number in the given format; a dash for None."""
    return "–" if value is None else format(value, form)


def factors_text(spans: list[dict[str, Any]], key: str = "factor") -> str:
    """Return the errors of relative motions in words, with their numbers of frames."""
    factors = ", ".join(f"{span[key]:.2f}" for span in spans)
    return f"{factors} × the estimated σ over {', '.join(str(span['frames']) for span in spans)} frames"


def broken_at(name: str, separators: str, width: int) -> str:
    """Return a long name in lines of at most `width` characters, broken at separators if there are any."""
    lines = []
    while len(name) > width:
        cut = max(name.rfind("/", 1, width + 1), *(name.rfind(s, 0, width) + 1 for s in separators if s != "/"))
        cut = cut if cut > 0 else width
        lines.append(name[:cut])
        name = name[cut:]
    return "\n".join([*lines, name])


def rich_console(**options: Any) -> "Console":
    """Return a console of Rich that lets `main` handle a closed output pipe."""
    from rich.console import Console

    class Ours(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # Rich would exit here with code 1

    return Ours(**options)


def output_width(otherwise: int = _PIPED_WIDTH) -> int:
    """Return the width of standard output: that of the terminal, or `otherwise`."""
    return rich_console().width if sys.stdout.isatty() else otherwise


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
    from rich.table import Table
    from rich.text import Text

    def text(cell: str) -> Text:  # plain, not Rich's markup; it may have several lines
        return Text("\n".join(map(printable, cell.split("\n"))))

    table = Table(title=text(title) if title else None, title_justify="left", show_header=bool(headings))
    for column, name in enumerate(headings):
        if column < text_columns:
            table.add_column(name, overflow="fold", min_width=8)
        else:
            table.add_column(name, justify="right", overflow="fold", no_wrap=True)
    if not headings:
        table.add_column(style="bold", no_wrap=True)
        table.add_column(overflow="fold")
    for row in rows:
        table.add_row(*map(text, row))
    rich_console(width=output_width(width)).print(table)
