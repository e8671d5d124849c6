"""Reads `estimates.mcap` back, whole or as a killed run left it (`estimates.mcap.part`)."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from numpy.typing import NDArray

from ..errors import LogError
from ..mcap_file.damage import Damage
from ..mcap_file.log_file import LogFile
from ..types import Trajectory
from .estimates_writer import POINT_DTYPE
from .schema import SCHEMA_VERSION, EstimateRecord


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Cloud:
    """The points of one message: `track_ids` (n,), `points` (n, 3) m, `cov_points` (n, 3, 3) m², float32 as stored."""

    stamp_ns: int
    frame_id: str
    track_ids: NDArray[np.int64]
    points: NDArray[np.float32]
    cov_points: NDArray[np.float32]

    def __repr__(self) -> str:
        return f"<Cloud at {self.stamp_ns} ns in {self.frame_id}, {len(self.points)} points>"


def read_estimates(path: str | Path) -> Iterator[EstimateRecord]:
    """Yield the records in order; a file that is cut off gives those of all whole chunks. Raises LogError."""
    for message in LogFile(path).messages(Damage(), frozenset(["/stream_sfm/estimate"])):
        try:
            record = msgspec.json.decode(message.data, type=EstimateRecord)
        except msgspec.DecodeError as error:
            raise LogError(f"{path}: a message of /stream_sfm/estimate cannot be read: {error}") from None
        if record.schema_version > SCHEMA_VERSION:
            raise LogError(f"{path} was written by a newer stream_sfm (estimate schema {record.schema_version})")
        yield record


def read_trajectory(path: str | Path) -> Trajectory:
    """Read stamps, poses and covariances of all frames, exact to the last bit. Raises LogError."""
    stamps, poses, covs = [], [], []
    for record in read_estimates(path):
        stamps.append(record.stamp_ns)
        poses.append(np.array(record.world_from_cam, dtype=float))  # null becomes NaN
        covs.append(np.array(record.cov_pose, dtype=float))
    return Trajectory(
        np.array(stamps, dtype=np.int64), np.array(poses).reshape(-1, 4, 4), np.array(covs).reshape(-1, 6, 6)
    )


def read_clouds(path: str | Path, topic: str = "/stream_sfm/points") -> Iterator[Cloud]:
    """Yield the point clouds of one topic, in order. Raises LogError."""
    for message in LogFile(path).messages(Damage(), frozenset([topic])):
        cloud = PointCloud.FromString(message.data)
        rows = np.frombuffer(cloud.data, POINT_DTYPE)
        upper = np.stack([rows[name] for name in ("cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz")], -1)
        yield Cloud(
            cloud.timestamp.seconds * 10**9 + cloud.timestamp.nanos,
            cloud.frame_id,
            rows["track_id"].astype(np.int64),
            np.stack([rows["x"], rows["y"], rows["z"]], axis=-1),
            upper[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]],
        )
