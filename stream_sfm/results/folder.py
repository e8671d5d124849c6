"""The folder that a replay writes its results to, and a comparison those of each method."""

import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..camera.rig import MonoRig, StereoRig
from ..config import Config, config_to_toml
from ..errors import OutputError
from ..files import json_bytes, write_whole
from ..types import Frame, FrameEstimate, Sink
from .estimates_writer import EstimatesWriter
from .trajectory_files import KittiWriter, TumWriter

UNIT_WITHOUT_SCALE = "unscaled: the distance between the first two views that show depths (one camera)"


class ResultFolder:
    """A sink that writes estimates.mcap, trajectory.tum, trajectory.kitti and config.toml, and at last summary.json.

    The folder and its files are made with the first estimate, so that a log that cannot be used leaves no folder
    behind. Raises OutputError naming the file.
    """

    def __init__(self, path: str | Path, rig: StereoRig | MonoRig, config: Config) -> None:
        self.path = Path(path)
        self._rig, self._config = rig, config
        self._files: list[Sink] = []

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Append one frame to each file."""
        if not self._files:
            self._open()
        for file in self._files:
            file.write(estimate, frame)

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write summary.json, if there was an estimate."""
        if self._files:
            write_whole(self.path / "summary.json", json_bytes(summary))

    def close(self) -> None:
        """Finish all files and give them their names; the first failure is raised after all have been tried."""
        close_all(self._files)

    def _open(self) -> None:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot make the folder {self.path}: {error.strerror}") from None
        write_whole(self.path / "config.toml", config_to_toml(self._config).encode())
        self._files.append(EstimatesWriter(self.path / "estimates.mcap", self._rig, self._config))
        self._files.append(TumWriter(self.path / "trajectory.tum", UNIT_WITHOUT_SCALE if self._config.mono else ""))
        self._files.append(KittiWriter(self.path / "trajectory.kitti"))


def close_all(sinks: Iterable[Sink]) -> None:
    """Close every sink, even after one has failed; the first failure is raised in the end."""
    failures: list[Exception] = []
    for sink in sinks:
        try:
            sink.close()
        except Exception as error:
            failures.append(error)
    if failures:
        raise failures[0]


def new_run_folder(log_path: str | Path, root: str | Path = "runs") -> Path:
    """Return a name that is not in use, `<root>/<log>-<local time>`; the folder is not made."""
    root, stem = Path(root), Path(log_path).stem or "log"
    name = f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}"
    folder, number = root / name, 1
    while folder.exists():
        number += 1
        folder = root / f"{name}-{number}"
    return folder


def point_latest_to(folder: Path) -> None:
    """Let the link `latest`, beside the folder, point to it, if the system has symbolic links."""
    link = folder.parent / "latest"
    with suppress(OSError):
        if link.is_symlink():
            link.unlink()
        link.symlink_to(folder.name, target_is_directory=True)
