"""Read the results of a replay: arrays, and a table for pandas.

stream-sfm replay logs/room.mcap
python examples/read_results.py runs/latest
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import stream_sfm as sfm


def speeds_m_s(trajectory: sfm.Trajectory) -> NDArray[np.float64]:
    """The speed (n - 1,) between consecutive frames."""
    steps_m = np.linalg.norm(np.diff(trajectory.world_from_cam[:, :3, 3], axis=0), axis=1)
    return np.asarray(steps_m / (np.diff(trajectory.stamps_ns) / 1e9))


def rows(path: Path) -> list[dict[str, float | str]]:
    """One row per frame, as `pandas.DataFrame` takes them: stamp, position, its σ, status, number of points."""
    found: list[dict[str, float | str]] = []
    for record in sfm.read_estimates(path):
        position_m = np.array(record.world_from_cam, dtype=float)[:3, 3]
        cov_position = np.array(record.cov_pose, dtype=float)[:3, :3]
        found.append(
            {
                "stamp_ns": record.stamp_ns,
                **dict(zip(("x_m", "y_m", "z_m"), position_m.tolist(), strict=True)),
                "sigma_m": float(np.sqrt(np.trace(cov_position))),
                "status": record.status,
                "points": record.counts["used"],
            }
        )
    return found


def main() -> None:
    """Print what the results hold."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="a folder that `stream-sfm replay` has written")
    estimates = parser.parse_args().folder / "estimates.mcap"

    trajectory = sfm.read_trajectory(estimates)
    print(f"{len(trajectory)} poses, at most {speeds_m_s(trajectory).max():.2f} m/s")

    clouds = list(sfm.read_clouds(estimates, "/stream_sfm/points"))
    seen = np.unique(np.concatenate([cloud.track_ids for cloud in clouds]))
    print(f"{len(seen)} points, {len(clouds[-1].track_ids)} of them in view in the last frame")

    try:
        import pandas as pd
    except ImportError:
        print("pip install pandas for the table")
        return
    table = pd.DataFrame(rows(estimates))
    table.index = pd.to_datetime(table.pop("stamp_ns"))
    print(table.tail(3).to_string(float_format="%.4f"))


if __name__ == "__main__":
    main()
