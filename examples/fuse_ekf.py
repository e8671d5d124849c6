"""Fuse the motions of a run with positions from another sensor in an extended Kalman filter (filterpy).

    stream-sfm replay logs/room.mcap
    python examples/fuse_ekf.py runs/latest --positions fixes.tum --std 0.02

The state is the error of the pose, and the errors that all motions share: these are constant, but become better
known.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from filterpy.kalman import KalmanFilter

import stream_sfm as sfm

UNSEEN = 3  # of the common errors: no view shows them, so the odometry never learns them, but another sensor may
MOST_STD_ROTATION_RAD = 0.3  # beyond it, the filter's linear model of a position is off by 5 % of the way since
Fused = Callable[[sfm.RunResults, dict[int, np.ndarray], float], tuple[int, np.ndarray, np.ndarray]]


class Filter:
    """The pose (4, 4) of the newest frame in the first one, and its covariance (6, 6), translation first."""

    def __init__(self, m: int) -> None:
        self.pose, self._since = np.eye(4), 0
        self._filter = KalmanFilter(dim_x=6 + m, dim_z=3)
        self._filter.P = np.diag(np.r_[np.full(6, 1e-12), np.ones(m)])

    @property
    def cov(self) -> np.ndarray:
        """The covariance of the pose."""
        return np.asarray(self._filter.P[:6, :6])

    def move(self, motion: sfm.Motion) -> None:
        """Take a motion since the last one: truth = measured·Exp(J (c − mean) + own)."""
        f, m = self._filter, self._filter.dim_x - 6
        step, jacobian = motion.earlier_from_newest, np.zeros((6, m))
        if len(motion.mean):  # a predicted motion has nothing in common with others
            self._learn(motion)
            jacobian = motion.common_jacobian
            step = step @ sfm.se3_exp(jacobian @ (f.x[6:, 0] - motion.mean))
        f.F, f.Q = np.eye(6 + m), np.zeros((6 + m, 6 + m))
        f.F[:6, :6], f.F[:6, 6:] = sfm.se3_adjoint(sfm.se3_inverse(step)), jacobian
        f.Q[:6, :6] = motion.cov_own
        f.P = f.F @ f.P @ f.F.T + f.Q
        self.pose = self.pose @ step

    def _learn(self, motion: sfm.Motion) -> None:
        """Take the odometry's current estimate of the rig errors: poses that depend on them follow."""
        f, rig = self._filter, slice(6 + UNSEEN, None)
        mean, cov = motion.mean[UNSEEN:, None], motion.cov_common[UNSEEN:, UNSEEN:]
        if motion.common_since != self._since:  # a camera was knocked: of the new errors the path so far says nothing
            self._since = motion.common_since
            f.P[rig, :] = f.P[:, rig] = 0
            f.P[rig, rig], f.x[rig] = cov, mean
        if len(mean):
            gain = f.P[:, rig] @ np.linalg.pinv(f.P[rig, rig], hermitian=True)
            f.x = f.x + gain @ (mean - f.x[rig])
            f.P = f.P + gain @ (cov - f.P[rig, rig]) @ gain.T
            self._reset()

    def fix(self, position: np.ndarray, std_m: float) -> None:
        """Take a position (3,) of σ `std_m`.

        Raises ConfigError after a loss that no view bridges, where the rotation is unknown.
        """
        f = self._filter
        if np.linalg.eigvalsh(f.P[3:6, 3:6])[-1] > MOST_STD_ROTATION_RAD**2:
            raise sfm.ConfigError(
                "no view bridges a loss, so the rotation is unknown, and a filter cannot correct that: fuse the frames "
                "before and after the loss on their own, or use fuse_gtsam.py"
            )
        h = np.zeros((3, f.dim_x))
        h[:, :3] = self.pose[:3, :3]
        f.update((position - self.pose[:3, 3])[:, None], R=std_m**2 * np.eye(3), H=h)
        self._reset()

    def _reset(self) -> None:
        """Move the known error of the pose into the pose."""
        self.pose, self._filter.x[:6] = self.pose @ sfm.se3_exp(self._filter.x[:6, 0]), 0.0


def fused(run: sfm.RunResults, positions: dict[int, np.ndarray], std_m: float) -> tuple[int, np.ndarray, np.ndarray]:
    """Return the index of the last frame, its pose (4, 4) and covariance (6, 6), translation first, in the first frame.

    `positions` (3,) in the first frame by the stamp of the frame, each with σ `std_m`.
    """
    estimates = list(run.estimates())
    stamps_ns = {estimate.frame_index: estimate.stamp_ns for estimate in estimates}
    motions = sfm.chain(estimates, to=[index for index, stamp_ns in stamps_ns.items() if stamp_ns in positions])
    state, end = Filter(max((len(motion.mean) for motion in motions), default=0)), estimates[0].frame_index
    for motion in motions:
        state.move(motion)
        end = motion.newest if motion.newest is not None else end
        if (position := positions.get(stamps_ns[end])) is not None:
            state.fix(position, std_m)
    return end, state.pose, state.cov


def read_positions(path: Path | None) -> dict[int, np.ndarray]:
    """Read lines `seconds x y z …` as positions (3,) by their stamp in nanoseconds."""
    rows = [] if path is None else [line.split() for line in path.read_text().splitlines() if line[:1] != "#"]
    return {_ns(row[0]): np.array(row[1:4], float) for row in rows}


def _ns(seconds: str) -> int:
    """Return decimal seconds as nanoseconds, to the last digit."""
    whole, _, part = seconds.partition(".")
    return int(whole) * 10**9 + int(f"{part:0<9.9}")


def main(purpose: str, fused: Fused) -> None:
    """Print where the last frame is, by `fused`."""
    parser = argparse.ArgumentParser(description=purpose)
    parser.add_argument("folder", type=Path, help="a folder that `stream-sfm replay` has written")
    parser.add_argument("--positions", type=Path, help="lines `seconds x y z` in the first frame, at stamps of frames")
    parser.add_argument("--std", type=float, default=0.02, help="their σ, metres")
    given = parser.parse_args()
    try:
        run, positions = sfm.read_results(given.folder), read_positions(given.positions)
    except (sfm.StreamSfmError, OSError) as error:
        raise SystemExit(str(error)) from None
    used = len(set(run.stamps_ns[1:].tolist()) & set(positions))
    if used < len(positions):
        print(f"{used} of {len(positions)} positions are used: the others are not at the stamp of a later frame")
    try:
        end, pose, cov = fused(run, positions, given.std)
    except sfm.ConfigError as error:
        raise SystemExit(str(error)) from None
    std_mm = 1e3 * np.sqrt(np.trace(cov[:3, :3]))
    print(f"frame {end} is at {np.round(pose[:3, 3], 4).tolist()} m, σ {std_mm:.2f} mm")


if __name__ == "__main__":
    main("Fuse the motions of a run with positions of another sensor in a filter.", fused)
