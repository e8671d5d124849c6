"""One row per frame: what `trajectory.csv` holds, and the table of `read_results`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files import PartFile
from ..geometry import se3
from ..geometry.se3 import Array
from ..types import Frame, FrameEstimate

Table = dict[str, NDArray[Any]]


def frame_table(
    frame_indices: Sequence[int],
    stamps_ns: Sequence[int],
    poses: tuple[Array, Array],
    statuses: Sequence[str],
    counts: Sequence[dict[str, int]],
    nis_per_dof: Sequence[float],
) -> Table:
    """The columns of n frames, from `poses`: world_from_cam (n, 4, 4) and cov_pose (n, 6, 6).

    σ of position and rotation are along and about the axes of the world, radians; NaN where there is none.
    """
    world_from_cam, cov_pose = poses
    turned = world_from_cam[:, :3, :3]
    sigmas = [_sigmas(turned, cov_pose[:, half, half]) for half in (slice(0, 3), slice(3, 6))]
    quats = se3.quat_xyzw_from_matrix(turned)
    table: Table = {
        "frame_index": np.asarray(frame_indices, dtype=np.int64),
        "stamp_ns": np.asarray(stamps_ns, dtype=np.int64),
    }
    table |= {f"{axis}_m": world_from_cam[:, i, 3] for i, axis in enumerate("xyz")}
    table |= {f"q{axis}": quats[:, i] for i, axis in enumerate("xyzw")}
    table |= {f"sigma_{axis}_m": sigmas[0][:, i] for i, axis in enumerate("xyz")}
    table |= {f"sigma_r{axis}_rad": sigmas[1][:, i] for i, axis in enumerate("xyz")}
    table["sigma_m"] = np.sqrt((sigmas[0] ** 2).sum(axis=1))
    table["status"] = np.array(statuses, dtype=str)
    for name in ("tracked", "new", "used", "rejected"):
        table[f"points_{name}"] = np.array([of.get(name, 0) for of in counts], dtype=np.int64)
    table["nis_per_dof"] = np.array(nis_per_dof, dtype=float)
    return table


def nis_per_dof(nis: float, dof: int) -> float:
    """The innovation per degree of freedom; NaN without views."""
    return nis / dof if dof else float("nan")


class CsvWriter:
    """Writes `trajectory.csv`: a line of names, then one line per frame."""

    def __init__(self, path: str | Path) -> None:
        self._file = PartFile(path)
        self._began = False

    def write(self, estimate: FrameEstimate, frame: Frame | None = None) -> None:
        """Append one line."""
        table = frame_table(
            [estimate.frame_index],
            [estimate.stamp_ns],
            (estimate.world_from_cam[None], estimate.cov_pose[None]),
            [str(estimate.status)],
            [estimate.counts],
            [nis_per_dof(estimate.nis, estimate.nis_dof)],
        )
        if not self._began:
            self._began = True
            self._file.write((",".join(table) + "\n").encode())
        self._file.write((",".join(map(_text, table.values())) + "\n").encode())
        self._file.flush()

    def close(self) -> None:
        """Move the file into place."""
        self._file.close()


def _text(column: NDArray[Any]) -> str:
    value = column[0]
    return f"{value:.12g}" if isinstance(value, np.floating) else str(value)


def _sigmas(turned: Array, cov: Array) -> Array:
    """σ (n, 3) along the world's axes of covariances (n, 3, 3) in axes that are `turned` (n, 3, 3) in the world."""
    known = np.isfinite(cov).all(axis=(1, 2))
    variances = np.full((len(cov), 3), np.nan)
    variances[known] = np.einsum("nij,njk,nik->ni", turned[known], cov[known], turned[known])
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))
