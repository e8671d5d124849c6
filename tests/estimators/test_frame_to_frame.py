"""The covariance of concatenated motions: neighbouring pairs share the noise of a frame."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators.baselines.frame_to_frame import FrameToFrame
from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import Scene

FAR = Config()


def last_pair(arc, z_px):
    """The filter after frame 1, and its motion, with other views in frame 1."""
    estimator = FrameToFrame(arc.projection, FAR)
    estimator.step(arc.observations[0])
    estimator.step(replace(arc.observations[1], z_px=z_px))
    return estimator


def test_gains_are_differences(arc):
    """How the motion moves with single coordinates of the current frame's views."""
    z = arc.observations[1].z_px
    base = last_pair(arc, z)
    gains = base._gains
    assert gains is not None
    rows = np.searchsorted(arc.observations[1].track_ids, gains.ids)
    for k in (0, 3, 7):
        for c in range(4):
            poses = []
            for sign in (1, -1):
                moved = z.copy()
                moved[rows[k], c] += sign * 1e-3
                poses.append(last_pair(arc, moved)._world_from_previous)
            numerical = se3.log(se3.inverse(poses[1]) @ poses[0]) / 2e-3
            # Gauss-Newton leaves out curvature times residual, some hundredths of the gain
            scale = np.abs(gains.of_current[k]).max(axis=1)
            assert (np.abs(gains.of_current[k, :, c] - numerical) < 0.1 * scale).all()  # see above


@pytest.mark.slow
@pytest.mark.parametrize("length", [2, 8])
def test_poses_and_points_are_consistent(length):
    """30 scenes, after 20 pairs: NEES 6 ± 3·√(12/30) of the pose, 3 of points in the world; else it were 2 to 4."""
    pose, points = [], []
    for seed in range(30):
        s = Scene(track_length=length, frames=21).sequence(np.random.SeedSequence([11, seed]))
        estimator = FrameToFrame(s.projection, Config())
        found = [estimator.step(o) for o in s.observations][-1]
        xi = se3.log(se3.inverse(found.world_from_cam) @ s.world_from_cam[20])
        pose.append(float(xi @ np.linalg.solve(found.cov_pose, xi)))
        e = s.points_in_world[found.track_ids] - found.points_in_world
        points.append(float(np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.cov_points_in_world), e).mean()))
    assert abs(np.mean(pose) - 6) < 3 * np.sqrt(12 / 30)
    assert abs(np.mean(points) - 3) < 3 * np.sqrt(6 / 30)  # the points of a scene share the error of its pose
