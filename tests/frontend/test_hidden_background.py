"""A body that hides the background lies in front of it, and moves unlike the camera."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.frontend.rules import MotionRules
from stream_sfm.frontend.second_motions.motion_choice import is_scene_hidden
from stream_sfm.frontend.second_motions.unsteadiness import Unsteadiness
from stream_sfm.frontend.state import Setup
from stream_sfm.frontend.step import Step
from stream_sfm.geometry import se3
from stream_sfm.geometry.resection import Resection, SecondMotion
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.tracks import tracks_at

P = StereoProjection(400.0, 160.0, 160.0, 120.0, 0.1, 320, 240)
N_OLD, N_NEW, WALL_M, STD_M = 30, 20, 3.0, 1e-3


def hidden(new_m: float, moves_m: float, second: SecondMotion | None = None) -> bool:
    """Whether the background is hidden if no point of a wall is found, and new tracks at `new_m` move by `moves_m`.

    The camera has moved steadily, by 1 mm per frame. `second`: the motion of further tracks.
    """
    tracks = tracks_at(np.repeat([WALL_M, new_m], [N_OLD, N_NEW]), np.repeat([10, 0], [N_OLD, N_NEW]))
    new = np.arange(N_OLD + N_NEW) >= N_OLD
    unsteadiness = Unsteadiness(np.full(2, STD_M**2), 30.0, MotionRules())
    nothing = cast(Any, None)
    step = Step(Setup(P, Config()), nothing, nothing, 0.05, np.eye(4), True, None)
    state: Any = SimpleNamespace(tracks=tracks, background_hidden=False, unsteadiness=unsteadiness)
    seen: Any = SimpleNamespace(before=tracks.keep(new))
    cam_from_ref, all_new = se3.exp([moves_m, 0, 0, 0, 0, 0]), np.ones(N_NEW, bool)
    motion = Resection(cam_from_ref, np.eye(6), all_new, 0.0, 34, 1.0, True, np.zeros(N_NEW), 1.0, second=second)
    assert not step.jumps(cam_from_ref, step.std_change) or moves_m > 0.03
    return is_scene_hidden(step, state, seen, motion)


@pytest.mark.parametrize(
    ("new_m", "moves_m", "is_hidden"),
    [
        (0.6, 0.01, True),  # a near body, which moves as slowly as a camera may
        (0.6, 0.002, False),  # the scene, with a steady camera
        (WALL_M, 0.01, False),  # another part of the wall
        (WALL_M, 0.1, True),  # no camera moves like that
    ],
)
def test_the_background_is_hidden(new_m: float, moves_m: float, is_hidden: bool) -> None:
    assert hidden(new_m, moves_m) == is_hidden


def test_what_lies_behind_a_body_does_not_hide_it() -> None:
    none = np.zeros(N_NEW, bool)
    assert hidden(0.6, 0.1, SecondMotion(np.eye(4), np.eye(6), none, 0.01))
    assert not hidden(0.6, 0.1, SecondMotion(np.eye(4), np.eye(6), none, 0.01, in_front=True))
