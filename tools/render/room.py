"""The room of logs/room.mcap: its furniture, its stereo rig and the way a robot takes through it."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

from .caster import CLEAN, Sensor
from .recording import Recording
from .scene import Box, Scene, build_scene
from .textures import books, bricks, cabinet, carton, ceiling, crate, fabric, planks, wall

ROOM_M = (7.0, 6.0, 2.7)
START_M = (1.15, 1.35, 1.15)  # of the left camera, in the room
RATE_HZ = 10.0


def room_rig() -> StereoRig:
    """A pair as one finds it on a robot: 0.16 m apart, converging by 1.8°, slightly rolled, lenses that differ."""
    left = Camera(
        512, 384, np.array([[418.6, 0, 254.1], [0, 418.1, 193.4], [0, 0, 1.0]]),
        (-0.082, 0.031, 0.0006, -0.0004, 0.0), "plumb_bob",
    )  # fmt: skip
    right = Camera(
        512, 384, np.array([[421.2, 0, 257.7], [0, 420.8, 189.8], [0, 0, 1.0]]),
        (-0.077, 0.026, -0.0003, 0.0007, 0.0), "plumb_bob",
    )  # fmt: skip
    left_from_right = se3.from_rotation_translation(
        se3.exp_so3(np.deg2rad([0.25, -1.8, 0.35])), np.array([0.1600, 0.0012, -0.0018])
    )
    return StereoRig(left, right, se3.inverse(left_from_right))


def furniture() -> tuple[Box, ...]:
    def standing(x: float, y: float, w: float, d: float, h: float, paint, yaw: float = 0.0, z: float = 0.0) -> Box:
        return Box((x, y, z + h / 2), (w, d, h), paint, yaw)

    w, d, h = ROOM_M
    boards = planks(105, 0.12, 12)
    room = Box(
        (w / 2, d / 2, h / 2), ROOM_M,
        (wall(4), wall(5, 160), bricks, wall(6, 148), planks(122), ceiling), inside=True,
    )  # fmt: skip
    table = [standing(5.35, 1.55, 1.1, 0.7, 0.04, boards, 12, 0.70)]
    for dx, dy in ((-0.48, -0.28), (0.48, -0.28), (-0.48, 0.28), (0.48, 0.28)):
        c, s = np.cos(np.deg2rad(12)), np.sin(np.deg2rad(12))
        table.append(standing(5.35 + c * dx - s * dy, 1.55 + s * dx + c * dy, 0.06, 0.06, 0.70, boards, 12))
    return (
        room,
        *table,
        standing(5.15, 1.60, 0.34, 0.26, 0.24, carton, 35, 0.74),
        standing(5.62, 1.48, 0.22, 0.30, 0.36, carton, -15, 0.74),
        standing(6.80, 2.55, 0.40, 1.30, 1.95, (books,) * 4 + (boards,) * 2),
        standing(6.70, 4.15, 0.55, 0.95, 1.05, cabinet),
        standing(6.62, 4.05, 0.30, 0.42, 0.33, carton, 20, 1.05),
        standing(6.65, 0.40, 0.55, 0.60, 1.55, cabinet),
        standing(4.20, 0.40, 0.70, 0.55, 0.55, crate, -8),
        standing(4.12, 0.38, 0.45, 0.40, 0.40, crate, 14, 0.55),
        standing(3.35, 0.35, 0.40, 0.40, 0.80, crate, 5),
        standing(5.75, 5.45, 0.75, 0.60, 0.62, crate, 24),
        standing(5.70, 5.50, 0.46, 0.40, 0.38, carton, -12, 0.62),
        standing(5.35, 3.75, 0.24, 0.24, 2.70, bricks, 30),
        standing(4.45, 5.78, 1.20, 0.36, 2.05, (books,) * 4 + (boards,) * 2),
        standing(2.70, 5.55, 1.50, 0.75, 0.42, fabric(100), -4),
        standing(2.70, 5.85, 1.50, 0.22, 0.85, fabric(88), -4),
        standing(1.15, 5.62, 0.60, 0.60, 1.30, cabinet, 6),
        standing(0.45, 4.55, 0.60, 0.70, 0.60, crate, 15),
        standing(0.42, 4.52, 0.40, 0.36, 0.34, carton, -20, 0.60),
        standing(0.25, 3.20, 0.40, 1.20, 1.70, (books,) * 4 + (boards,) * 2),
        standing(3.75, 3.90, 0.90, 0.60, 0.012, fabric(120), 40),
    )


def room_path(frames: int = 84, rate_hz: float = RATE_HZ) -> NDArray[np.float64]:
    """world_from_cam (n, 4, 4): a robot drives in, turns left around the room, then right; the floor is uneven.

    The world is the first left camera.
    """
    t = np.arange(frames) / max(frames - 1, 1)
    fine = np.linspace(0, 1, 4001)
    ramp = np.clip(fine / 0.12, 0, 1) * np.clip((1 - fine) / 0.12, 0, 1)
    speed = gaussian_filter1d(0.25 + 0.75 * ramp, 120)
    turning = np.where((fine > 0.20) & (fine < 0.76), 1.0, 0.0) - 0.75 * ((fine > 0.83) & (fine < 0.97))
    turning = gaussian_filter1d(turning, 170)
    step = fine[1] - fine[0]
    heading = np.deg2rad(4) + np.deg2rad(232) * np.cumsum(turning) * step
    travelled_m = 4.05 * np.cumsum(speed) / np.sum(speed)
    x = START_M[0] + np.concatenate([[0], np.cumsum(np.cos(heading[:-1]) * np.diff(travelled_m))])
    y = START_M[1] + np.concatenate([[0], np.cumsum(np.sin(heading[:-1]) * np.diff(travelled_m))])
    seconds = t * (frames - 1) / rate_hz
    rock = np.minimum(seconds, 1.0)  # the unevenness sets in with the motion
    roll = np.deg2rad(0.7) * rock * np.sin(2.1 * seconds + 0.4)
    pitch = np.deg2rad(-5.0) + np.deg2rad(0.6) * rock * np.sin(3.3 * seconds)
    bob = 0.006 * rock * np.sin(4.4 * seconds + 1.0)
    x, y, heading = (np.interp(t, fine, value) for value in (x, y, heading))
    mount = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])  # the camera's axes in those of the robot, x forward
    rotation = (
        se3.exp_so3(np.stack([0 * heading, 0 * heading, heading], axis=-1))
        @ se3.exp_so3(np.stack([0 * pitch, -pitch, 0 * pitch], axis=-1))
        @ se3.exp_so3(np.stack([roll, 0 * roll, 0 * roll], axis=-1))
        @ mount
    )
    room_from_cam = se3.from_rotation_translation(rotation, np.stack([x, y, START_M[2] + bob], axis=-1))
    return se3.inverse(room_from_cam[0]) @ room_from_cam


def room_from_first_cam() -> NDArray[np.float64]:
    heading, pitch = np.deg2rad(4), np.deg2rad(-5.0)
    mount = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])
    rotation = se3.exp_so3(np.array([0, 0, heading])) @ se3.exp_so3(np.array([0, -pitch, 0])) @ mount
    return se3.from_rotation_translation(rotation, np.array(START_M))


def room_recording(seed: int = 7, sensor: Sensor = CLEAN) -> Recording:
    """The room as logs/room.mcap shows it."""
    scene, path = room_scene(seed), room_path()
    return Recording(scene, room_rig(), len(path), RATE_HZ, lambda t: path[round(t * RATE_HZ)], sensor=sensor)


def room_scene(seed: int = 7, texel_m: float = 0.0025) -> Scene:
    """The furnished room. A coarser `texel_m` is quicker to build, for tests that need no fine detail."""
    return build_scene(furniture(), seed, texel_m, room_from_first_cam())
