"""A nearly white wall with blotches of a grey value or two, which are too faint for ordinary templates."""

import cv2
import numpy as np

from stream_sfm.camera.rig import StereoRig
from stream_sfm.config import Config
from stream_sfm.estimators.window.cross_frame import CrossFrame
from stream_sfm.frontend.alignment import WIDE
from stream_sfm.frontend.tracks import Tracks
from stream_sfm.geometry import se3
from stream_sfm.types import Solution
from tests.helpers.estimators import nees
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.wall import Wall, camera_path, rig


class BareWall(Wall):
    """The wall painted white, with blotches of some centimetres with a standard deviation of 1.5 grey values."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        blotches = cv2.GaussianBlur(self.texture.astype(np.float32), (0, 0), 12)
        self.texture = 200 + 1.5 * (blotches - blotches.mean()) / blotches.std()


def followed(wall: Wall, stereo: StereoRig, poses: np.ndarray) -> tuple[Tracks, list[Solution]]:
    """The tracks after some frames of the wall, and the solutions of the default estimator."""
    front_end = SteppedFrontEnd(stereo)  # the pair is rectified, so its axes are those of the camera
    estimator = CrossFrame(front_end.rectifier.projection, Config())
    solutions = [estimator.step(front_end.step(frame)) for frame in wall.frames(stereo, poses)]
    return front_end.state.tracks, solutions


def test_a_bare_wall_is_followed_by_wide_templates() -> None:
    poses = camera_path(12)
    tracks, solutions = followed(BareWall(3), rig(width=640, height=480), poses)
    assert (tracks.scale == WIDE).sum() > 20
    assert "lost" not in [s.status for s in solutions]
    for solution, pose in zip(solutions[1:], poses[1:], strict=True):
        assert nees(solution.world_from_cam, solution.cov_pose, pose) < 60  # of χ² with six degrees: P < 1e-10
        assert np.linalg.norm((se3.inverse(solution.world_from_cam) @ pose)[:3, 3]) < 0.05


def test_textured_images_get_ordinary_templates_only() -> None:
    tracks, _ = followed(Wall(3), rig(), camera_path(4))
    assert (tracks.scale == 1).all()
