"""The ground truth of each log of a batch: one file for all, or the file in a folder that is named after the log."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from ..errors import ConfigError

_SUFFIXES = (".txt", ".tum", ".csv")


def truth_files(given: Path, names: Mapping[Path, str]) -> dict[Path, Path]:
    """The file for each log; `names`: of the logs, as in the batch. Logs without one keep their own ground truth.

    Raises ConfigError where it does not exist, or where a folder has a file for none of the logs.
    """
    if not given.is_dir():
        if not given.is_file():
            raise ConfigError(f"ground truth {given}: the file or folder does not exist")
        return dict.fromkeys(names, given)
    files = {path.stem: path for path in sorted(given.iterdir()) if path.suffix.lower() in _SUFFIXES}
    found = {log: files[key] for log, name in names.items() for key in _keys(log, name) if key in files}
    if not found:
        wanted = next((f"{name}.txt" for name in names.values()), "LOG.txt")
        raise ConfigError(
            f"ground truth {given}: no file is named after a log, such as {wanted}; it holds {_listed(files)}"
        )
    return found


def _keys(log: Path, name: str) -> Iterable[str]:
    """Names that a file may have, the best one last."""
    return log.stem, name


def _listed(files: Mapping[str, Path]) -> str:
    names = [path.name for path in files.values()]
    return ", ".join(names[:3]) + (" …" if len(names) > 3 else "") if names else "no .txt, .tum or .csv"
