"""Read the results of a replay: arrays, and a table for pandas.

stream-sfm replay logs/room.mcap
python examples/read_results.py runs/latest
"""

import argparse
import importlib.util
from pathlib import Path

import numpy as np

import stream_sfm as sfm


def main() -> None:
    """Print the content of the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="a folder that `stream-sfm replay` has written")
    run = sfm.read_results(parser.parse_args().folder)

    for warning in run.warnings:  # of a damaged file, or one that a killed run has left
        print(f"not everything could be read: {warning}")
    steps_m = np.linalg.norm(np.diff(run.world_from_cam[:, :3, 3], axis=0), axis=1)
    speeds_m_s = steps_m / (np.diff(run.stamps_ns) / 1e9)
    print(f"{len(run)} poses, at most {speeds_m_s.max():.2f} m/s")
    print(f"σ of the position at the end: {run.table['sigma_m'][-1] * 1e3:.2f} mm")

    now = run.points.frame_indices == run.table["frame_index"][-1]
    print(f"{len(np.unique(run.points.track_ids))} points, {now.sum()} of them in view in the last frame")

    if importlib.util.find_spec("pandas") is None:
        print("pip install pandas for the table")
        return
    shown = ["x_m", "y_m", "z_m", "sigma_m", "status", "points_used"]
    print(run.to_pandas()[shown].tail(3).to_string(float_format="%.4f"))


if __name__ == "__main__":
    main()
