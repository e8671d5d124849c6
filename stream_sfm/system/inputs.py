"""Files from outside: only regular ones are opened, small ones are read up to a limit, and bounded before parsing.

Brackets alone can crash a recursive parser, and dots or aliases can fill the memory of a parser that builds objects.
The limits are far above what a person or a tool writes.
"""

import os
import re
import stat
from collections.abc import Callable
from contextlib import AbstractContextManager
from errno import EFBIG, EINVAL
from pathlib import Path
from typing import IO, Any, NamedTuple

from ..errors import LogError, as_error

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


class Limits(NamedTuple):
    """Limits on the content of a file. No real file reaches them, and a file of kilobytes cannot cost gigabytes."""

    record_bytes: int = 128 * 2**20  # of a record, of a decompressed chunk, of a message; writers use 1–4 MiB
    small_bytes: int = 2**20  # of a parsed schema, a message with lists, an attachment: elements become objects
    header_bytes: int = 2**16  # of a few names, dozens of bytes
    ros_definition_bytes: int = 2**15  # of a type with its parts; the longest that is read, Odometry, has 8 kB
    definition_bytes: int = 8 * 2**20  # of one schema or channel; those of ROS and Foxglove messages are kilobytes
    definitions_bytes: int = 64 * 2**20  # of all that one file declares and that is kept while it is read
    object_bytes: int = 256  # overhead of each in memory, measured; all 2·65535 that MCAP has numbers for still fit
    name: int = 2**12  # characters of a topic, a type, a coordinate frame, an encoding; of a line of numbers
    named: int = 2**12  # topics, and pairs of coordinate frames; robots have hundreds
    compressed: int = 2**6  # topics of compressed images that are asked for video; robots have dozens
    indexed: int = 2**20  # entries of an index: a terabyte has fewer; lines of a text: nine hours at 30 Hz
    files: int = 2**14  # of one bag, whose metadata then has some megabytes
    metadata_bytes: int = 2**24
    text_bytes: int = 2**26  # of numbers: a pose of a million frames is a line of hundred bytes
    image_file_bytes: int = 2**28  # the largest image without any compression is half of it
    json_values: int = 2**22  # as many as a list of the pixels of a 4-megapixel image has
    json_text_bytes: int = 2**24  # that is not ASCII, which Python may widen to four bytes; base64 is ASCII
    mask_bytes: int = 2**24  # of a PNG that is black and white; an image of 12 megapixels in all colours has more
    settings_bytes: int = 2**18  # of TOML or YAML, which take the parser seconds; real ones have kilobytes
    raw_image_bytes: int = 2**25  # several are in memory at a time: as recorded, decompressed, and as a message
    jpeg_scans: int = 64  # progressive images have about ten, and each costs a pass over the whole image
    # A log without an index is scanned at most this far after cameras and calibrations have been found: some
    # seconds of reading, and enough for calibrations that are sent every few seconds.
    scanned_bytes: int = 2**28
    decoders: int = 64  # held at a time; each channel of a topic may have its own schema
    # Elements of an array of messages or strings, for each of which rosbags generates code; those of a camera, a
    # pose or a transform have none.
    array_elements: int = 64
    depth: int = 32  # of brackets; settings and calibrations need four
    indent: int = 128  # spaces in front of a line, each of which may be a level in YAML
    dots: int = 100  # per line: a 4×4 matrix has 16
    merges: int = 8  # `<<` of YAML, each of which may double the content
    values: int = 100_000  # including each repetition by an alias


LIMITS = Limits()
Decoder = Callable[[bytes], Any]
INT64 = 2**63  # whole numbers are smaller: sizes, stamps in nanoseconds
# Compiled when a text is first parsed, which takes a millisecond and few runs need.
_STEP = r"(?P<opens>[\[{]|<\w)|[\]}]|</|/>"
_DEEP_LINE = rf"(?m)^(?: {{{LIMITS.indent}}}|\t{{{LIMITS.depth}}}|[ \t]*(?:[-?] +){{{LIMITS.depth}}})[ \t]*\S"
_DOTTED_LINE = rf"(?m)^(?:[^.\n]*\.){{{LIMITS.dots}}}"


def open_regular(path: str | Path, buffering: int = -1) -> IO[bytes]:
    """Open a file for reading. Raises OSError if that fails or the file is not a regular one; `strerror` says why.

    A pipe or a device might never end, or never begin; besides, a log is read more than once.
    """
    try:
        _check_regular(os.stat(path).st_mode)
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # it may have become a pipe since
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


def reading(what: object) -> AbstractContextManager[None]:
    """Within the context, an OSError becomes a LogError that names what is read."""
    return as_error(LogError, f"cannot read {what}", OSError)


def read_small(path: str | Path, max_bytes: int) -> bytes:
    """Return the content of a file of at most `max_bytes`. Raises OSError as `open_regular`, or if it is larger."""
    with open_regular(path) as stream:
        content = stream.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise OSError(EFBIG, f"it is larger than {max_bytes} bytes: is it another file?")
    return content


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML. Raises ValueError or RecursionError if it is invalid, or beyond what a person would write."""
    import tomllib

    check_text(text)
    data = tomllib.loads(text)
    check_values(data)
    return data


def check_text(text: str) -> None:
    """Raise ValueError if a text in TOML, YAML, JSON or XML is nested too deeply for a parser that recurses."""
    depth = 0
    for step in re.finditer(_STEP, text):
        depth += 1 if step["opens"] else -1
        if depth > LIMITS.depth:
            raise ValueError(f"its brackets are nested more than {LIMITS.depth} deep")
    if re.search(_DEEP_LINE, text):
        raise ValueError("a line is indented or nested too deeply")
    if re.search(_DOTTED_LINE, text):
        raise ValueError(f"a line holds {LIMITS.dots} dots or more")
    if text.count("<<") > LIMITS.merges:
        raise ValueError(f"it merges mappings (<<) more than {LIMITS.merges} times")


def check_values(data: Any) -> None:
    """Raise ValueError if parsed content holds too many values, or a whole number beyond 64 bits."""
    todo, count = [data], 0
    while todo:
        value = todo.pop()
        count += 1
        if count > LIMITS.values:
            raise ValueError(f"it holds more than {LIMITS.values} values")
        if isinstance(value, dict):
            todo += value.values()
        elif isinstance(value, list | tuple):
            todo += value
        elif isinstance(value, int) and not -INT64 <= value < INT64:
            raise ValueError("it holds a whole number beyond 64 bits")


def bounded(decoder: Decoder) -> Decoder:
    """Wrap a decoder of a definition with repeated fields, so that it raises ValueError for messages over the bound.

    Each element of a byte or two becomes an object of about a hundred bytes. The pixels of an image are one field.
    """

    def decode(data: bytes) -> Any:
        if len(data) > LIMITS.small_bytes:
            raise ValueError(f"its definition has repeated fields, and it exceeds {LIMITS.small_bytes // 2**20} MiB")
        return decoder(data)

    return decode
