"""Fuse the motions of a run with positions of another sensor in a factor graph (GTSAM).

pip install gtsam
stream-sfm replay logs/room.mcap
python examples/fuse_gtsam.py runs/latest --positions fixes.tum --std 0.02

Every eighth frame, and each with a position, is a pose; between two of them is one motion, and the errors that all
motions share are one variable.
"""

import gtsam
import numpy as np
from fuse_ekf import NO_MOTION, ends, main

import stream_sfm as sfm

C = gtsam.symbol("c", 0)  # the common errors
TURNED = np.r_[3:6, 0:3]  # GTSAM's tangents have the rotation first


def fused(
    run: sfm.RunResults, positions: dict[int, np.ndarray], std_m: float
) -> tuple[int, np.ndarray, np.ndarray]:
    """Return the index of the last frame, its pose (4, 4) and covariance (6, 6), translation first, in the first frame.

    `positions` (3,) in the first frame by the stamp of the frame, each with σ `std_m`.
    """
    estimates = list(run.estimates())
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)))
    values.insert(0, gtsam.Pose3())
    known = estimates[-1].common  # the last frame knows best what is common
    if known is not None:
        least = 1e-12 * np.eye(len(known.mean))  # what is known for certain has no information matrix
        graph.add(gtsam.PriorFactorVector(C, known.mean, gtsam.noiseModel.Gaussian.Covariance(known.cov + least)))
        values.insert(C, known.mean)
    before = 0
    for end in ends([estimate.stamp_ns for estimate in estimates], positions):
        motion = sfm.Motion.of(estimates[end], end - before)
        if motion is None:
            raise SystemExit(NO_MOTION.format(end=end, before=before))
        graph.add(_factor(before, end, motion))
        step = motion.earlier_from_newest
        values.insert(end, values.atPose3(before).compose(gtsam.Pose3(step)))
        if (position := positions.get(estimates[end].stamp_ns)) is not None:
            graph.add(gtsam.GPSFactor(end, position, gtsam.noiseModel.Isotropic.Sigma(3, std_m)))
        before = end
    solution = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    cov = gtsam.Marginals(graph, solution).marginalCovariance(before)
    return before, solution.atPose3(before).matrix(), cov[np.ix_(TURNED, TURNED)]


def _factor(earlier: int, newest: int, motion: sfm.Motion) -> gtsam.CustomFactor:
    """What a motion says: truth = measured·Exp(J (c − mean) + own)."""
    measured, j = gtsam.Pose3(motion.earlier_from_newest), motion.common_jacobian[TURNED]
    keys = [earlier, newest] + ([C] if len(motion.mean) else [])

    def error(_: object, values: gtsam.Values, jacobians: list[np.ndarray] | None) -> np.ndarray:
        moved = values.atPose3(earlier).between(values.atPose3(newest))
        own: np.ndarray = gtsam.Pose3.Logmap(measured.between(moved))
        if C in keys:
            own = own - j @ (values.atVector(C) - motion.mean)
        if jacobians is not None:
            parts = [-moved.inverse().AdjointMap(), np.eye(6), -j]  # `own` is small
            for k in range(len(keys)):
                jacobians[k] = parts[k]
        return own

    noise = gtsam.noiseModel.Gaussian.Covariance(motion.cov_own[np.ix_(TURNED, TURNED)])
    return gtsam.CustomFactor(noise, keys, error)


if __name__ == "__main__":
    main("Fuse the motions of a run with positions of another sensor in a factor graph.", fused)
