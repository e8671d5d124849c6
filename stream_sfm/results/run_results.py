"""`read_results` returns everything that a run has written, as NumPy arrays."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Config, read_config
from ..errors import ConfigError, InputError, LogError, as_error
from ..geometry import Array, se3
from ..types import FrameEstimate, Trajectory
from .estimates_reader import read_clouds, read_estimates
from .frames import RosFrames
from .trajectory_files import Table, frame_table

_ESTIMATES = ("estimates.mcap", "estimates.mcap.part")  # the second is that of a killed run


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PointTable:
    """Points with their covariances, in one array per quantity.

    `frame_indices` (m,): the frame of each point; `track_ids` (m,); `points` (m, 3), metres; `cov_points` (m, 3,
    3), metres². The last two are float32, as stored.
    """

    frame_indices: NDArray[np.int64]
    track_ids: NDArray[np.int64]
    points: NDArray[np.float32]
    cov_points: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.track_ids)

    def __repr__(self) -> str:
        return f"<PointTable {len(self)} points in {len(np.unique(self.frame_indices))} frames>"


class RunResults:
    """The results in the folder of a run; points are read on first use.

    - `stamps_ns` (n,), `world_from_cam` (n, 4, 4), `cov_pose` (n, 6, 6): the left camera in the world, metres and
      radians; `trajectory` is the same in one.
    - `statuses` (n,) and `reasons` (n,): text.
    - `table`: a column per quantity, a row per frame, as in `trajectory.csv`.
    - `config`, and `summary`: the content of summary.json, empty if the run did not end.
    - `warnings`: what could not be read from a damaged file or the file of a killed run; empty if nothing is
      missing. All intact frames and points are read.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.warnings: list[str] = []
        self.estimates_path = _estimates_of(self.folder)
        records = list(read_estimates(self.estimates_path, self.warnings))
        if self.warnings and not records:
            raise LogError(f"no frame can be read: {'; '.join(self.warnings)}")
        self.stamps_ns = np.array([r.stamp_ns for r in records], dtype=np.int64)
        self.world_from_cam: Array = np.array([r.world_from_cam for r in records]).reshape(-1, 4, 4)
        self.cov_pose: Array = np.array([r.cov_pose for r in records]).reshape(-1, 6, 6)
        self.statuses = np.array([str(r.status) for r in records], dtype=str)
        self.reasons = np.array([r.reason for r in records], dtype=str)
        self.table: Table = frame_table(records)
        config, summary = self.folder / "config.toml", self.folder / "summary.json"
        self.config = read_config(config) if config.is_file() else Config()
        self.summary: dict[str, Any] = _summary(summary) if summary.is_file() else {}

    @property
    def trajectory(self) -> Trajectory:
        """Stamps, poses and covariances."""
        return Trajectory(self.stamps_ns, self.world_from_cam, self.cov_pose)

    @cached_property
    def points(self) -> PointTable:
        """The points in view in each frame (CC), in axes of the camera at that frame. Raises LogError."""
        return self._points("/stream_sfm/points")

    @cached_property
    def map_points(self) -> PointTable:
        """Each point once (WC), in the world, with the frame in which it left the view. Raises LogError."""
        found = self._points("/stream_sfm/map")
        world_from_fixed = se3.inverse(RosFrames(self.config.ros).fixed_from_world)
        turned = world_from_fixed[:3, :3].astype(np.float32)
        return PointTable(
            found.frame_indices,
            found.track_ids,
            se3.transform(world_from_fixed, found.points).astype(np.float32),
            (turned @ found.cov_points @ turned.T).astype(np.float32),
        )

    def estimates(self) -> Iterator[FrameEstimate]:
        """Yield the estimates as in live use, without points."""
        yield from read_estimates(self.estimates_path, [])

    def to_pandas(self) -> Any:
        """Return the table as a pandas DataFrame, indexed by time. Raises ConfigError without pandas."""
        try:
            import pandas as pd
        except ImportError:
            raise ConfigError("a DataFrame needs pandas: pip install pandas, or use `table`") from None
        frame = pd.DataFrame(self.table)
        frame.index = pd.to_datetime(frame["stamp_ns"].to_numpy(), unit="ns")
        frame.index.name = "time"
        return frame

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __repr__(self) -> str:
        return f"<RunResults of {self.folder}, {len(self)} frames>"

    def _points(self, topic: str) -> PointTable:
        clouds = list(read_clouds(self.estimates_path, topic, self.warnings))
        frames = [np.full(len(c.track_ids), c.frame_index, np.int64) for c in clouds]
        return PointTable(
            np.concatenate([np.empty(0, np.int64), *frames]),
            np.concatenate([np.empty(0, np.int64), *(c.track_ids for c in clouds)]),
            np.concatenate([np.empty((0, 3), np.float32), *(c.points for c in clouds)]),
            np.concatenate([np.empty((0, 3, 3), np.float32), *(c.cov_points for c in clouds)]),
        )


def read_results(folder: str | Path) -> RunResults:
    """Read the folder of a run: of `replay`, of a log of `batch`, or of one method of `compare`.

    The results of a killed run or a damaged file contain everything intact, and their `warnings` say what is
    missing. Raises InputError if there are no results, LogError if no frame can be read.
    """
    return RunResults(folder)


def is_run(folder: Path) -> bool:
    """Whether a folder holds the results of a run."""
    return any((folder / name).is_file() for name in _ESTIMATES)


def _estimates_of(folder: Path) -> Path:
    for name in _ESTIMATES:
        if (folder / name).is_file():
            return folder / name
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: give the one that a run has written, such as runs/latest")
    inside = sorted(path.parent.name for path in folder.glob("*/estimates.mcap"))
    hint = f"; it holds the results {', '.join(inside)}: give one of these" if inside else ""
    raise InputError(f"{folder} holds no results (estimates.mcap){hint}")


def _summary(path: Path) -> dict[str, Any]:
    with as_error(InputError, f"cannot read {path}", OSError, ValueError):
        content = json.loads(path.read_bytes())
    if not isinstance(content, dict):
        raise InputError(f"{path} is not the summary of a run")
    return content
