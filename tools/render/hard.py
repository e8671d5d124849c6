"""Hard scenes with exact ground truth: what a robot meets in its first week, rendered small or large.

Each function gives a `Recording`: a scene, a rig, where camera and moving bodies are at any time, the shutter and the
exposure. `RECORDINGS` is the list by name.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

from .recording import Place, Recording
from .scene import Box, build_scene
from .textures import bare_wall, books, bricks, cabinet, carton, ceiling, crate, fabric, ground, planks, wall

Array = NDArray[np.float64]
MOUNT = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])  # the camera's axes in those of the robot, x forward


def rig(width: int = 640, baseline_m: float = 0.12, fov_deg: float = 75.0) -> StereoRig:
    """A small robot's pair, 4:3, converging by 1°, with mild lenses that differ."""
    height = 3 * width // 4
    f = width / 2 / np.tan(np.deg2rad(fov_deg / 2))
    left = Camera(
        width, height, np.array([[f, 0, 0.497 * width], [0, f, 0.505 * height], [0, 0, 1.0]]),
        (-0.05, 0.012, 0.0003, -0.0002, 0.0), "plumb_bob",
    )  # fmt: skip
    right = Camera(
        width, height, np.array([[1.004 * f, 0, 0.504 * width], [0, 1.004 * f, 0.496 * height], [0, 0, 1.0]]),
        (-0.047, 0.01, -0.0002, 0.0004, 0.0), "plumb_bob",
    )  # fmt: skip
    left_from_right = se3.from_rotation_translation(
        se3.exp_so3(np.deg2rad([0.15, -1.0, 0.2])), np.array([baseline_m, 0.001, -0.001])
    )
    return StereoRig(left, right, se3.inverse(left_from_right))


def robot_pose(at_m: ArrayLike, angles_deg: ArrayLike) -> Array:
    """room_from_cam (4, 4) of a robot there; angles are heading, pitch (up) and roll."""
    heading, pitch, roll = np.deg2rad(angles_deg)
    rotation = (
        se3.exp_so3(np.array([0, 0, heading]))
        @ se3.exp_so3(np.array([0, -pitch, 0]))
        @ se3.exp_so3(np.array([roll, 0, 0]))
        @ MOUNT
    )
    return se3.from_rotation_translation(rotation, np.asarray(at_m, dtype=float))


def smooth_path(
    times_s: list[float],
    positions_m: list[tuple[float, float, float]],
    angles_deg: list[tuple[float, float, float]],
) -> Callable[[float], Array]:
    """room_from_cam(t) through waypoints by cubic splines; angles as in `robot_pose`."""
    place = CubicSpline(times_s, np.array(positions_m))
    turn = CubicSpline(times_s, np.array(angles_deg))

    return lambda t: robot_pose(place(t), turn(t))


def standing(x: float, y: float, size_m: tuple[float, float, float], paint, yaw: float = 0.0) -> Box:
    return Box((x, y, size_m[2] / 2), size_m, paint, yaw)


def furnished_hall(mirror: bool = False) -> tuple[Box, ...]:
    """A furnished room of 7 by 6 m, with a mirror on the far wall if asked for."""
    w, d, h = 7.0, 6.0, 2.7
    room = Box((w / 2, d / 2, h / 2), (w, d, h), (wall(4), wall(5, 160), bricks, wall(6), planks(122), ceiling),
               inside=True)  # fmt: skip
    boxes = [
        room,
        standing(6.7, 1.2, (0.5, 1.1, 1.9), books),
        standing(6.6, 4.8, (0.6, 0.9, 1.1), cabinet),
        standing(5.0, 5.6, (1.2, 0.5, 0.8), crate, 8),
        standing(4.6, 0.5, (0.8, 0.6, 0.6), crate, -12),
        standing(5.6, 2.2, (0.5, 0.5, 0.7), carton, 30),
        standing(2.6, 5.6, (1.4, 0.6, 0.5), fabric(100)),
    ]
    if mirror:
        boxes.append(Box((6.98, 3.0, 1.3), (0.02, 1.6, 1.5), ground(200, 1), mirror=0))
    return tuple(boxes)


def crowd(width: int = 640, frames: int = 120, texel_m: float = 0.0025, seed: int = 0) -> Recording:
    """Three textured bodies walk through the view, close by, while the camera moves slowly."""
    walkers = (
        standing(2.6, 1.0, (0.55, 0.55, 1.8), fabric(105), 10),
        standing(2.9, 4.6, (0.6, 0.5, 1.7), carton, 40),
        standing(3.6, 2.0, (0.6, 0.6, 1.9), crate, 20),
    )
    hall = furnished_hall()
    first = len(hall)

    def bodies(t: float) -> dict[int, Place]:
        s = t / 6.0
        return {
            first: ((2.5 + 0.15 * np.sin(5 * s), 1.7 + 2.6 * s, 0.9), 10 + 90 * s),
            first + 1: ((2.9, 4.1 - 2.2 * s, 0.85), 40 - 60 * s),
            first + 2: ((3.6 - 0.8 * s, 2.5 + 0.7 * np.sin(4 * s), 0.95), 20 + 120 * s),
        }

    path = smooth_path(
        [0, 3, 6], [(1.1, 2.9, 1.2), (1.6, 3.05, 1.22), (2.0, 3.1, 1.2)], [(0, -3, 0), (4, -2, 1), (1, -3, 0)]
    )
    return Recording(build_scene((*hall, *walkers), 21 + 100 * seed, texel_m), rig(width), frames, 20.0, path, bodies)


def corridor(width: int = 640, frames: int = 200, texel_m: float = 0.0025, seed: int = 0) -> Recording:
    """A white corridor with few notices, round two corners at up to 100 degrees per second."""
    paint = (bare_wall(3), bare_wall(2), bare_wall(3), bare_wall(2), planks(122), ceiling)
    block = (bare_wall(2), bare_wall(3), bare_wall(2), bare_wall(3), planks(122), planks(122))
    boxes = (
        Box((4.0, 3.5, 1.25), (8.0, 7.0, 2.5), paint, inside=True),
        Box((4.0, 3.5, 1.25), (4.6, 3.6, 2.5), block),
    )
    last = frames / 20.0
    t = [last * s for s in (0, 0.3, 0.38, 0.46, 0.7, 0.78, 0.86, 1.0)]
    at = [(1.0, 0.9, 1.2), (5.8, 0.85, 1.2), (6.8, 1.0, 1.2), (7.15, 1.9, 1.2), (7.2, 5.0, 1.2), (6.9, 5.9, 1.2),
          (6.0, 6.15, 1.2), (3.6, 6.1, 1.2)]  # fmt: skip
    look = [(0, 0, 0), (2, -1, 0), (40, 0, 0), (88, 0, 1), (91, 0, 0), (140, -1, 0), (178, 0, 0), (180, 0, 0)]
    return Recording(build_scene(boxes, 22 + 100 * seed, texel_m), rig(width), frames, 20.0, smooth_path(t, at, look))


def motorway(width: int = 640, frames: int = 60, texel_m: float = 0.02, seed: int = 0) -> Recording:
    """A car at 36 km/h already in the first frame, one metre per frame, with little close by."""
    length = 60.0 + frames
    room = Box((length / 2, 0, 12.0), (length, 60.0, 24.0),
               (ground(130), ground(130), ground(120), ground(125), ground(100, 10), bare_wall(0, 225)),
               inside=True)  # fmt: skip
    rng = np.random.default_rng(5)
    sheds = [
        standing(float(x), float(side * rng.uniform(12, 20)), (6.0, 5.0, float(rng.uniform(4, 9))), bricks)
        for x in np.arange(20, length, 22)
        for side in (-1, 1)
    ]
    seconds = frames / 10.0
    t = [0, seconds / 3, 2 * seconds / 3, seconds]
    path = smooth_path(
        t,
        [(4.0 + 10 * s, 0.4 * np.sin(s / 3), 1.6) for s in t],
        [(0.4 * np.sin(s), 0.3 * np.sin(2 * s), 0) for s in t],
    )
    stereo = rig(width, baseline_m=0.5, fov_deg=60)
    return Recording(build_scene((room, *sheds), 23 + 100 * seed, texel_m), stereo, frames, 10.0, path)


def shaken(width: int = 640, frames: int = 100, texel_m: float = 0.0025, seed: int = 0) -> Recording:
    """Held in a restless hand, with a shutter open for 12 ms: motion blur of several pixels."""

    def path(t: float) -> Array:
        at = np.array([1.6 + 0.25 * np.sin(1.7 * t), 2.8 + 0.3 * np.sin(1.1 * t), 1.25 + 0.1 * np.sin(2.9 * t)])
        heading, pitch, roll = 0.22 * np.sin(3.1 * t), 0.12 * np.sin(4.3 * t + 1), 0.1 * np.sin(3.7 * t + 2)
        rotation = se3.exp_so3(np.array([0, 0, heading])) @ se3.exp_so3(np.array([roll, -pitch, 0])) @ MOUNT
        return se3.from_rotation_translation(rotation, at)

    return Recording(
        build_scene(furnished_hall(), 24 + 100 * seed, texel_m), rig(width), frames, 20.0, path, shutter_s=0.012
    )


def flicker(width: int = 640, frames: int = 60, texel_m: float = 0.0025, seed: int = 0) -> Recording:
    """Exposures that jump from frame to frame and differ between the cameras."""
    rng = np.random.default_rng(6)
    gains = np.exp(rng.normal(0, 0.18, (frames, 2)) + rng.normal(0, 0.12, (frames, 1)))
    last = frames / 20.0
    path = smooth_path(
        [0, last / 2, last],
        [(1.2, 1.6, 1.2), (1.7, 2.3, 1.2), (2.2, 3.2, 1.2)],
        [(15, -3, 0), (5, -2, 0), (-6, 0, 0)],
    )
    return Recording(
        build_scene(furnished_hall(), 25 + 100 * seed, texel_m),
        rig(width),
        frames,
        20.0,
        path,
        gains=lambda i: (gains[i, 0], gains[i, 1]),
    )


def mirror(width: int = 640, frames: int = 60, texel_m: float = 0.0025, seed: int = 0) -> Recording:
    """Towards a wall mirror: the mirrored room moves rigidly too, behind the glass."""
    last = frames / 20.0
    path = smooth_path(
        [0, last / 2, last],
        [(1.6, 2.4, 1.25), (2.4, 2.7, 1.25), (3.2, 2.9, 1.25)],
        [(4, 0, 0), (6, 0, 0), (2, 0, 0)],
    )
    return Recording(build_scene(furnished_hall(mirror=True), 26 + 100 * seed, texel_m), rig(width), frames, 20.0, path)


def spin(width: int = 640, frames: int = 60, texel_m: float = 0.0025, seed: int = 0) -> Recording:
    """Turning on the spot: yaw, then pitch, then roll, without a step."""
    last = frames / 20.0
    t = [last * s for s in (0, 0.33, 0.66, 1.0)]
    path = smooth_path(t, [(2.6, 2.9, 1.25)] * 4, [(-12, 0, 0), (14, 0, 0), (14, 12, 2), (8, 4, 18)])
    return Recording(build_scene(furnished_hall(), 27 + 100 * seed, texel_m), rig(width), frames, 20.0, path)


RECORDINGS: dict[str, Callable[..., Recording]] = {
    maker.__name__: maker for maker in (crowd, corridor, motorway, shaken, flicker, mirror, spin)
}
