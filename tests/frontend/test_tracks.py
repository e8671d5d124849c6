"""The inverse depths of tracks recover from a wrong motion."""

import numpy as np

from stream_sfm.frontend.rules import MotionRules
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.record import changed
from tests.helpers.tracks import tracks_at

P = StereoProjection(600.0, 320.0, 320.0, 240.0, 0.2, 640, 480)
STD_PX, N = 0.1, 400
STAYS, FORWARD = np.eye(4), se3.exp([0, 0, -0.3, 0, 0, 0])


def test_depths_recover_from_a_wrong_motion_within_a_second() -> None:
    """After 100 frames of a camera at rest, a motion of 0.3 m is assumed by mistake.

    If all views counted alike, these would outvote the next 20, and points 3 m away would stay 0.25 m too near.
    """
    rng, cov_px = np.random.default_rng(0), np.broadcast_to(STD_PX**2 * np.eye(4), (N, 4, 4))
    tracks = changed(tracks_at(np.full(N, 3.0)), var_rho=np.ones(N))
    true_px = P.project_homogeneous(tracks.points)
    for motion in [*[STAYS] * 100, FORWARD, *[STAYS] * 20]:
        z_px = true_px + STD_PX * rng.normal(size=(N, 4))
        tracks = tracks.updated(P, motion, z_px, cov_px, MotionRules().forgetting)
    assert abs((1 / tracks.points[:, 3]).mean() - 3) < 0.06
