"""Places drawn at random: a room, a corridor, a street, a yard, with what stands in them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .hard import standing
from .scene import Box
from .textures import (
    Image,
    Painter,
    bare_wall,
    books,
    bricks,
    cabinet,
    carton,
    ceiling,
    crate,
    fabric,
    ground,
    planks,
    wall,
)

Rng = np.random.Generator
SURFACES = (books, cabinet, crate, carton, fabric(100))


@dataclass(frozen=True, slots=True)
class Site:
    """Boxes, the first of them the room around, and where a camera may be: |x| and |y| up to `free_m`, at `eye_m`.

    The origin is in the middle of the floor; long places lie along x.
    """

    boxes: tuple[Box, ...]
    free_m: tuple[float, float]
    eye_m: float
    texel_m: float
    outdoors: bool = False


def repeating(paint: Painter, period_m: float, number: int) -> Painter:
    """The same strip of a painter beside itself, again and again, wherever it is painted."""

    def painted(_: Rng, w: float, h: float, texel_m: float) -> Image:
        strip = paint(np.random.default_rng(number), period_m, h, texel_m)
        columns = max(8, round(w / texel_m))
        return np.tile(strip, (1, -(-columns // strip.shape[1])))[:, :columns]

    return painted


def _walls(rng: Rng, repetition: bool, period_m: tuple[float, float]) -> list[Painter]:
    """Painters of four walls; those that repeat are all alike."""
    if repetition:
        kind = (planks(130), bricks, cabinet, fabric(120))[rng.integers(4)]
        return 4 * [repeating(kind, float(rng.uniform(*period_m)), int(rng.integers(1000)))]
    kinds = (wall(4), wall(6, 160), bricks, bare_wall(3), planks(140))
    return [kinds[k] for k in rng.integers(0, len(kinds), 4)]


def _surface(rng: Rng) -> Painter:
    return SURFACES[rng.integers(len(SURFACES))]


def _size(rng: Rng, low: tuple[float, float, float], high: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = rng.uniform(low, high).tolist()
    return x, y, z


def hall(rng: Rng, repetition: bool) -> Site:
    """A room of 6 to 9 m with furniture along its walls."""
    length, width, height = _size(rng, (7, 6, 2.5), (9.5, 8, 3.2))
    paint = (*_walls(rng, repetition, (0.4, 1.2)), planks(float(rng.uniform(95, 135))), ceiling)
    boxes = [Box((0, 0, height / 2), (length, width, height), paint, inside=True)]
    for _ in range(int(rng.integers(3, 7) if repetition else rng.integers(8, 15))):
        size, side = _size(rng, (0.4, 0.4, 0.5), (1.2, 0.9, 2.0)), rng.choice([-1, 1])
        along, off = rng.uniform(-0.46, 0.46), 0.5 - rng.uniform(0.05, 0.11)
        x, y = (along * length, side * off * width) if rng.random() < 0.5 else (side * off * length, along * width)
        boxes.append(standing(float(x), float(y), size, _surface(rng), float(rng.uniform(-25, 25))))
    return Site(tuple(boxes), (length / 2 - 1.7, width / 2 - 1.7), float(rng.uniform(0.9, 1.6)), 0.004)


def corridor(rng: Rng, repetition: bool) -> Site:
    """A corridor of 18 m, 2.6 to 4 m wide, with some things along its walls."""
    length, width, height = 18.0, float(rng.uniform(2.6, 4)), float(rng.uniform(2.4, 3))
    paint = (*_walls(rng, repetition, (0.5, 1.5)), planks(float(rng.uniform(95, 135))), ceiling)
    boxes = [Box((0, 0, height / 2), (length, width, height), paint, inside=True)]
    for _ in range(int(rng.integers(2, 5) if repetition else rng.integers(6, 12))):
        size, side = _size(rng, (0.4, 0.25, 0.5), (1.0, 0.5, 1.9)), rng.choice([-1, 1])
        y = side * (width / 2 - size[1] / 2)
        boxes.append(standing(float(rng.uniform(-8.5, 8.5)), float(y), size, _surface(rng)))
    return Site(tuple(boxes), (length / 2 - 1.5, width / 2 - 1.0), float(rng.uniform(0.9, 1.5)), 0.005)


def street(rng: Rng, repetition: bool) -> Site:
    """A street of 120 m between houses, with parked cars."""
    length, width, height = 120.0, float(rng.uniform(20, 28)), 16.0
    paint = (bricks, bricks, ground(120), ground(125), ground(float(rng.uniform(90, 120))), ground(200, 4))
    boxes = [Box((0, 0, height / 2), (length, width, height), paint, inside=True)]
    strip = repeating(bricks, float(rng.uniform(1.5, 4)), int(rng.integers(1000)))
    unseen = ground()
    for side in (-1, 1):
        for x in np.arange(-length / 2 + 3, length / 2 - 4, 13):
            front: list[Painter] = [bricks, bricks, unseen, unseen, unseen, unseen]
            front[2 if side > 0 else 3] = strip if repetition else (bricks, wall(6), planks(135, 0.5))[rng.integers(3)]
            size = (12.9, 4.0, 6.0) if repetition else _size(rng, (6, 4, 3), (10, 4, 7))
            at = float(x + 6), float(side * (width / 2 - rng.uniform(1, 2.5)))
            boxes.append(standing(*at, size, tuple(front)))
            if rng.random() < 0.7:
                car = _size(rng, (3.5, 1.7, 1.4), (5, 1.9, 2.4))
                boxes.append(
                    standing(float(x + rng.uniform(0, 8)), side * float(rng.uniform(5, 6)), car, _surface(rng))
                )
    return Site(tuple(boxes), (length / 2 - 8, 2.0), float(rng.uniform(1.3, 1.9)), 0.025, outdoors=True)


def yard(rng: Rng, repetition: bool) -> Site:
    """A yard of 24 by 20 m, with things on all sides of an open middle."""
    length, width, height = 24.0, 20.0, 8.0
    paint = (*_walls(rng, repetition, (0.8, 2.5)), ground(float(rng.uniform(90, 125))), ground(200, 4))
    boxes = [Box((0, 0, height / 2), (length, width, height), paint, inside=True)]
    for _ in range(int(rng.integers(6, 10) if repetition else rng.integers(14, 24))):
        size = _size(rng, (0.5, 0.5, 0.4), (2.0, 1.8, 2.4))
        angle, reach = rng.uniform(0, 2 * np.pi), rng.uniform(5, 9)
        x, y = float(1.2 * reach * np.cos(angle)), float(reach * np.sin(angle))
        boxes.append(standing(x, y, size, _surface(rng), float(rng.uniform(0, 90))))
    return Site(tuple(boxes), (3.2, 2.6), float(rng.uniform(1.0, 1.7)), 0.01, outdoors=True)


def tiled(rng: Rng, repetition: bool) -> Site:
    """A room with tiles or wallpaper all over, whose pattern returns after 0.12 to 0.4 m, and a few things in it."""
    length, width, height = _size(rng, (6, 5, 2.5), (9, 8, 3))
    papers = [_pattern(float(rng.uniform(0.12, 0.4)), int(rng.integers(1000))) for _ in range(3)]
    walls = [papers[k] for k in rng.integers(0, 2, 4)]
    boxes = [Box((0, 0, height / 2), (length, width, height), (*walls, papers[2], ground(200, 4)), inside=True)]
    for _ in range(int(rng.integers(1, 5))):
        size, side = _size(rng, (0.4, 0.4, 0.5), (1.2, 0.9, 2.0)), rng.choice([-1, 1])
        along, off = rng.uniform(-0.46, 0.46), 0.5 - rng.uniform(0.05, 0.11)
        boxes.append(standing(float(along * length), float(side * off * width), size, _surface(rng)))
    return Site(tuple(boxes), (length / 2 - 1.7, width / 2 - 1.7), float(rng.uniform(0.9, 1.6)), 0.004)


def _pattern(period_m: float, number: int) -> Painter:
    """One square of a painter, again and again in both directions, with joints between them."""

    def painted(_: Rng, w: float, h: float, texel_m: float) -> Image:
        square = ground(150, 22)(np.random.default_rng(number), period_m, period_m, texel_m)
        square[:2], square[:, :2] = 90, 90
        rows, columns = max(8, round(h / texel_m)), max(8, round(w / texel_m))
        again = -(-rows // len(square)), -(-columns // len(square[0]))
        return np.tile(square, again)[:rows, :columns]

    return painted


SITES: dict[str, Callable[[Rng, bool], Site]] = {
    maker.__name__: maker for maker in (hall, corridor, street, yard, tiled)
}
