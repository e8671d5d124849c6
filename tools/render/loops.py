"""Worlds that a camera sees more than once: what a map must find again, and what it must not confuse."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .hard import rig, robot_pose, standing
from .recording import Recording
from .scene import Box, build_scene
from .textures import Image, Painter, books, bricks, cabinet, carton, ceiling, crate, fabric, ground, planks, wall

Array = NDArray[np.float64]
RATE_HZ = 10.0
_SURFACES = (books, cabinet, crate, carton, fabric(100))


def _moving(at_m: ArrayLike, angles_deg: ArrayLike, frames: int) -> Callable[[float], Array]:
    """room_from_cam(t) through all of many poses (n, 3), (n, 3), at equal steps."""
    position, angles = np.asarray(at_m, float), np.asarray(angles_deg, float)
    ends = np.linspace(0, (frames - 1) / RATE_HZ, len(position))

    def path(t: float) -> Array:
        return robot_pose(*([np.interp(t, ends, column) for column in x.T] for x in (position, angles)))

    return path


def _on_wheels(x: Array, y: Array, height_m: float, look_deg: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Positions and angles (n, 3) along a line at equal steps, looking `look_deg` to the left, on an uneven floor."""
    along = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    s = np.linspace(0, along[-1], 4000)
    x, y = np.interp(s, along, x), np.interp(s, along, y)
    heading = np.rad2deg(np.unwrap(np.arctan2(np.gradient(y), np.gradient(x))))
    heading = np.convolve(np.pad(heading, 60, mode="edge"), np.full(121, 1 / 121), "valid")
    uneven = [np.sin(s * rate + phase) for rate, phase in zip((1.1, 0.7, 1.7), rng.uniform(0, 6, 3), strict=True)]
    at = np.stack([x, y, height_m + 0.01 * uneven[0]], axis=1)
    return at, np.stack([heading + look_deg, 0.4 * uneven[1] - 2, 0.5 * uneven[2]], axis=1)


def _ring(length: float, width: float, radius: float, laps: float) -> tuple[Array, Array]:
    """Round a rectangle with rounded corners about the origin, anticlockwise, from the middle of the lower side."""
    corners = [(1, -1, -90), (1, 1, 0), (-1, 1, 90), (-1, -1, 180)]
    lap = [np.array([[0.0, -width / 2]])]
    for sx, sy, begin in corners:
        angle = np.deg2rad(np.linspace(begin, begin + 90, 60))
        centre = sx * (length / 2 - radius), sy * (width / 2 - radius)
        lap.append(centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    line = np.concatenate(lap * int(np.ceil(laps)) + [lap[0]])
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    s = np.linspace(0, along[-1] * laps / np.ceil(laps), 4000)
    return np.interp(s, along, line[:, 0]), np.interp(s, along, line[:, 1])


def block(width: int = 320, frames: int = 300, seed: int = 0) -> Recording:
    """Twice round a block of houses, 36 m a time, in a street 5 m wide."""
    rng = np.random.default_rng((41, seed))
    paint = (wall(5), bricks, wall(6), bricks, ground(), ground(200, 4))
    house = (bricks, wall(4), bricks, wall(5), ground(), ground())
    boxes = [Box((0, 0, 2.5), (18, 14, 5), paint, inside=True), Box((0, 0, 2.5), (8, 4, 5), house)]
    for x, y in [
        *((x, s * 6.2) for x in (-5.5, -2, 2, 5.5) for s in (-1, 1)),
        *((s * 8.2, y) for y in (-2, 2) for s in (-1, 1)),
    ]:
        size = tuple(rng.uniform((0.6, 0.6, 0.8), (1.4, 1.1, 2.2)))
        boxes.append(standing(x + rng.uniform(-0.6, 0.6), y, size, _SURFACES[rng.integers(5)], rng.uniform(-15, 15)))  # type: ignore[arg-type]
    line = _ring(13, 9, 2.2, 2.0)
    path = _moving(*_on_wheels(*line, 1.4, 0, rng), frames)
    return Recording(build_scene(tuple(boxes), seed, 0.006), rig(width), frames, RATE_HZ, path)


def _same(paint: Painter, number: int) -> Painter:
    """The same picture wherever it is painted."""

    def painted(_: np.random.Generator, w: float, h: float, texel_m: float) -> Image:
        return paint(np.random.default_rng(number), w, h, texel_m)

    return painted


def office(width: int = 320, frames: int = 240, seed: int = 0) -> Recording:
    """Past five rooms that are the same to the last spot, there and back, looking into each."""
    rng, pitch = np.random.default_rng((42, seed)), 3.0
    ends = (wall(3), wall(4, 160), _same(wall(0), 1), bricks, planks(122), ceiling)
    boxes = [Box((0, 1.5, 1.3), (5 * pitch + 2, 7, 2.6), ends, inside=True)]
    cupboard, desk, box = (_same(paint, k) for k, paint in enumerate((books, cabinet, carton)))
    plain, rug = _same(ground(150), 10), _same(fabric(110), 13)
    back, side = (plain, plain, _same(wall(2), 11)) + 3 * (plain,), 2 * (_same(wall(1), 12),) + 4 * (plain,)
    for k in range(5):
        x = (k - 2) * pitch
        boxes += [
            Box((x, 4.9, 1.3), (pitch - 0.1, 0.1, 2.6), back),
            Box((x, 3.0, 0.01), (pitch - 0.1, 3.6, 0.02), rug),
            standing(x - 0.8, 4.5, (0.9, 0.5, 1.8), cupboard),
            standing(x + 0.5, 4.0, (1.1, 0.6, 0.75), desk, 10),
            Box((x + 0.6, 4.0, 0.9), (0.3, 0.3, 0.3), box, 30),
        ]
    boxes += [Box(((k - 2.5) * pitch, 3.2, 1.3), (0.1, 3.4, 2.6), side) for k in range(6)]
    way = np.concatenate([np.linspace(-6, 6, 200), np.linspace(6, -6, 200)[1:]])
    turn = 12 * np.sin(np.linspace(0, 4 * np.pi, len(way)))
    at = np.stack([way, 0.1 * np.sin(way), 1.3 + 0.02 * np.sin(2 * way)], axis=1)
    angles = np.stack([90 + turn, -4 + np.sin(way), 0.5 * np.sin(3 * way + rng.uniform(0, 6))], axis=1)
    path = _moving(at, angles, frames)
    return Recording(build_scene(tuple(boxes), seed, 0.005), rig(width), frames, RATE_HZ, path)


def mower(width: int = 320, frames: int = 280, seed: int = 0) -> Recording:
    """As a drone mows a field: five lanes above a yard, looking down, neighbours a third of the height apart."""
    rng = np.random.default_rng((43, seed))
    boxes = [Box((0, 0, 6), (26, 22, 12), ground(), inside=True)]
    for _ in range(26):
        size = tuple(rng.uniform((0.5, 0.5, 0.2), (1.8, 1.8, 0.9)))
        x, y = rng.uniform((-10, -8), (10, 8))
        boxes.append(standing(x, y, size, _SURFACES[rng.integers(5)], rng.uniform(0, 90)))  # type: ignore[arg-type]
    x, y = np.empty(0), np.empty(0)
    for k in range(5):
        bend = np.deg2rad(np.linspace(-80, 80, 30))
        side = 1 if k % 2 == 0 else -1
        x = np.concatenate([x, side * np.array([-5, 5]), side * (5 + np.cos(bend))])
        y = np.concatenate([y, [2 * k - 4] * 2, 2 * k - 3 + np.sin(bend)])
    along = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    s = np.linspace(0, along[-2], 3000)
    at = np.stack([np.interp(s, along, x), np.interp(s, along, y), 6 + 0.1 * np.sin(s / 3)], axis=1)
    angles = np.stack([4 * np.sin(s / 4 + rng.uniform(0, 6)), -82 + 2 * np.sin(s / 2), 2 * np.sin(s / 3)], axis=1)
    path = _moving(at, angles, frames)
    return Recording(build_scene(tuple(boxes), seed, 0.01), rig(width, 0.3), frames, RATE_HZ, path)


def lanes(width: int = 320, frames: int = 300, seed: int = 0) -> Recording:
    """Along a street, back on the other side, and along it once more in the lane beside the first."""
    rng, length = np.random.default_rng((44, seed)), 70.0
    ends = (bricks, wall(5), ground(120), ground(125), ground(105), ground(200, 4))
    boxes = [Box((0, 0, 7), (length + 30, 34, 14), ends, inside=True)]
    for side in (-1, 1):
        for x in np.arange(-length / 2 - 8, length / 2 + 8, 8):
            size = (float(rng.uniform(4, 7)), 3.0, float(rng.uniform(3, 6)))
            boxes.append(standing(float(x), side * float(rng.uniform(12, 14)), size, bricks))
            size = (float(rng.uniform(1, 4)), 1.6, float(rng.uniform(1.2, 2.4)))
            paint = _SURFACES[rng.integers(5)]
            boxes.append(standing(float(x + rng.uniform(0, 4)), side * float(rng.uniform(8.5, 10)), size, paint))
    bend = np.deg2rad(np.linspace(-90, 90, 60))
    half = length / 2 - 10
    x = np.concatenate([[-half], half + 4 * np.cos(bend), -half - 5.5 * np.cos(bend[1:-1]), [half]])
    y = np.concatenate([[-4], 4 * np.sin(bend), 4 - 5.5 + 5.5 * np.sin(-bend[1:-1]), [-7]])
    path = _moving(*_on_wheels(x, y, 1.6, 0, rng), frames)
    stereo = rig(width, baseline_m=0.5)
    return Recording(build_scene(tuple(boxes), seed, 0.02), stereo, frames, RATE_HZ, path)


def eight(width: int = 320, frames: int = 300, seed: int = 0) -> Recording:
    """Twice along a figure of eight in a hall: its two halves cross at right angles."""
    rng = np.random.default_rng((45, seed))
    ends = (wall(2), planks(130), wall(7), bricks, planks(150), ceiling)
    boxes = [Box((0, 0, 1.6), (14, 8, 3.2), ends, inside=True)]
    for side in (-1, 1):
        boxes.append(Box((side * 3.0, 0, 1.6), (1.0, 1.0, 3.2), (bricks,) * 6))
        for x in np.linspace(1.2, 5.6, 4):
            for row in (-1, 1):
                size = tuple(rng.uniform((0.5, 0.4, 0.5), (1.1, 0.7, 1.8)))
                at = float(side * x), float(row * rng.uniform(3.3, 3.6))
                boxes.append(standing(*at, size, _SURFACES[rng.integers(5)], rng.uniform(-20, 20)))  # type: ignore[arg-type]
    t = np.linspace(0, 4 * np.pi, 2000)
    path = _moving(*_on_wheels(5 * np.sin(t), 2 * np.sin(2 * t), 1.2, 0, rng), frames)
    return Recording(build_scene(tuple(boxes), seed, 0.005), rig(width), frames, RATE_HZ, path)


LOOPS: dict[str, Callable[..., Recording]] = {maker.__name__: maker for maker in (block, office, mower, lanes, eight)}
