"""The covariance of concatenated motions: neighbouring pairs share the noise of a frame."""

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators.baselines.frame_to_frame import FrameToFrame
from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import Scene


@pytest.mark.slow
def test_poses_and_points_are_consistent():
    """30 scenes, after 20 pairs: NEES 6 ± 3·√(12/30) of the pose, 3 of points in the world; else it were 2 to 4."""
    pose, points = [], []
    for seed in range(30):
        s = Scene(track_length=8, frames=21).sequence(np.random.SeedSequence([11, seed]))
        estimator = FrameToFrame(s.projection, Config())
        found = [estimator.step(o) for o in s.observations][-1]
        xi = se3.log(se3.inverse(found.world_from_cam) @ s.world_from_cam[20])
        pose.append(float(xi @ np.linalg.solve(found.cov_pose, xi)))
        e = s.points_in_world[found.track_ids] - found.points_in_world
        points.append(float(np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.cov_points_in_world), e).mean()))
    assert abs(np.mean(pose) - 6) < 3 * np.sqrt(12 / 30)
    assert abs(np.mean(points) - 3) < 3 * np.sqrt(6 / 30)  # the points of a scene share the error of its pose
