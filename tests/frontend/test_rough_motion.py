"""The largest motion between two frames that the front-end follows without a prediction."""

import numpy as np
import pytest

from stream_sfm.geometry import se3
from stream_sfm.types import Observations
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.wall import Wall, rig

STEREO = rig()


def observed(poses: list[np.ndarray]) -> list[Observations]:
    """Observations of a wall 3 m away from these poses."""
    front_end, wall = SteppedFrontEnd(STEREO), Wall(4)
    return [front_end.step(wall.frame(STEREO, pose, index)) for index, pose in enumerate(poses)]


@pytest.mark.parametrize(
    ("what", "motion"),
    [
        ("turning by 17°, 78 px", [0, 0, 0, 0, 0.3, 0]),
        ("sideways by 87 px", [1.0, 0, 0, 0, 0, 0]),
        ("forward by a third of the distance", [0, 0, 1.0, 0, 0, 0]),
        ("rolling by 17°", [0, 0, 0, 0, 0, 0.3]),
    ],
)
def test_a_large_first_motion_is_followed(what: str, motion: list[float]) -> None:
    pose = se3.exp(motion)
    _, second = observed([np.eye(4), pose])
    assert second.cam_from_previous is not None, what
    error = se3.log(second.cam_from_previous @ pose)
    assert np.linalg.norm(error[:3]) < 0.02 and np.linalg.norm(error[3:]) < 0.005
    assert len(second.track_ids) - second.n_new > 20


def test_a_sudden_turn_against_the_prediction_is_followed() -> None:
    """Five frames to the right, then one far to the left: the prediction is off by 100 px."""
    poses = [se3.exp([0, 0, 0, 0, 0.04 * k, 0]) for k in range(6)]
    poses.append(poses[-1] @ se3.exp([0, 0, 0, 0, -0.33, 0]))
    last = observed(poses)[-1]
    assert last.cam_from_previous is not None
    error = se3.log(last.cam_from_previous @ se3.inverse(poses[-2]) @ poses[-1])
    assert np.linalg.norm(error[3:]) < 0.005
