"""Walking, turning and driving: smooth motions through rich scenes, to be rendered with and without a fault.

Each is a function of continuous time without a step in any derivative, and is under way in the first frame.
"""

import numpy as np
from numpy.typing import NDArray

from .hard import furnished_hall, rig, robot_pose, standing
from .recording import Recording
from .scene import Box, build_scene
from .textures import books, bricks, cabinet, carton, ceiling, crate, fabric, ground, planks, wall

Array = NDArray[np.float64]
RATE_HZ = 20.0


def _wave(amplitude: float, frequency_hz: float, t: float, phase: float = 0.0) -> float:
    return amplitude * np.sin(2 * np.pi * frequency_hz * t + phase)


def walking(width: int = 640, frames: int = 100, texel_m: float = 0.0025, seed: int = 0) -> Recording:
    """Through a furnished hall at 1.2 m/s, with the bob and sway of steps; up to 28 degrees per second."""
    length, depth, height = 14.0, 6.0, 2.8
    paint = (wall(4), wall(5, 160), bricks, wall(6), planks(122), ceiling)
    boxes = [Box((length / 2, depth / 2, height / 2), (length, depth, height), paint, inside=True)]
    rng = np.random.default_rng(31)
    for x in np.arange(2.5, length - 0.5, 2.2):
        for side, y in ((-1, 0.6), (1, depth - 0.6)):
            size_m = tuple(rng.uniform((0.5, 0.4, 0.5), (1.1, 0.9, 1.9)))
            surface = (books, cabinet, crate, carton, fabric(100))[rng.integers(5)]
            boxes.append(
                standing(float(x), y - side * rng.uniform(0, 0.9), size_m, surface, float(rng.uniform(-25, 25)))
            )

    def path(t: float) -> Array:
        at = (
            1.0 + 1.2 * t + _wave(0.02, 1.8, t, 0.5),
            3.0 + _wave(0.35, 0.15, t) + _wave(0.025, 0.9, t),
            1.45 + _wave(0.02, 1.8, t),
        )
        return robot_pose(at, (_wave(8, 0.35, t, 0.3), -3 + _wave(1.5, 1.8, t, 1.0), _wave(2, 0.9, t, 0.4)))

    return Recording(build_scene(tuple(boxes), 31 + 100 * seed, texel_m), rig(width), frames, RATE_HZ, path)


def turning(width: int = 640, frames: int = 100, texel_m: float = 0.0025, seed: int = 0) -> Recording:
    """Looking round in a furnished room while going slowly: head turns of up to 63 degrees per second."""

    def path(t: float) -> Array:
        at = (2.0 + 0.2 * t + _wave(0.05, 0.8, t), 2.9 + _wave(0.15, 0.4, t), 1.4 + _wave(0.03, 1.1, t, 0.7))
        angles_deg = (_wave(18.5, 0.5, t, -0.4), -2 + _wave(4, 0.8, t, 0.9), _wave(3, 0.6, t, 0.2))
        return robot_pose(at, angles_deg)

    return Recording(build_scene(furnished_hall(), 32 + 100 * seed, texel_m), rig(width), frames, RATE_HZ, path)


def driving(width: int = 640, frames: int = 90, texel_m: float = 0.0125, seed: int = 0) -> Recording:
    """Along a street at 36 km/h round two gentle bends, on a road that shakes the car a little."""
    length = 90.0
    ends = (ground(), bricks, ground(120), ground(125), ground(105), ground(200, 4))
    boxes = [Box((length / 2, 0, 8.0), (length, 24.0, 16.0), ends, inside=True)]
    rng, unseen = np.random.default_rng(33), ground()
    for side in (-1, 1):
        for x in np.arange(6, length - 4, 13):  # a house, and a parked car or van in front of it
            size_m = (float(rng.uniform(6, 10)), 4.0, float(rng.uniform(3, 7)))
            front = [bricks, bricks, unseen, unseen, unseen, unseen]  # −x, +x, and the side of the street
            front[2 if side > 0 else 3] = bricks
            boxes.append(standing(float(x), side * float(rng.uniform(9.5, 11)), size_m, tuple(front)))
            size_m = (float(rng.uniform(3.5, 5)), 1.8, float(rng.uniform(1.4, 2.4)))
            surface = (cabinet, crate, fabric(100), carton)[rng.integers(4)]
            boxes.append(standing(float(x + rng.uniform(0, 5)), side * float(rng.uniform(5, 6)), size_m, surface))

    def path(t: float) -> Array:
        bend, w = 1.5, 2 * np.pi / 5  # metres to the side, and rad/s: one bend in five seconds
        at = (4.0 + 10 * t, bend * np.cos(w * t), 1.6 + _wave(0.015, 1.5, t))
        heading = float(np.rad2deg(np.arctan2(-bend * w * np.sin(w * t), 10)))
        return robot_pose(at, (heading, -1 + _wave(0.3, 1.5, t, 0.8), _wave(0.4, 1.1, t)))

    stereo = rig(width, baseline_m=0.5, fov_deg=60)
    return Recording(build_scene(tuple(boxes), 33 + 100 * seed, texel_m), stereo, frames, RATE_HZ, path)


MOTIONS = {maker.__name__: maker for maker in (walking, turning, driving)}
