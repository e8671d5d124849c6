"""Charts as inline SVG: axes, lines, bands and points.

Colours are CSS classes, so that one chart serves light mode, dark mode and print. A chart is drawn once, when the
page is written; the script in the page only reads the points back to show the values under the pointer. Long series
are thinned for drawing; the extremes of each bin are kept.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from ..geometry.se3 import Array
from .methods import LABELS

SMOOTHED = "mean over 5 frames"  # what `smoothed` draws
WIDTH, HEIGHT = 480, 270
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 12, 12, 40
MAX_POINTS = 500
EXPLAINED = frozenset({"ground truth", *LABELS.values()})


@dataclass(frozen=True, slots=True)
class Series:
    """One line of a chart; NaN breaks it.

    `style` is its CSS class; `band` (2, n) are the low and high edge of a shaded area around it; `dots` marks each
    point.
    """

    name: str
    x: NDArray[Any]
    y: NDArray[Any]
    style: str
    band: Array | None = None
    dots: bool = False


@dataclass(frozen=True, slots=True)
class Chart:
    """One chart: `levels` (y, text) are horizontal reference lines, `marks` (x) vertical ones."""

    title: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    note: str = ""
    log_x: bool = False
    log_y: bool = False
    equal: bool = False  # the same scale on both axes
    zero: bool = False  # y begins at zero
    levels: Sequence[tuple[float, str]] = ()
    marks: Sequence[float] = ()
    explained: frozenset[str] = EXPLAINED  # names whose lines the page explains once, for all charts
    width: int = WIDTH
    height: int = HEIGHT
    flip_y: bool = False


def thinned(x: NDArray[Any], y: NDArray[Any], most: int = MAX_POINTS) -> NDArray[np.intp]:
    """Indices of about `most` points at most, with the extremes of each bin, both ends and all breaks (NaN)."""
    n = len(x)
    if n <= most:
        return np.arange(n)
    keep = {0, n - 1}
    for part in np.array_split(np.arange(n), max(1, most // 2)):
        values = y[part]
        finite = np.isfinite(values)
        if not finite.all():
            keep.add(int(part[np.argmin(finite)]))
        if finite.any():
            keep |= {int(part[np.nanargmin(values)]), int(part[np.nanargmax(values)])}
    return np.array(sorted(keep))


def smoothed(y: NDArray[Any], frames: int = 5) -> Array:
    """The running mean over some frames; short series are returned as they are, NaN is left out."""
    if len(y) < 3 * frames:
        return y
    good = np.isfinite(y)
    kernel = np.ones(frames)
    weight = np.convolve(good, kernel, "same")
    total = np.convolve(np.where(good, y, 0.0), kernel, "same")
    return np.where(weight > 0, total / np.maximum(weight, 1), np.nan)


class _Axis:
    """Maps data to pixels on one axis, and chooses ticks at round values."""

    def __init__(self, values: Array, log: bool, low_px: float, high_px: float, zero: bool, pad: float) -> None:
        values = values[np.isfinite(values)]
        self.log = log
        if log:
            values = values[values > 0]
        if not len(values):
            values = np.array([1.0, 10.0]) if log else np.array([0.0, 1.0])
        low, high = float(values.min()), float(values.max())
        if zero and not log:
            low, high = min(low, 0.0), max(high, 0.0)
        if log:
            low, high = math.log10(low), math.log10(high)
        if high - low < 1e-12 * max(1.0, abs(high)):
            low, high = low - 0.5 * (abs(low) or 1) * (not zero or log), high + 0.5 * (abs(high) or 1)
        extra = pad * (high - low)
        self.low = low if zero and low == 0 else low - extra
        self.high = high + extra
        self.low_px, self.high_px = low_px, high_px

    def px(self, values: Array) -> Array:
        v = np.asarray(values, float)
        if self.log:
            with np.errstate(divide="ignore", invalid="ignore"):
                v = np.where(v > 0, np.log10(v), np.nan)
        return self.low_px + (v - self.low) / (self.high - self.low) * (self.high_px - self.low_px)

    def ticks(self, most: int = 6) -> list[tuple[float, str]]:
        if self.log:
            return self._log_ticks(most)
        step = _nice((self.high - self.low) / most)
        first = math.ceil(self.low / step - 1e-9)
        values = [k * step for k in range(first, math.floor(self.high / step + 1e-9) + 1)]
        digits = max(0, -math.floor(math.log10(step) + 1e-9))
        if self.high - self.low < 1e-4 or max(abs(self.low), abs(self.high)) >= 1e6:
            return [(v, f"{v:.2g}") for v in values]
        return [(v, f"{v:.{digits}f}".replace("-", "−")) for v in values]

    def _log_ticks(self, most: int) -> list[tuple[float, str]]:
        decades = range(math.floor(self.low), math.ceil(self.high) + 1)
        for digits in ((1,), (1, 2, 5), tuple(range(1, 10))):
            found = [m * 10.0**k for k in decades for m in digits if self.low <= k + math.log10(m) <= self.high]
            if len(found) >= 3:
                break
        else:  # less than a third of a decade: round values
            low, high = 10**self.low, 10**self.high
            step = _nice((high - low) / 4)
            found = [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
        return [(v, f"{v:.4g}") for v in found[:: max(1, math.ceil(len(found) / most))]]


def round_numbers(last: int, most: int) -> list[int]:
    """Whole numbers from 0 to `last` at most, at a round distance, about `most` of them."""
    step = max(1, round(_nice(max(last, 1) / most)))
    return list(range(0, last + 1, step))


def _nice(step: float) -> float:
    base = 10.0 ** math.floor(math.log10(step))
    return next(m * base for m in (1, 2, 5, 10) if m * base >= step * (1 - 1e-9))


def draw(chart: Chart) -> Markup:
    """A `<figure>` with the chart, or with a sentence where there is no data."""
    usable = [s for s in chart.series if np.isfinite(np.asarray(s.y, float)).any()]
    head = Markup("<figcaption><b>{}</b>{}</figcaption>").format(
        chart.title, Markup(" <span>{}</span>").format(chart.note) if chart.note else ""
    )
    if not usable:
        return Markup('<figure class="chart">{}<p class="none">No data.</p></figure>').format(head)
    width, height = chart.width, chart.height
    xs = np.concatenate([np.asarray(s.x, float) for s in usable])
    ys = np.concatenate(
        [np.asarray(s.y, float) for s in usable]
        + [np.asarray(s.band, float).ravel() for s in usable if s.band is not None]
        + [np.array([v for v, _ in chart.levels])]
    )
    ax = _Axis(xs, chart.log_x, _LEFT, width - _RIGHT, False, 0.03 if chart.log_x else 0.01)
    bottom, top = height - _BOTTOM, _TOP
    ay = _Axis(ys, chart.log_y, *((top, bottom) if chart.flip_y else (bottom, top)), chart.zero, 0.05)
    if chart.equal:
        _equalise(ax, ay)
    parts = [_frame(chart, ax, ay, width, height)]
    for s in usable:
        parts.append(_series(s, ax, ay))
    scale = f"{ax.low:.9g},{ax.high:.9g},{int(ax.log)},{ay.low:.9g},{ay.high:.9g},{int(ay.log)},{int(chart.flip_y)}"
    svg = Markup(
        '<svg viewBox="0 0 {} {}" role="img" aria-label="{}" data-scale="{}" data-box="{},{},{},{}">{}</svg>'
    ).format(width, height, chart.title, scale, _LEFT, width - _RIGHT, top, bottom, Markup("").join(parts))
    known = all(s.name in chart.explained for s in usable)
    legend = _legend(usable) if len(usable) > 1 and not known else ""
    return Markup('<figure class="chart">{}{}{}</figure>').format(head, legend, svg)


def _equalise(ax: _Axis, ay: _Axis) -> None:
    per_px = max((ax.high - ax.low) / abs(ax.high_px - ax.low_px), (ay.high - ay.low) / abs(ay.high_px - ay.low_px))
    for axis in (ax, ay):
        middle, half = (axis.low + axis.high) / 2, per_px * abs(axis.high_px - axis.low_px) / 2
        axis.low, axis.high = middle - half, middle + half


def _frame(chart: Chart, ax: _Axis, ay: _Axis, width: int, height: int) -> Markup:
    bottom = height - _BOTTOM
    out = []
    for value, text in ay.ticks(5):
        y = float(ay.px(np.array(value)))
        out.append(f'<path class="grid" d="M{_LEFT} {y:.1f}H{width - _RIGHT}"/>')
        out.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" class="tick end">{escape(text)}</text>')
    for value, text in ax.ticks(7):
        x = float(ax.px(np.array(value)))
        out.append(f'<path class="tickmark" d="M{x:.1f} {bottom}v4"/>')
        out.append(f'<text x="{x:.1f}" y="{bottom + 17}" class="tick mid">{escape(text)}</text>')
    for value in chart.marks:
        x = float(ax.px(np.array(value)))
        out.append(f'<path class="mark" d="M{x:.1f} {_TOP}V{bottom}"/>')
    for value, text in chart.levels:
        y = float(ay.px(np.array(value)))
        out.append(f'<path class="level" d="M{_LEFT} {y:.1f}H{width - _RIGHT}"/>')
        out.append(f'<text x="{width - _RIGHT - 3}" y="{y - 4:.1f}" class="tick end">{escape(text)}</text>')
    out.append(f'<path class="axis" d="M{_LEFT} {bottom}H{width - _RIGHT}"/>')
    middle = (_LEFT + width - _RIGHT) / 2
    x_label, y_label = (
        f"{text} (logarithmic)" if log else text
        for text, log in ((chart.x_label, chart.log_x), (chart.y_label, chart.log_y))
    )
    out.append(f'<text x="{middle:.0f}" y="{height - 5}" class="label mid">{escape(x_label)}</text>')
    turn = (_TOP + bottom) / 2
    out.append(
        f'<text x="12" y="{turn:.0f}" transform="rotate(-90 12 {turn:.0f})" class="label mid">'
        f"{escape(y_label)}</text>"
    )
    return Markup("".join(out))


def _series(s: Series, ax: _Axis, ay: _Axis) -> Markup:
    x, y = np.asarray(s.x, float), np.asarray(s.y, float)
    rows = thinned(x, y)
    px, py = ax.px(x[rows]), ay.px(y[rows])
    out = []
    if s.band is not None:
        low, high = (ay.px(np.asarray(b, float)[rows]) for b in s.band)
        for part in _runs(px, low, high):
            forth = _points(px[part], high[part])
            back = _points(px[part][::-1], low[part][::-1])
            out.append(f'<polygon class="band {s.style}" points="{forth} {back}"/>')
    for part in _runs(px, py):
        if len(part) == 1 or s.dots:
            out += [f'<circle class="dot {s.style}" cx="{px[i]:.1f}" cy="{py[i]:.1f}" r="3"/>' for i in part]
        if len(part) > 1:
            out.append(f'<polyline class="line {s.style}" points="{_points(px[part], py[part])}"/>')
    return Markup('<g data-name="{}">{}</g>').format(s.name, Markup("".join(out)))


def _runs(*columns: Array) -> list[Array]:
    finite = np.logical_and.reduce([np.isfinite(c) for c in columns])
    rows = np.flatnonzero(finite)
    return np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(rows) else []


def _points(px: Array, py: Array) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py, strict=True))


def _legend(series: Sequence[Series]) -> Markup:
    items = [
        Markup(
            '<span class="key"><svg viewBox="0 0 26 10"><path class="line {}" d="M1 5H25"/></svg>{}</span>'
        ).format(s.style, s.name)
        for s in series
    ]
    return Markup('<div class="legend">{}</div>').format(Markup("").join(items))
