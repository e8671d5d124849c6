"""The folder of the results of a run, or of one method of a comparison."""

import json
import os
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from ..camera.rig import MonoRig, StereoRig
from ..config import Config, config_to_toml
from ..errors import OutputError
from ..geometry import Array
from ..system.files import PartFile, json_bytes, make_folder, write_whole
from ..system.outputs import RESULTS, TRAJECTORIES, only_writer
from ..types import Frame, FrameEstimate, Sink, Trajectory
from .estimates_writer import EstimatesWriter
from .trajectory_files import NAMES, first_lines, lines_of, tum_line

UNIT_WITHOUT_SCALE = "unscaled: the distance between the first two views that show depths (one camera)"


class ResultFolder:
    """A sink that writes estimates.mcap with metadata.yaml, trajectories, config.toml, and finally summary.json.

    The folder and its files are created with the first estimate, so that an unusable log leaves no folder. Only
    one run may write to a folder at a time. A `with` statement completes the files however it ends. Raises OutputError
    naming the file or the folder.
    """

    def __init__(self, path: str | Path, rig: StereoRig | MonoRig, config: Config) -> None:
        self.path = Path(path)
        self._rig, self._config = rig, config
        # Pose of the world of the estimates in a map of places.
        self.map_from_world: Callable[[], Array] | None = None
        self._estimates: EstimatesWriter | None = None
        self._trajectories: list[PartFile] = []
        self._lock = ExitStack()  # holds the lock of the folder while it is written to
        self._closed = False

    def __enter__(self) -> "ResultFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, estimate: FrameEstimate, frame: Frame | None = None) -> None:
        """Append one frame to each file; its images are not needed."""
        if not isinstance(estimate, FrameEstimate):
            kind = type(estimate).__name__
            raise OutputError(f"{self.path}: an estimate of type {kind} cannot be written; give write(estimate, frame)")
        if self._closed:
            raise OutputError(f"{self.path} is closed; write to a new ResultFolder of another path")
        if self._estimates is None:
            self._estimates = self._open()
        self._estimates.write(estimate, frame)
        for file, line in zip(self._trajectories, lines_of(estimate), strict=True):
            file.write(line.encode())
            file.flush()

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write summary.json, if there was an estimate."""
        self._write("summary.json", json_bytes(summary))

    def write_trajectory(self, name: str, trajectory: Trajectory) -> None:
        """Write one of `outputs.TRAJECTORIES`: the poses in another world, known at the end of a run."""
        lines = map(tum_line, trajectory.stamps_ns.tolist(), trajectory.world_from_cam)
        self._write(name, "".join(lines).encode())

    def _write(self, name: str, content: bytes) -> None:
        if self._estimates is not None:
            with only_writer(self.path):
                write_whole(self.path / name, content)

    def close(self) -> None:
        """Finish all files and give them their names; the first failure is raised after all have been tried."""
        self._closed = self._estimates is not None  # if nothing was written, nothing is closed
        try:
            close_all([*filter(None, [self._estimates]), *self._trajectories])
            path = self.path / "metadata.yaml"  # makes the folder a bag, unless it already is another bag
            if self._estimates is not None and _may_be_written(path):
                write_whole(path, self._estimates.metadata())
        finally:
            self._lock.close()

    def _open(self) -> EstimatesWriter:
        make_folder(self.path)
        self._lock.enter_context(only_writer(self.path))
        for name in TRAJECTORIES:
            (self.path / name).unlink(missing_ok=True)  # from an earlier run; this one may not write it
        if self.path / "config.toml" in changed_results(self.path, self._config):
            write_whole(self.path / "config.toml", config_to_toml(self._config).encode())
        for name, text in zip(NAMES, first_lines(UNIT_WITHOUT_SCALE if self._config.mono else ""), strict=True):
            # One by one, so that the open ones are closed if the next one fails.
            self._trajectories.append(PartFile(self.path / name))
            self._trajectories[-1].write(text.encode())
        return EstimatesWriter(self.path / "estimates.mcap", self._rig, self._config, self.map_from_world)


def changed_results(folder: Path, config: Config) -> list[Path]:
    """Return the files that a run changes: all but a config.toml that already holds just this configuration.

    That may be the file with which the run was configured, as when a run is repeated.
    """
    files = [folder / name for name in RESULTS]
    with suppress(OSError):
        known = folder / "config.toml"
        if known.is_file() and known.read_bytes() == config_to_toml(config).encode():
            files.remove(known)
    return files


def _may_be_written(metadata: Path) -> bool:
    """Whether this file is missing or from an earlier run; the metadata of another bag must not be replaced."""
    try:
        content = json.loads(metadata.read_bytes())
        return bool(content["rosbag2_bagfile_information"]["relative_file_paths"] == ["estimates.mcap"])
    except FileNotFoundError:
        return True
    except (OSError, ValueError, KeyError, TypeError):
        return False


def close_all(sinks: Iterable[Sink | PartFile]) -> None:
    """Close every sink or file, even after one has failed; the first failure is raised at the end."""
    failures: list[Exception] = []
    for sink in sinks:
        try:
            sink.close()
        except Exception as error:
            failures.append(error)
    if failures:
        raise failures[0]


def new_run_folder(log_path: str | Path, root: str | Path = "runs") -> Path:
    """Return an unused name, `<root>/<log>-<local time>`; the folder is not created."""
    most = 60  # characters, whose UTF-8 fits into the 255 bytes of file systems
    root, stem = Path(root), Path(log_path).stem[:most] or "log"
    name = f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}"
    folder, number = root / name, 1
    while os.path.exists(folder):
        number += 1
        folder = root / f"{name}-{number}"
    return folder


def point_latest_to(folder: Path) -> None:
    """Point the link `latest` beside the folder to it, if the system has symbolic links."""
    link = folder.parent / "latest"
    with suppress(OSError):
        if link.is_symlink():
            link.unlink()
        link.symlink_to(folder.name, target_is_directory=True)
