"""Procedural surfaces with structure at every scale, from metres down to the texel; nothing repeats.

A painter takes (rng, width_m, height_m, texel_m) and returns grey levels (h, w) float32, row 0 at the top,
as seen by somebody who faces the surface.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
Painter = Callable[[np.random.Generator, float, float, float], Image]

LETTERS = "ABCDEFGHIJKLMNOPRSTUVWXYZ"


def fractal(
    rng: np.random.Generator,
    shape: tuple[int, int],
    texel_m: float,
    coarsest_m: float = 1.0,
    slope: float = 0.7,
    stretch: float = 1.0,
) -> Image:
    """Multi-octave noise of unit standard deviation: an octave of cell size s has amplitude s**slope.

    `stretch` > 1 draws the cells out along x (wood grain).
    """
    h, w = shape
    out = np.zeros(shape, np.float32)
    cell = coarsest_m
    while cell >= 1.5 * texel_m:
        cells = (
            max(2, round(h * texel_m / cell)) + 3,
            max(2, round(w * texel_m / (cell * stretch))) + 3,
        )
        grid = rng.standard_normal(cells).astype(np.float32)
        out += cell**slope * cv2.resize(grid, (w, h), interpolation=cv2.INTER_CUBIC)
        cell /= 2
    out -= out.mean()
    return out / max(float(out.std()), 1e-6)


class Canvas:
    """Grey image that is drawn on in metres; the origin is its top left corner."""

    def __init__(self, rng: np.random.Generator, width_m: float, height_m: float, texel_m: float, base: float):
        self.rng, self.width_m, self.height_m = rng, width_m, height_m
        shape = (max(8, round(height_m / texel_m)), max(8, round(width_m / texel_m)))
        self.texel_m = texel_m
        self.img = np.full(shape, base, np.float32)

    def _px(self, *xy: float) -> tuple[int, ...]:
        return tuple(round(v / self.texel_m) for v in xy)

    def clouds(self, amplitude: float, coarsest_m: float = 1.0, slope: float = 0.7, stretch: float = 1.0) -> None:
        """Add fractal noise."""
        self.img += amplitude * fractal(self.rng, self.img.shape, self.texel_m, coarsest_m, slope, stretch)

    def rectangle(self, x: float, y: float, w: float, h: float, grey: float) -> None:
        """Fill an axis-parallel rectangle."""
        x0, y0, x1, y1 = self._px(x, y, x + w, y + h)
        self.img[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = grey

    def shade(self, x: float, y: float, w: float, h: float, amount: float) -> None:
        """Add a grey step to a rectangle, keeping what is under it."""
        x0, y0, x1, y1 = self._px(x, y, x + w, y + h)
        self.img[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] += amount

    def polygon(self, points_m: NDArray[np.float64], grey: float) -> None:
        """Fill a polygon (n, 2)."""
        cv2.fillPoly(self.img, [np.round(points_m / self.texel_m).astype(np.int32)], float(grey))

    def blob(self, x: float, y: float, radius_m: float, amount: float) -> None:
        """Add an irregular stain with a firm rim."""
        r = max(2, round(radius_m / self.texel_m))
        cx, cy = self._px(x, y)
        y0, y1 = max(cy - r, 0), min(cy + r + 1, self.img.shape[0])
        x0, x1 = max(cx - r, 0), min(cx + r + 1, self.img.shape[1])
        if y1 <= y0 or x1 <= x0:
            return
        yy, xx = np.mgrid[y0 - cy : y1 - cy, x0 - cx : x1 - cx] / r
        angle = np.arctan2(yy, xx)
        rim = 0.75 + sum(
            self.rng.normal(0, 0.12 / k) * np.cos(k * angle + self.rng.uniform(0, 6.28)) for k in range(1, 6)
        )
        self.img[y0:y1, x0:x1] += (amount * np.clip((rim - np.hypot(xx, yy)) * r / 2, 0, 1)).astype(np.float32)

    def scratch(self, length_m: float, amount: float, width_m: float) -> None:
        """A wandering line: crack, cable or scratch."""
        n = 24
        heading = self.rng.uniform(0, 6.28) + np.cumsum(self.rng.normal(0, 0.25, n))
        steps = length_m / n * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        start = self.rng.uniform((0, 0), (self.width_m, self.height_m))
        points = np.round((start + np.cumsum(steps, axis=0)) / self.texel_m).astype(np.int32)
        level = float(np.clip(self.img.mean() + amount, 10, 240))
        cv2.polylines(self.img, [points], False, level, max(1, round(width_m / self.texel_m)))

    def text(self, x: float, y: float, height_m: float, words: str, grey: float, stroke: float = 0.14) -> None:
        """Capital letters `height_m` high whose base line starts at (x, y)."""
        height_px = height_m / self.texel_m
        column, row = self._px(x, y)
        top, pad = max(row - round(1.4 * height_px), 0), max(1, round(0.4 * height_px))
        band = self.img[top : row + pad]
        ink = np.zeros(band.shape, np.uint8)
        font = int(self.rng.choice([cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_TRIPLEX]))
        thick = max(1, round(height_px * stroke))
        cv2.putText(ink, words, (column, row - top), font, height_px / 21, 255, thick, cv2.LINE_AA)
        band += (grey - band) * (ink / np.float32(255))

    def words(self, n: int) -> str:
        """Random capital letters with gaps."""
        return "".join(self.rng.choice(list(LETTERS + "   "), n))

    def finish(self, grain: float = 2.5) -> Image:
        """Soften the drawn edges to what the texels can carry and add the finest grain."""
        soft = cv2.GaussianBlur(self.img, (0, 0), 0.7)
        soft += grain * self.rng.standard_normal(soft.shape, dtype=np.float32)
        return np.clip(soft, 6, 246).astype(np.float32)


def _picture(c: Canvas, x: float, y: float, w: float, h: float) -> None:
    """A framed picture or notice on a wall, with a soft shadow."""
    rng = c.rng
    c.shade(x + 0.015, y + 0.02, w, h, -28)
    frame, paper = rng.uniform(25, 70), rng.uniform(175, 225)
    c.rectangle(x, y, w, h, frame)
    m = 0.03
    c.rectangle(x + m, y + m, w - 2 * m, h - 2 * m, paper)
    if rng.random() < 0.5:  # a composition of shapes
        for _ in range(14):
            centre = rng.uniform((x + 0.08, y + 0.08), (x + w - 0.08, y + h - 0.08))
            room = min(centre[0] - x, x + w - centre[0], centre[1] - y, y + h - centre[1]) - m
            corners = rng.integers(3, 7)
            angles = np.sort(rng.uniform(0, 6.28, corners))
            radius = rng.uniform(0.3, 1.0, corners) * min(room, 0.22)
            c.polygon(
                centre + radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1), rng.uniform(30, 230)
            )
    else:  # a printed notice
        size = rng.uniform(0.05, 0.09)
        c.text(x + 0.06, y + 0.06 + size, size, c.words(int((w - 0.12) / size / 0.95)), 35)
        row = y + 0.11 + 2 * size
        while row < y + h - 0.06:
            small = rng.uniform(0.018, 0.035)
            c.text(x + 0.06, row, small, c.words(int((w - 0.12) / small / 0.95)), rng.uniform(40, 90))
            row += 1.75 * small


def wall(pictures: int, base: float = 152.0) -> Painter:
    """Painted plaster: clouds, patches, stains, cracks, a skirting board and pictures."""

    def paint(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
        c = Canvas(rng, w, h, texel, base)
        c.clouds(11, coarsest_m=1.6, slope=0.55)
        for _ in range(int(9 * w * h)):
            c.blob(*rng.uniform((0, 0), (w, h)), radius_m=rng.gamma(1.5, 0.03), amount=rng.normal(0, 20))
        for _ in range(int(55 * w * h)):  # pits and chips of the plaster
            c.blob(*rng.uniform((0, 0), (w, h)), radius_m=rng.gamma(2.0, 0.005), amount=rng.normal(-12, 30))
        for _ in range(int(1.6 * w * h)):
            c.scratch(rng.uniform(0.15, 0.9), rng.normal(-10, 34), rng.uniform(0.003, 0.009))
        placed: list[tuple[float, float, float, float]] = []
        for _ in range(60):
            pw, ph = rng.uniform(0.35, 0.95), rng.uniform(0.35, 0.8)
            x, y = rng.uniform(0.1, w - pw - 0.1), rng.uniform(0.35, max(0.4, h - ph - 0.7))
            free = all(
                x > a + aw + 0.1 or a > x + pw + 0.1 or y > b + bh + 0.1 or b > y + ph + 0.1 for a, b, aw, bh in placed
            )
            if free and len(placed) < pictures:
                placed.append((x, y, pw, ph))
                _picture(c, x, y, pw, ph)
        c.rectangle(0, h - 0.11, w, 0.11, 78)
        c.rectangle(0, h - 0.118, w, 0.012, 190)
        return c.finish()

    return paint


def bare_wall(posters: int, base: float = 188.0) -> Painter:
    """White paint with next to no structure, and a few notices on it."""

    def paint(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
        c = Canvas(rng, w, h, texel, base)
        c.clouds(1.5, coarsest_m=1.6, slope=0.9)
        for x in np.sort(rng.uniform(0.2, max(0.3, w - 0.9), posters)):
            _picture(c, float(x), rng.uniform(0.5, max(0.6, h - 1.4)), rng.uniform(0.4, 0.7), rng.uniform(0.4, 0.7))
        return c.finish(grain=0.8)

    return paint


def ground(base: float = 105.0, contrast: float = 14.0) -> Painter:
    """Open ground or a facade far away: noise of all sizes up to metres, patches, nothing drawn by hand."""

    def paint(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
        c = Canvas(rng, w, h, texel, base)
        c.clouds(contrast, coarsest_m=4.0, slope=0.35)
        for _ in range(int(0.25 * w * h)):
            x, y = rng.uniform((0, 0), (w, h))
            c.shade(x, y, rng.gamma(2, 0.5), rng.gamma(2, 0.4), rng.normal(0, 1.6 * contrast))
        return c.finish()

    return paint


def bricks(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
    """Rough masonry: courses and stones of uneven size, each its own shade, worn."""
    c = Canvas(rng, w, h, texel, 168)
    y = 0.0
    while y < h:
        course = rng.uniform(0.07, 0.15)
        x = -rng.uniform(0, 0.2)
        while x < w:
            stone = rng.uniform(0.12, 0.42)
            inset = rng.uniform(0.004, 0.009, 4)
            corners = np.array(
                [
                    (x + inset[0], y + inset[1]),
                    (x + stone - inset[2], y + inset[1] + rng.normal(0, 0.004)),
                    (x + stone - inset[2], y + course - inset[3]),
                    (x + inset[0], y + course - inset[3] + rng.normal(0, 0.004)),
                ]
            )
            c.polygon(corners, np.clip(rng.normal(108, 26), 40, 190))
            x += stone
        y += course
    c.clouds(10, coarsest_m=0.5, slope=0.4)
    for _ in range(int(9 * w * h)):
        c.blob(*rng.uniform((0, 0), (w, h)), radius_m=rng.gamma(1.5, 0.02), amount=rng.normal(0, 24))
    return c.finish()


def planks(base: float = 118.0, plank_m: float = 0.14, spread: float = 17.0) -> Painter:
    """Wooden boards along x: grain, knots, joints, scratches."""

    def paint(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
        c = Canvas(rng, w, h, texel, base)
        c.clouds(9, coarsest_m=0.06, slope=0.35, stretch=14)
        c.clouds(7, coarsest_m=0.9, slope=0.6)
        y = 0.0
        while y < h:
            x, board = -rng.uniform(0, 1.2), plank_m * rng.uniform(0.8, 1.2)
            while x < w:
                length = rng.uniform(0.5, 1.9)
                c.shade(x, y, length, board, rng.normal(0, spread))
                c.shade(x, y, 0.006, board, -55)
                for _ in range(rng.poisson(1.2)):
                    knot = rng.uniform((x, y + 0.02), (x + length, y + board))
                    c.blob(*knot, radius_m=rng.uniform(0.008, 0.024), amount=-rng.uniform(25, 60))
                x += length
            c.shade(0, y, w, 0.006, -50)
            y += board
        for _ in range(int(2 * w * h)):
            c.scratch(rng.uniform(0.1, 0.5), rng.normal(20, 25), 0.004)
        return c.finish()

    return paint


def ceiling(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
    """Acoustic panels with faint shades, stains and bright lamps."""
    c = Canvas(rng, w, h, texel, 186)
    c.clouds(5, coarsest_m=1.2, slope=0.5)
    for i in range(int(w / 0.6) + 1):
        for j in range(int(h / 0.6) + 1):
            c.shade(0.6 * i, 0.6 * j, 0.6, 0.6, rng.normal(0, 6))
            if rng.random() < 0.14:
                c.rectangle(0.6 * i + 0.05, 0.6 * j + 0.05, 0.5, 0.5, 238)
    for i in range(int(w / 0.6) + 1):
        c.shade(0.6 * i, 0, 0.012, h, -48)
    for j in range(int(h / 0.6) + 1):
        c.shade(0, 0.6 * j, w, 0.012, -48)
    for _ in range(int(10 * w * h)):
        c.blob(*rng.uniform((0, 0), (w, h)), radius_m=rng.gamma(1.5, 0.018), amount=rng.normal(-12, 12))
    return c.finish(1.5)


def books(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
    """Shelves with books of uneven width, height and shade, and gaps."""
    c = Canvas(rng, w, h, texel, 30)
    shelves = max(1, round(h / 0.34))
    step = h / shelves
    for shelf in range(shelves):
        floor = (shelf + 1) * step - 0.025
        x = 0.03
        while x < w - 0.03:
            thick = float(np.clip(rng.gamma(5, 0.008), 0.015, w - 0.03 - x))
            if rng.random() < 0.09:
                x += rng.uniform(0.05, 0.16)
                continue
            tall = rng.uniform(0.55, 0.9) * step
            cover = float(np.clip(rng.normal(120, 52), 35, 225))
            c.rectangle(x, floor - tall, thick - 0.003, tall, cover)
            ink = 225 if cover < 115 else 45
            for band in rng.uniform(0.05, 0.9, rng.integers(1, 4)):
                c.rectangle(x, floor - tall * band, thick - 0.003, rng.uniform(0.005, 0.02), ink)
            for mark in np.arange(floor - 0.75 * tall, floor - 0.3 * tall, 0.022):
                c.rectangle(x + 0.3 * thick, mark, 0.4 * thick * rng.uniform(0.2, 1), 0.012, ink)
            x += thick
        c.rectangle(0, floor, w, 0.025, 142)
    c.rectangle(0, 0, w, 0.025, 142)
    c.rectangle(0, 0, 0.03, h, 134)
    c.rectangle(w - 0.03, 0, 0.03, h, 134)
    c.clouds(4, coarsest_m=0.3, slope=0.3)
    return c.finish()


def crate(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
    """Rough boards in a frame, with nails and a stencilled mark."""
    c = Canvas(rng, w, h, texel, 128)
    c.img = planks(rng.uniform(105, 150), 0.09, 14)(rng, w, h, texel)
    edge = min(0.07, 0.14 * min(w, h))
    for x, y, bw, bh in ((0, 0, w, edge), (0, h - edge, w, edge), (0, 0, edge, h), (w - edge, 0, edge, h)):
        c.shade(x, y, bw, bh, rng.normal(26, 8))
        for _ in range(3):
            c.blob(x + rng.uniform(0, bw), y + rng.uniform(0, bh), 0.008, -80)
    size = min(0.11, h / 5, w / 5)
    for row in range(int(rng.integers(1, 4))):
        start = edge + 0.03 + rng.uniform(0, 0.05)
        count = max(2, int((w - 2 * edge - 0.1) / size / 0.95))
        c.text(start, edge + (1.6 + 1.45 * row) * size, size, c.words(count), 38)
    return c.finish()


def carton(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
    """Cardboard: adhesive tape, a label with a bar code, dents."""
    c = Canvas(rng, w, h, texel, rng.uniform(128, 165))
    c.clouds(8, coarsest_m=0.4, slope=0.5)
    c.shade(0, (0.42 + 0.1 * rng.random()) * h, w, 0.05, 32)
    lw, lh = min(0.28, 0.6 * w), min(0.18, 0.45 * h)
    x, y = rng.uniform(0.04, max(0.05, w - lw - 0.04)), rng.uniform(0.04, max(0.05, h - lh - 0.04))
    c.rectangle(x, y, lw, lh, 222)
    bar = x + 0.02
    while bar < x + 0.55 * lw:
        thick = rng.uniform(0.004, 0.012)
        c.rectangle(bar, y + 0.5 * lh, thick, 0.4 * lh, 25)
        bar += thick + rng.uniform(0.004, 0.012)
    c.text(x + 0.015, y + 0.38 * lh, 0.24 * lh, c.words(max(2, int(lw / lh / 0.24) - 2)), 40)
    size = min(0.09, 0.2 * h)
    c.text(0.05, h - 0.06, size, c.words(max(2, int((w - 0.1) / size / 0.95))), 60)
    for _ in range(int(14 * w * h) + 3):
        c.blob(*rng.uniform((0, 0), (w, h)), radius_m=rng.gamma(1.5, 0.02), amount=rng.normal(0, 24))
        c.scratch(rng.uniform(0.05, 0.3), rng.normal(-15, 30), 0.004)
    return c.finish()


def cabinet(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
    """Drawers and doors with handles, labels and stickers."""
    c = Canvas(rng, w, h, texel, rng.uniform(150, 195))
    c.clouds(6, coarsest_m=0.8, slope=0.6)
    y = 0.02
    while y < h - 0.1:
        dh = float(np.clip(rng.uniform(0.15, 0.4), 0.1, h - y))
        x = 0.02
        while x < w - 0.1:
            dw = float(np.clip(rng.uniform(0.3, 0.7), 0.1, w - x))
            c.shade(x, y, dw - 0.015, dh - 0.015, rng.normal(0, 14))
            c.shade(x, y + dh - 0.022, dw - 0.015, 0.01, -60)
            c.shade(x + dw - 0.022, y, 0.01, dh - 0.015, -50)
            c.rectangle(x + 0.4 * dw, y + 0.3 * dh, 0.14 * dw, 0.02, 45)
            if rng.random() < 0.7:
                sx, sy = x + rng.uniform(0.05, 0.6) * dw, y + rng.uniform(0.4, 0.6) * dh
                c.rectangle(sx, sy, 0.13, 0.055, 230)
                c.text(sx + 0.01, sy + 0.042, 0.028, c.words(4), 30)
            x += dw
        y += dh
    for _ in range(int(12 * w * h)):
        c.blob(*rng.uniform((0, 0), (w, h)), radius_m=rng.gamma(1.5, 0.014), amount=rng.normal(-6, 22))
    return c.finish()


def fabric(base: float = 95.0) -> Painter:
    """Upholstery or carpet: strewn patches of many sizes over a coarse weave."""

    def paint(rng: np.random.Generator, w: float, h: float, texel: float) -> Image:
        c = Canvas(rng, w, h, texel, base)
        c.clouds(7, coarsest_m=0.5, slope=0.4)
        for _ in range(int(90 * w * h)):
            x, y = rng.uniform((0, 0), (w, h))
            angles = np.sort(rng.uniform(0, 6.28, rng.integers(3, 8)))
            radius = rng.gamma(2, 0.016) * rng.uniform(0.5, 1, len(angles))
            c.polygon(
                np.array([x, y]) + radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1),
                np.clip(rng.normal(base + 15, 38), 20, 230),
            )
        return c.finish(3.5)

    return paint
