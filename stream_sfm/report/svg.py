"""Charts as inline SVG: lines with their names at their ends, and rows of values with intervals.

Colours are CSS classes, so that one chart serves light mode, dark mode and print. A chart is drawn once, when the
page is written; the script in the page only reads the points back to show the values under the pointer. Long series
are thinned for drawing; the extremes of each bin are kept.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from ..geometry.se3 import Array

SMOOTHED = "mean over 5 frames"  # what `smoothed` draws
WIDTH, HEIGHT = 480, 270
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 12, 12, 40
MAX_POINTS = 500
_CHARACTER_PX = 6.6  # width of a label's characters, with room for the larger ones on a phone
_LABEL_PX = 13  # height of a label
_ROW_PX = 18  # least height of a row with an interval


@dataclass(frozen=True, slots=True)
class Series:
    """One line of a chart; NaN breaks it.

    `style` is its CSS class; `dots` marks each point; a `quiet` line is named only where there is room.
    """

    name: str
    x: NDArray[Any]
    y: NDArray[Any]
    style: str
    dots: bool = False
    quiet: bool = False


@dataclass(frozen=True, slots=True)
class Chart:
    """One chart: `marks` (x) are vertical lines, `expected` the y between which values should be, shaded.

    On a `path` both axes have the same scale, and the first series has its start and end marked.
    """

    title: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    note: str = ""
    log_x: bool = False
    log_y: bool = False
    path: bool = False
    zero: bool = False  # y begins at zero
    expected: tuple[float, float] | None = None
    marks: Sequence[float] = ()
    height: int = HEIGHT


class Row(NamedTuple):
    """A value with the ends of its interval, named at the left."""

    name: str
    value: float
    low: float
    high: float
    style: str


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
    if not usable:
        return _figure(chart.title, chart.note, Markup('<p class="none">No data.</p>'))
    named = len(usable) > 1
    right = WIDTH - _RIGHT
    if named and not chart.path:
        right -= round(_CHARACTER_PX * max(len(s.name) for s in usable))
    bottom, top = chart.height - _BOTTOM, _TOP
    xs = np.concatenate([np.asarray(s.x, float) for s in usable])
    ys = np.concatenate([*(np.asarray(s.y, float) for s in usable), np.array(chart.expected or ())])
    ax = _Axis(xs, chart.log_x, _LEFT, right, False, 0.03 if chart.log_x else 0.01)
    ay = _Axis(ys, chart.log_y, bottom, top, chart.zero, 0.05)
    if chart.path:
        _equalise(ax, ay)
    parts = [_frame(chart, ax, ay), *(_series(s, ax, ay) for s in usable)]
    if chart.path:
        parts.append(_ends(usable[0], ax, ay))
    if named:
        parts += _names(usable, ax, ay)
    scale = f"{ax.low:.9g},{ax.high:.9g},{int(ax.log)},{ay.low:.9g},{ay.high:.9g},{int(ay.log)}"
    svg = Markup(
        '<svg viewBox="0 0 {} {}" role="img" aria-label="{}" data-scale="{}" data-box="{},{},{},{}">{}</svg>'
    ).format(WIDTH, chart.height, chart.title, scale, _LEFT, right, top, bottom, Markup("").join(parts))
    return _figure(chart.title, chart.note, svg)


def intervals(title: str, x_label: str, rows: Sequence[Row], note: str = "") -> Markup:
    """A `<figure>` with a value and its interval in each row, on a logarithmic axis; the line is at 1."""
    if not rows:
        return _figure(title, note, Markup('<p class="none">No data.</p>'))
    left = round(_CHARACTER_PX * max(len(row.name) for row in rows)) + 12
    bottom = max(_TOP + _ROW_PX * len(rows), HEIGHT - _BOTTOM)
    ends = np.array([[row.low, row.high] for row in rows])
    ax = _Axis(np.append(ends, 1.0), True, left, WIDTH - _RIGHT, False, 0.05)
    step = (bottom - _TOP) / len(rows)
    out = _ticks_below(ax, bottom, x_label)
    at_one = float(ax.px(np.array(1.0)))
    out.append(f'<path class="level" d="M{at_one:.1f} {_TOP}V{bottom}"/>')
    for k, row in enumerate(rows):
        y = _TOP + (k + 0.5) * step
        value, low, high = ax.px(np.array([row.value, row.low, row.high]))
        out.append(f'<text x="{left - 10}" y="{y + 4:.1f}" class="name end {row.style}">{escape(row.name)}</text>')
        out.append(f'<path class="line {row.style}" d="M{low:.1f} {y:.1f}H{high:.1f}"/>')
        out.append(f'<circle class="dot {row.style}" cx="{value:.1f}" cy="{y:.1f}" r="4"/>')
    svg = Markup('<svg viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>')
    return _figure(title, note, svg.format(WIDTH, bottom + _BOTTOM, title, Markup("".join(out))))


def _figure(title: str, note: str, content: Markup) -> Markup:
    small = Markup(" <span>{}</span>").format(note) if note else ""
    return Markup('<figure class="chart"><figcaption><b>{}</b>{}</figcaption>{}</figure>').format(
        title, small, content
    )


def _equalise(ax: _Axis, ay: _Axis) -> None:
    """Give both axes the scale of the one that needs more."""
    per_px = max((ax.high - ax.low) / abs(ax.high_px - ax.low_px), (ay.high - ay.low) / abs(ay.high_px - ay.low_px))
    for axis in (ax, ay):
        middle, half = (axis.low + axis.high) / 2, per_px * abs(axis.high_px - axis.low_px) / 2
        axis.low, axis.high = middle - half, middle + half


def _frame(chart: Chart, ax: _Axis, ay: _Axis) -> Markup:
    left, right, bottom = ax.low_px, ax.high_px, ay.low_px
    out = []
    if chart.expected is not None:
        low, high = ay.px(np.array(chart.expected))
        out.append(
            f'<rect class="expected" x="{left}" y="{high:.1f}" width="{right - left}" height="{low - high:.1f}"/>'
        )
    for value, text in ay.ticks(5):
        y = float(ay.px(np.array(value)))
        out.append(f'<path class="grid" d="M{left} {y:.1f}H{right}"/>')
        out.append(f'<text x="{left - 6}" y="{y + 4:.1f}" class="tick end">{escape(text)}</text>')
    for value in chart.marks:
        x = float(ax.px(np.array(value)))
        out.append(f'<path class="mark" d="M{x:.1f} {_TOP}V{bottom}"/>')
    out += _ticks_below(ax, bottom, _named(chart.x_label, chart.log_x))
    turn = (_TOP + bottom) / 2
    y_label = escape(_named(chart.y_label, chart.log_y))
    out.append(
        f'<text x="12" y="{turn:.0f}" transform="rotate(-90 12 {turn:.0f})" class="label mid">{y_label}</text>'
    )
    return Markup("".join(out))


def _named(label: str, log: bool) -> str:
    return f"{label} (logarithmic)" if log else label


def _ticks_below(ax: _Axis, bottom: float, label: str) -> list[str]:
    """The horizontal axis with its ticks and its label."""
    out = [f'<path class="axis" d="M{ax.low_px} {bottom}H{ax.high_px}"/>']
    for value, text in ax.ticks(7):
        x = float(ax.px(np.array(value)))
        out.append(f'<path class="tickmark" d="M{x:.1f} {bottom}v4"/>')
        out.append(f'<text x="{x:.1f}" y="{bottom + 17}" class="tick mid">{escape(text)}</text>')
    middle = (ax.low_px + ax.high_px) / 2
    out.append(f'<text x="{middle:.0f}" y="{bottom + 35}" class="label mid">{escape(label)}</text>')
    return out


def _series(s: Series, ax: _Axis, ay: _Axis) -> Markup:
    x, y = np.asarray(s.x, float), np.asarray(s.y, float)
    rows = thinned(x, y)
    px, py = ax.px(x[rows]), ay.px(y[rows])
    out = []
    for part in _runs(px, py):
        if len(part) == 1 or s.dots:
            out += [f'<circle class="dot {s.style}" cx="{px[i]:.1f}" cy="{py[i]:.1f}" r="3"/>' for i in part]
        if len(part) > 1:
            out.append(f'<polyline class="line {s.style}" points="{_points(px[part], py[part])}"/>')
    return Markup('<g data-name="{}">{}</g>').format(s.name, Markup("".join(out)))


def _last_point(s: Series, ax: _Axis, ay: _Axis) -> tuple[float, float]:
    """Where a series ends, in pixels."""
    x, y = ax.px(np.asarray(s.x, float)), ay.px(np.asarray(s.y, float))
    row = np.flatnonzero(np.isfinite(x) & np.isfinite(y))[-1]
    return float(x[row]), float(y[row])


def _ends(s: Series, ax: _Axis, ay: _Axis) -> Markup:
    """The start of a path as a dot, its end as a ring."""
    x, y = (np.asarray(v, float) for v in (s.x, s.y))
    first = int(np.flatnonzero(np.isfinite(x) & np.isfinite(y))[0])
    places = {"start": (float(ax.px(x[first])), float(ay.px(y[first]))), "end": _last_point(s, ax, ay)}
    apart = abs(places["start"][1] - places["end"][1]) > _LABEL_PX
    out = []
    for name, (px, py) in places.items():
        below = 18 if name == "end" and not apart else -9
        side, dx = ("", 9) if px < WIDTH / 2 else (" end", -9)
        out.append(f'<circle class="{name}" cx="{px:.1f}" cy="{py:.1f}" r="5"/>')
        out.append(f'<text x="{px + dx:.1f}" y="{py + below:.1f}" class="tick{side}">{name}</text>')
    return Markup("".join(out))


def _names(series: Sequence[Series], ax: _Axis, ay: _Axis) -> list[Markup]:
    """The name of each series beside its end, moved apart where they would overlap; quiet ones where there is room."""
    ends = [(*_last_point(s, ax, ay), s) for s in series]
    loud = sorted((e for e in ends if not e[2].quiet), key=lambda e: e[1])
    top, bottom = min(ay.low_px, ay.high_px), max(ay.low_px, ay.high_px)
    places: list[float] = []
    for _, y, _ in loud:
        places.append(max([y, *(place + _LABEL_PX for place in places[-1:])]))
    for k in reversed(range(len(places))):  # those pushed below the chart come back up
        places[k] = min(places[k], bottom - _LABEL_PX * (len(places) - 1 - k))
    shown = list(zip(loud, places, strict=True))
    for end in ends:
        if end[2].quiet and all(abs(end[1] - y) >= _LABEL_PX for _, y in shown) and top <= end[1] <= bottom:
            shown.append((end, end[1]))
    return [_name(s, x, y) for (x, _, s), y in shown]


def _name(s: Series, x: float, y: float) -> Markup:
    beyond = x + 4 + _CHARACTER_PX * len(s.name) > WIDTH
    side, x = (" end", x - 6) if beyond else ("", x + 4)
    return Markup('<text x="{}" y="{}" class="name {}{}">{}</text>').format(
        f"{x:.1f}", f"{y + 4:.1f}", s.style, side, s.name
    )


def _runs(*columns: Array) -> list[Array]:
    finite = np.logical_and.reduce([np.isfinite(c) for c in columns])
    rows = np.flatnonzero(finite)
    return np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(rows) else []


def _points(px: Array, py: Array) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py, strict=True))
