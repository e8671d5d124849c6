"""Finds the logs for files, folders and patterns, and gives each a name and its ground truth."""

import glob
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import dropwhile
from pathlib import Path

from ..errors import ConfigError, LogError
from ..logs.sources.recognise import is_recording, supported

_TRUTHS = (".txt", ".tum", ".csv")
_RESULT = "estimates.mcap"  # written by a replay: a log, but not a stereo log


def find_logs(arguments: Sequence[str], skipped: list[str] | None = None) -> dict[Path, int]:
    """Return absolute paths in the given order, each once, with the number of path parts that make its name.

    A folder that is a recording (a bag, a data set) is one log. Any other folder stands for all recordings in it and
    below, except hidden ones and results (estimates.mcap); they are named relative to that folder, so that a name
    stays the same when the folder grows. `skipped` gets a line for each linked folder, which is not followed. A
    pattern that no shell has expanded is expanded here, `**` for any depth; it does not follow links either. Raises
    LogError if a folder holds no log; a missing file is kept, and reported in its turn.
    """
    skipped = [] if skipped is None else skipped
    found: dict[Path, int] = {}
    for argument in arguments:
        matches = [argument] if os.path.exists(argument) else sorted(set(_matching(argument, skipped)))
        for path in (Path(os.path.abspath(match)) for match in matches or [argument]):
            if not os.path.isdir(path) or is_recording(path):
                found.setdefault(path, 1)
                continue
            below = list(_logs_below(path, skipped))
            if not below:
                raise LogError(f"the folder {path} holds no log ({supported()})")
            for log in below:
                found.setdefault(log, len(log.relative_to(path).parts))
    return found


def _matching(pattern: str, skipped: list[str]) -> Iterator[str]:
    """Yield the paths that a pattern stands for.

    Below `**`, links to folders are not followed: they may lead back, so that paths would be endless.
    """
    parts = Path(pattern).parts
    if "**" not in parts:
        yield from glob.glob(pattern)
        return
    at = parts.index("**")
    tail = list(dropwhile("**".__eq__, parts[at:]))
    for start in glob.glob(os.path.join(*parts[:at])) if at else [os.curdir]:
        if not tail:  # a folder stands for everything below it
            yield start
            continue
        for folder, folders, _ in os.walk(start):
            folders[:] = [name for name in folders if not name.startswith(".")]
            for match in _matching(os.path.join(glob.escape(folder), *tail), skipped):
                below = [Path(match), *Path(match).parents][: -len(Path(start).parents) - 1]
                link = next((path for path in below if path.is_symlink() and path.is_dir()), None)
                if link is None:
                    yield match
                elif (note := _not_followed(link)) not in skipped:
                    skipped.append(note)


def _not_followed(link: str | Path) -> str:
    return f"{link} is a link to a folder, which is not followed: name the folder itself"


def _logs_below(folder: Path, skipped: list[str]) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.name == _RESULT:
            continue
        if path.is_dir():
            if path.is_symlink():
                skipped.append(_not_followed(path))
            elif is_recording(path):
                yield path
            else:
                yield from _logs_below(path, skipped)
        elif path.is_file() and is_recording(path):
            yield path


def size_bytes(log: Path) -> int:
    """Return the size of a recording on disk, with all files of a folder; 0 if it is not known."""
    if not os.path.isdir(log):
        return os.path.getsize(log) if os.path.isfile(log) else 0
    return sum(os.path.getsize(file) for file in log.rglob("*") if os.path.isfile(file))


def names_for(logs: Mapping[Path, int], reserved: Sequence[str] = ()) -> dict[Path, str]:
    """Return a unique name for each log: its file name without the suffix, after as many parent folders as needed.

    `logs` as `find_logs` returns them. Each name is plain: no leading dots, so that it cannot be `..` and is not
    hidden, and no control characters. Upper and lower case count as equal; names that are still equal get a number.
    """
    depths = dict(logs)
    while True:
        names = {log: _plain("-".join((*log.parts[-depth:-1], log.stem))) for log, depth in depths.items()}
        counts = Counter(name.casefold() for name in names.values())
        clashing = [log for log in logs if counts[names[log].casefold()] > 1 and depths[log] < len(log.parts) - 1]
        if not clashing:
            break
        for log in clashing:
            depths[log] += 1
    taken = {name.casefold() for name in reserved}
    return {log: _unused(name, taken) for log, name in names.items()}


def _plain(name: str) -> str:
    return "".join(c if c.isprintable() else "_" for c in name).lstrip(".") or "log"


def _unused(name: str, taken: set[str]) -> str:
    candidate, number = name, 1
    while candidate.casefold() in taken:
        number += 1
        candidate = f"{name}-{number}"
    taken.add(candidate.casefold())
    return candidate


def truth_files(given: Path, names: Mapping[Path, str]) -> dict[Path, Path]:
    """Return the file for each log; `names`: of the logs in the batch. Logs without one keep their own ground truth.

    Raises ConfigError if it does not exist, or if a folder has a file for none of the logs.
    """
    if not given.is_dir():
        if not given.is_file():
            raise ConfigError(f"ground truth {given}: the file or folder does not exist")
        return dict.fromkeys(names, given)
    files = {path.stem: path for path in sorted(given.iterdir()) if path.suffix.lower() in _TRUTHS}
    found = {log: files[key] for log, name in names.items() for key in (log.stem, name) if key in files}
    if not found:
        listed = ", ".join(path.name for path in files.values()) or "no .txt, .tum or .csv"
        wanted = next((f"{name}.txt" for name in names.values()), "LOG.txt")
        raise ConfigError(f"ground truth {given}: no file is named after a log, such as {wanted}; it holds {listed}")
    return found
