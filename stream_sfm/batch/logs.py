"""Which logs the user means by files, folders and patterns, and a name for each."""

import glob
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from ..errors import LogError

_OURS = "estimates.mcap"  # what a replay writes: a log, but not a stereo log


def find_logs(arguments: Sequence[str]) -> dict[Path, int]:
    """Absolute paths in the order given, each once, and how many parts of the path make its name.

    A folder stands for all *.mcap files in it and below, apart from hidden ones and results (estimates.mcap); they
    are named from that folder on, so that a name stays the same when the folder grows. A pattern that no shell has
    expanded is expanded here, `**` for any depth. Raises LogError where a folder holds no log; a file that is not
    there is kept, and reported when its turn comes.
    """
    found: dict[Path, int] = {}
    for argument in arguments:
        matches = [argument] if Path(argument).exists() else sorted(glob.glob(argument, recursive=True))
        for path in (Path(os.path.abspath(match)) for match in matches or [argument]):
            if not path.is_dir():
                found.setdefault(path, 1)
                continue
            below = list(_below(path))
            if not below:
                raise LogError(f"the folder {path} holds no log (*.mcap)")
            for log in below:
                found.setdefault(log, len(log.relative_to(path).parts))
    return found


def _below(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.rglob("*.mcap")):
        hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
        if not hidden and path.name != _OURS and path.is_file():
            yield path


def names_for(logs: Mapping[Path, int], reserved: Sequence[str] = ()) -> dict[Path, str]:
    """A name a log, from `find_logs`: its file name without the suffix, after so many parent folders as tell it
    from the others.

    Upper and lower case count as the same, as for some file systems; what is still the same gets a number.
    """
    depths = dict(logs)
    while True:
        names = {log: "-".join((*log.parts[-depth:-1], log.stem)) for log, depth in depths.items()}
        counts = Counter(name.casefold() for name in names.values())
        clashing = [log for log in logs if counts[names[log].casefold()] > 1 and depths[log] < len(log.parts) - 1]
        if not clashing:
            break
        for log in clashing:
            depths[log] += 1
    taken = {name.casefold() for name in reserved}
    return {log: _free(name, taken) for log, name in names.items()}


def _free(name: str, taken: set[str]) -> str:
    candidate, number = name, 1
    while candidate.casefold() in taken:
        number += 1
        candidate = f"{name}-{number}"
    taken.add(candidate.casefold())
    return candidate
