"""Filters what libraries print directly, past Python, to the descriptors of standard output and standard error.

OpenCV, FFmpeg and libpng quote what they read, so that a hostile file could send control sequences to the terminal, and
a camera driver could print between the lines of our JSON. A separate process, which outlives a crash and for which
nothing ever waits, makes every line printable and passes on the first ones to standard error.
"""

import os
import signal
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ..system.wording import LISTED, printable

_LONGEST = 400  # characters per line that are shown
_END_S = 1.0  # for passing on the last lines; a viewer that keeps running may hold the descriptor for longer


@contextmanager
def filtered(quiet: bool) -> Iterator[None]:
    """Within the context, only printable lines of libraries reach standard error, and none if `quiet`.

    None of them reaches standard output; `sys.stdout` and `sys.stderr` are not affected. Python's warnings are not
    shown unless requested. Enter it while there is only one thread.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    try:
        real_out, real, (reader, writer) = os.dup(1), os.dup(2), os.pipe()
        filtering = os.fork()
    except OSError:  # the limit of processes or files is reached
        yield
        return
    if not filtering:
        try:
            os.closerange(0, 2)  # readers of our output do not wait for this process
            os.dup2(real, 2)
            os.close(real_out)
            os.close(writer)
            _pass_on(reader, quiet)
        finally:
            os._exit(0)
    os.close(reader)
    sys.stdout.flush()
    shown = sys.stdout, sys.stderr, sys.__stdout__
    by_line = 1 if sys.stdout.isatty() else -1
    sys.stdout = open(real_out, "w", buffering=by_line, encoding=sys.stdout.encoding)  # noqa: SIM115
    sys.stderr = open(real, "w", buffering=1, encoding=sys.stderr.encoding)  # noqa: SIM115
    sys.__stdout__ = sys.stdout  # type: ignore[misc]  # Rich asks it for the width of the terminal
    os.dup2(writer, 1)
    os.dup2(writer, 2)
    os.close(writer)
    try:
        yield
    finally:
        with suppress(OSError):
            sys.stdout.flush()
        with suppress(OSError):
            sys.stderr.flush()
        os.dup2(real_out, 1)
        os.dup2(real, 2)
        sys.stdout, sys.stderr, sys.__stdout__ = shown  # type: ignore[misc]
        end_s = time.monotonic() + _END_S
        while os.waitpid(filtering, os.WNOHANG) == (0, 0) and time.monotonic() < end_s:
            time.sleep(0.001)


def _pass_on(reader: int, quiet: bool) -> None:
    """Read everything, and print the first lines."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # the other processes end first
        signal.signal(number, signal.SIG_IGN)
    lines, begun = 0, b""
    while data := os.read(reader, 2**16):
        *whole, begun = (begun + data).split(b"\n")
        begun = begun[: 4 * _LONGEST]
        for line in whole if not quiet else []:
            lines += 1
            _print(line, lines)
    if begun and not quiet:
        _print(begun, lines + 1)


def _print(line: bytes, number: int) -> None:
    text = printable(line.decode(errors="backslashreplace").strip())[:_LONGEST]
    if number > LISTED + 1 or not text:
        return
    shown = f"library: {text}" if number <= LISTED else "library: further lines are not shown; --debug shows all"
    with suppress(OSError):
        os.write(2, f"{shown}\n".encode(errors="backslashreplace"))
