"""Fuse the motions of a run with positions from another sensor in a factor graph (GTSAM).

    pip install gtsam
    stream-sfm replay logs/room.mcap
    python examples/fuse_gtsam.py runs/latest --positions fixes.tum --std 0.02

About every eighth frame, and each frame with a position, has a pose; one motion connects each two of them. The
errors that all motions share are one variable, and those after a knock of the rig another one.
"""

import sys

import numpy as np
from fuse_ekf import UNSEEN, main

import stream_sfm as sfm

try:
    import gtsam
except ModuleNotFoundError:
    sys.exit("error: this example needs GTSAM: pip install gtsam")

LENGTHS = gtsam.symbol("l", 0)  # the common errors that no view shows: of lengths and axes
TURNED = np.r_[3:6, 0:3]  # GTSAM's tangents have the rotation first


def rig_of(motion: sfm.Motion) -> int:
    """Return the variable of the rig errors; after a knock of the rig it is another one."""
    return int(gtsam.symbol("r", motion.common_since))


def fused(run: sfm.RunResults, positions: dict[int, np.ndarray], std_m: float) -> tuple[int, np.ndarray, np.ndarray]:
    """Return the index of the last frame, its pose (4, 4) and covariance (6, 6), translation first, in the first frame.

    `positions` (3,) in the first frame by the stamp of the frame, each with σ `std_m`.
    """
    estimates = list(run.estimates())
    stamps_ns = {estimate.frame_index: estimate.stamp_ns for estimate in estimates}
    motions = sfm.chain(estimates, to=[index for index, stamp_ns in stamps_ns.items() if stamp_ns in positions])
    graph, values, end = gtsam.NonlinearFactorGraph(), gtsam.Values(), estimates[0].frame_index
    graph.add(gtsam.PriorFactorPose3(end, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)))
    values.insert(end, gtsam.Pose3())
    known = {}  # the last motion knows best what is common
    for motion in motions:
        if len(motion.mean):
            known[LENGTHS] = motion.mean[:UNSEEN], motion.cov_common[:UNSEEN, :UNSEEN]
        if len(motion.mean) > UNSEEN:
            known[rig_of(motion)] = motion.mean[UNSEEN:], motion.cov_common[UNSEEN:, UNSEEN:]
    for variable, (mean, cov) in known.items():
        least = 1e-12 * np.eye(len(mean))  # what is known for certain has no information matrix
        graph.add(gtsam.PriorFactorVector(variable, mean, gtsam.noiseModel.Gaussian.Covariance(cov + least)))
        values.insert(variable, mean)
    for motion in motions:
        graph.add(_factor(motion))
        before, end = end, motion.newest if motion.newest is not None else end
        values.insert(end, values.atPose3(before).compose(gtsam.Pose3(motion.earlier_from_newest)))
        if (position := positions.get(stamps_ns[end])) is not None:
            graph.add(gtsam.GPSFactor(end, position, gtsam.noiseModel.Isotropic.Sigma(3, std_m)))
    solution, cov = _solved(graph, values, end)
    return end, solution.matrix(), cov[np.ix_(TURNED, TURNED)]


def _solved(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, at: int) -> tuple[gtsam.Pose3, np.ndarray]:
    """Return a pose of the best solution, and its covariance.

    After a loss that no view bridges, variances differ by 10¹⁵: Cholesky decompositions fail there, and QR does not.
    """
    settings, of_covariances = gtsam.LevenbergMarquardtParams(), gtsam.ISAM2Params()
    settings.setLinearSolverType("MULTIFRONTAL_QR")
    of_covariances.setFactorization("QR")  # `gtsam.Marginals` knows no QR in Python
    solution = gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    solver = gtsam.ISAM2(of_covariances)
    solver.update(graph, solution)
    return solution.atPose3(at), solver.marginalCovariance(at)


def _factor(motion: sfm.Motion) -> gtsam.CustomFactor:
    """Return the factor of a motion: truth = measured·Exp(J (c − mean) + own)."""
    measured, m = gtsam.Pose3(motion.earlier_from_newest), len(motion.mean)
    ends = [frame for frame in (motion.earlier, motion.newest) if frame is not None]  # both: it is of a chain
    parts = {LENGTHS: slice(0, UNSEEN)} if m else {}
    if m > UNSEEN:
        parts[rig_of(motion)] = slice(UNSEEN, m)
    j = motion.common_jacobian[TURNED]

    def error(_: object, values: gtsam.Values, jacobians: list[np.ndarray] | None) -> np.ndarray:
        moved = values.atPose3(ends[0]).between(values.atPose3(ends[1]))
        own: np.ndarray = gtsam.Pose3.Logmap(measured.between(moved))
        for variable, part in parts.items():
            own = own - j[:, part] @ (values.atVector(variable) - motion.mean[part])
        if jacobians is not None:  # `own` is small
            found = [-moved.inverse().AdjointMap(), np.eye(6), *(-j[:, part] for part in parts.values())]
            for k, jacobian in enumerate(found):
                jacobians[k] = jacobian
        return own

    noise = gtsam.noiseModel.Gaussian.Covariance(motion.cov_own[np.ix_(TURNED, TURNED)])
    return gtsam.CustomFactor(noise, [*ends, *parts], error)


if __name__ == "__main__":
    main("Fuse the motions of a run with positions of another sensor in a factor graph.", fused)
