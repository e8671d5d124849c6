"""The full adjustment and its marginals against an independent factor-graph library, and laws of the bound."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.estimators.baselines.full_batch import cramer_rao_bound
from stream_sfm.geometry import se3
from tests.helpers.full_batch import batch_adjust


def disturbed_start(sequence):
    rng = np.random.default_rng(0)
    n, p = len(sequence.world_from_cam), len(sequence.points_in_world)
    xi = 0.01 * rng.normal(size=(n, 6))
    xi[0] = 0
    return sequence.world_from_cam @ se3.exp(xi), sequence.points_in_world + 0.02 * rng.normal(size=(p, 3))


def test_agrees_with_gtsam(arc):
    """Poses to 1e-7 rad and 1e-7 m, marginal covariances to 1e-4 of themselves.

    GTSAM's stereo factor measures one row for both cameras, so each view is reduced to (u_left, u_right, v) first;
    views have the same isotropic noise for that.
    """
    gtsam = pytest.importorskip("gtsam")
    std = 0.3
    observations = []
    for o in arc.observations:
        z = o.z_px.copy()
        z[:, 1] = z[:, 3] = z[:, [1, 3]].mean(axis=1)
        observations.append(replace(o, z_px=z, cov_px=np.broadcast_to(std**2 * np.eye(4), (len(z), 4, 4))))
    poses, points = disturbed_start(arc)
    ours, covariances = batch_adjust(arc.projection, observations, poses, points)

    p = arc.projection
    # One calibration for both cameras: shift u_right so that both principal points agree.
    calibration = gtsam.Cal3_S2Stereo(p.f_px, p.f_px, 0.0, p.cx_left_px, p.cy_px, p.baseline_m)
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([std, std, std / np.sqrt(2)]))
    graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    pose_key = [gtsam.symbol("x", k) for k in range(len(poses))]
    for o in observations:
        for track, z in zip(o.track_ids, o.z_px, strict=True):
            point = gtsam.StereoPoint2(z[0], z[2] - p.cx_right_px + p.cx_left_px, z[1])
            key = gtsam.symbol("l", int(track))
            graph.add(gtsam.GenericStereoFactor3D(point, noise, pose_key[o.frame_index], key, calibration))
    graph.add(gtsam.NonlinearEqualityPose3(pose_key[0], gtsam.Pose3(poses[0])))
    for key, pose in zip(pose_key, poses, strict=True):
        start.insert(key, gtsam.Pose3(pose))
    for track, point in enumerate(points):
        start.insert(gtsam.symbol("l", track), gtsam.Point3(*point))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-15)
    parameters.setAbsoluteErrorTol(1e-15)
    parameters.setMaxIterations(200)
    theirs = gtsam.LevenbergMarquardtOptimizer(graph, start, parameters).optimize()

    their_poses = np.stack([theirs.atPose3(k).matrix() for k in pose_key])
    difference = se3.log(se3.inverse(their_poses) @ ours.ref_from_cam)
    assert np.abs(difference).max() < 1e-7
    marginals = gtsam.Marginals(graph, theirs)
    order = [3, 4, 5, 0, 1, 2]  # GTSAM puts rotation first
    cov = marginals.marginalCovariance(pose_key[-1])[np.ix_(order, order)]
    scale = np.sqrt(np.diag(cov))
    assert np.abs((covariances.cov_pose(len(poses) - 1) - cov) / np.outer(scale, scale)).max() < 1e-4
    for track in (0, len(points) // 2, len(points) - 1):
        cov = marginals.marginalCovariance(gtsam.symbol("l", track))
        scale = np.sqrt(np.diag(cov))
        assert np.abs((covariances.cov_points[track] - cov) / np.outer(scale, scale)).max() < 1e-4


def test_bound_is_the_covariance_of_the_batch(arc):
    """At the truth, the batch's own covariance is the bound, up to the distance of the estimate from the truth."""
    bound = cramer_rao_bound(arc.projection, arc.observations, arc.world_from_cam, arc.points_in_world)
    _, batch = batch_adjust(arc.projection, arc.observations, arc.world_from_cam, arc.points_in_world)
    assert bound.cov_poses[-1] == pytest.approx(batch.cov_pose(len(arc.observations) - 1), rel=0.1, abs=1e-7)
    assert not bound.cov_poses[0].any()
    local = bound.cov_points_in_cam.trace(axis1=1, axis2=2)
    assert (local > 0).all()


def test_more_frames_never_hurt(arc):
    """The bound of a pose decreases when later frames are added; the bound of the newest pose grows with drift."""
    s = arc
    early = cramer_rao_bound(s.projection, s.observations, s.world_from_cam, s.points_in_world, 6)
    late = cramer_rao_bound(s.projection, s.observations, s.world_from_cam, s.points_in_world)
    gain = early.cov_poses[6] - late.cov_poses[6]
    assert np.linalg.eigvalsh(gain).min() > -1e-12
