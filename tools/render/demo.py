"""The demo log: a small camera in dim light goes through the room of room.mcap, a little wrong in its calibration."""

from dataclasses import replace

import numpy as np

from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

from .caster import Sensor
from .hard import rig, standing
from .recording import Place, Recording
from .room import furniture, room_from_first_cam, room_path
from .scene import build_scene
from .textures import fabric

RATE_HZ = 20.0
SENSOR = Sensor(read_noise=2.1, shot_noise=0.045)  # 3.2 grey levels at mid grey
STD_TURN_RAD, STD_CENTRE_PX, STD_FOCAL = 2e-4, 0.15, 3e-4  # of the calibration of the right camera, each component
PASSING = (0.25, 0.7)  # when somebody walks by, as shares of the time


def demo_recording(seed: int, width: int = 320, frames: int = 180) -> Recording:
    """Once round the room in nine seconds; `seed` draws textures, noise and what the calibration has wrong."""
    walker = standing(0, 0, (0.45, 0.35, 1.7), fabric(105))
    boxes = (*furniture(), walker)
    path, duration_s = room_path(frames, RATE_HZ), frames / RATE_HZ
    calibrated, true = demo_rigs(seed, width)

    def bodies(t: float) -> dict[int, Place]:
        share = t / duration_s
        y = 10 * (share - PASSING[0]) if PASSING[0] < share < PASSING[1] else -5.0  # outside the room
        return {len(boxes) - 1: ((4.6 - 0.2 * share, y, 0.85), 10 + 60 * share)}

    return Recording(
        build_scene(boxes, seed, 0.005, room_from_first_cam()),
        calibrated,
        frames,
        RATE_HZ,
        lambda t: path[round(t * RATE_HZ)],
        bodies,
        sensor=SENSOR,
        true_rig=lambda _: true,
    )


def demo_rigs(seed: int, width: int = 320) -> tuple[StereoRig, StereoRig]:
    """The rig of the calibration, and the one that takes the images."""
    calibrated, drawn = rig(width), np.random.default_rng((seed, 99)).standard_normal(6)
    turn = se3.from_rotation_translation(se3.exp_so3(STD_TURN_RAD * drawn[:3]), np.zeros(3))
    k = calibrated.right.K.copy()
    k[:2, 2] += STD_CENTRE_PX * drawn[3:5]
    k[[0, 1], [0, 1]] *= 1 + STD_FOCAL * drawn[5]
    right = replace(calibrated.right, K=k)
    return calibrated, replace(calibrated, right=right, right_from_left=turn @ calibrated.right_from_left)
