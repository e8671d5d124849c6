"""Files from outside: regular ones only, small ones read up to a limit, and bounded before a parser sees them.

A parser that recurses can be ended by brackets alone, and one that builds what it reads can be filled by dots or
aliases. The limits are far above what a person or a tool writes.
"""

import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from errno import EFBIG, EINVAL
from pathlib import Path
from typing import IO, Any

from .errors import LogError

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
INT64 = 2**63  # whole numbers are smaller: sizes, stamps in nanoseconds
MAX_DEPTH = 32  # of brackets; settings and calibrations need four
_MAX_INDENT = 128  # spaces in front of a line, each of which may be a level in YAML
_MAX_DOTS = 100  # in a line: a 4×4 matrix has 16
_MAX_MERGES = 8  # `<<` of YAML, which may double what there is
_MAX_NODES = 100_000  # values, those that are repeated by an alias counted each time
_STEP = re.compile(r"(?P<opens>[\[{]|<\w)|[\]}]|</|/>")
_DEEP_LINE = re.compile(
    rf"^(?: {{{_MAX_INDENT}}}|\t{{{MAX_DEPTH}}}|[ \t]*(?:[-?] +){{{MAX_DEPTH}}})[ \t]*\S", re.MULTILINE
)
_DOTTED_LINE = re.compile(rf"^(?:[^.\n]*\.){{{_MAX_DOTS}}}", re.MULTILINE)


def open_regular(path: str | Path, buffering: int = -1) -> IO[bytes]:
    """Open a file for reading. Raises OSError where that fails or the file is not a regular one; `strerror` says why.

    A pipe or a device might never end, or never begin; a log is read more than once besides.
    """
    try:
        _check_regular(os.stat(path).st_mode)
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # it may have become a pipe by now
    except ValueError:
        raise OSError(EINVAL, "its name holds a NUL character") from None
    except FileNotFoundError:
        if str(path) == "-":
            raise OSError(EINVAL, "standard input is not read: give a file") from None
        raise
    try:
        _check_regular(os.fstat(descriptor).st_mode)
    except OSError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb", buffering)


def _check_regular(mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise OSError(EINVAL, f"it is {_KINDS.get(stat.S_IFMT(mode), 'a special file')}: give a file")


@contextmanager
def reading(what: object) -> Iterator[None]:
    """Within the context an OSError becomes a LogError that names what is read."""
    try:
        yield
    except OSError as error:
        raise LogError(f"cannot read {what}: {error.strerror}") from None


def read_small(path: str | Path, max_bytes: int) -> bytes:
    """The content of a file of at most `max_bytes`. Raises OSError as `open_regular`, and where it is larger."""
    with open_regular(path) as stream:
        content = stream.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise OSError(EFBIG, f"it is larger than {max_bytes} bytes: is it another file?")
    return content


def parse_toml(text: str) -> dict[str, Any]:
    """The content of TOML. Raises ValueError or RecursionError where it is none, or none that a person would write."""
    import tomllib

    check_text(text)
    data = tomllib.loads(text)
    check_values(data)
    return data


def check_text(text: str) -> None:
    """Raise ValueError where a text in TOML, YAML, JSON or XML is nested too deeply for a parser that recurses."""
    depth = 0
    for step in _STEP.finditer(text):
        depth += 1 if step["opens"] else -1
        if depth > MAX_DEPTH:
            raise ValueError(f"its brackets are nested more than {MAX_DEPTH} deep")
    if _DEEP_LINE.search(text):
        raise ValueError("a line is indented or nested too deeply")
    if _DOTTED_LINE.search(text):
        raise ValueError(f"a line holds {_MAX_DOTS} dots or more")
    if text.count("<<") > _MAX_MERGES:
        raise ValueError(f"it merges mappings (<<) more than {_MAX_MERGES} times")


def check_values(data: Any) -> None:
    """Raise ValueError where parsed content holds too many values, or a whole number beyond 64 bits."""
    todo, count = [data], 0
    while todo:
        value = todo.pop()
        count += 1
        if count > _MAX_NODES:
            raise ValueError(f"it holds more than {_MAX_NODES} values")
        if isinstance(value, dict):
            todo += value.values()
        elif isinstance(value, list | tuple):
            todo += value
        elif isinstance(value, int) and not -INT64 <= value < INT64:
            raise ValueError("it holds a whole number beyond 64 bits")
