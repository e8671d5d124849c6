"""Where a run may write: never over its inputs, and only into a folder that no other run writes to."""

import fcntl
import os
import stat
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import OutputError, as_error

# The files of a result folder. Each is first written as `<name>.part`.
RESULTS = (
    "estimates.mcap", "trajectory.tum", "trajectory.kitti", "trajectory.csv", "summary.json", "config.toml",
    "metadata.yaml",
)  # fmt: skip
MAP_TRAJECTORY = "trajectory_map.tum"  # of a replay with loops
GRAVITY_TRAJECTORY = "trajectory_gravity.tum"  # of a replay with an upright world
TRAJECTORIES = (MAP_TRAJECTORY, GRAVITY_TRAJECTORY)
_FileId = tuple[int, int]  # device and inode: equal for all names and links of a file


def refuse_existing(output: str | Path, overwrite: bool) -> None:
    """Raise an OutputError if something has this name and must not be replaced."""
    if os.path.lexists(output) and not overwrite:
        problem = f"{output} exists already: choose another name, or allow it to be replaced"
        raise OutputError(problem, hint=("overwrite",))


def refuse_overwriting(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise an OutputError if an output, or the temporary file it is written to, is an input or another output.

    Files are compared by inode, so that links do not matter. In an input folder, every file in it and below counts,
    except in folders of results. An existing output must be a regular file, since anything else would not be
    replaced but written to.
    """
    outputs = list(outputs)
    for path in outputs:
        if "\0" in str(path):
            raise OutputError(f"cannot write {str(path)!r}: its name holds a NUL character")
    parts = [path.with_name(path.name + ".part") for path in outputs]
    places = Counter(os.path.realpath(path) for path in (*outputs, *parts))
    for path in outputs:
        if places[os.path.realpath(path)] > 1:
            raise OutputError(f"cannot write {path}: two results of this run would be this file; rename one")
    existing = [(path, found) for path in (*outputs, *parts) if (found := _stat(path))]
    for path, found in existing:
        if not stat.S_ISREG(found.st_mode):
            kind = "a folder" if stat.S_ISDIR(found.st_mode) else "a device, pipe or socket"
            raise OutputError(f"cannot write {path}: it is {kind}; choose another name")
    if not existing:
        return
    known = {file: given for given in inputs for file in _files(given)}
    for path, found in existing:
        if (given := known.get((found.st_dev, found.st_ino))) is not None:
            problem = f"cannot write {path}: it is an input of this run, {given}"
            raise OutputError(f"{problem}; write somewhere else, nothing was changed")


def _stat(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except (OSError, ValueError):  # it does not exist; anything else is found when it is opened
        return None


def _files(given: Path) -> Iterator[_FileId]:
    """Return the files that an input stands for."""
    found = _stat(given)
    if found is None:
        return
    if not stat.S_ISDIR(found.st_mode):
        yield found.st_dev, found.st_ino
        return
    for folder, folders, names in os.walk(given):
        if Path(folder) != given and "summary.json" in names:  # results of an earlier run, which a new one replaces
            folders.clear()
            continue
        for name in names:
            if (file := _stat(Path(folder, name))) is not None:
                yield file.st_dev, file.st_ino


@contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Be the only run that writes to an existing folder. Raises OutputError if another run is writing there.

    The system releases the lock when the process ends, however it ends. A file system without locks (some
    network shares) gives no protection.
    """
    with as_error(OutputError, f"cannot write to {folder}", OSError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        if not try_lock(descriptor):
            cure = "wait for its end or choose another folder"
            raise OutputError(f"cannot write to {folder}: another run is writing there; {cure}")
        yield
    finally:
        os.close(descriptor)


def try_lock(descriptor: int) -> bool:
    """Lock an open file or folder; False if another one holds the lock."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # or a file system without locks
        return not isinstance(error, BlockingIOError)
    return True
