"""Charts as inline SVG, drawn by matplotlib: lines, values with intervals, and the lives of tracks.

Colours are CSS variables of page.css, so that one chart serves light mode, dark mode and print: matplotlib draws
with placeholder colours. It is imported when a page is drawn.
"""

import io
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ..record import record

_WIDTH_PX, _HEIGHT_PX, _TEXT_PX = 480, 280, 13  # a phone shows them at two thirds of this size
_VARIABLES = (*(f"c{k}" for k in range(1, 11)), "other", "truth", "soft", "axis", "line", "ok", "lost", "card")
_COLOUR = {name: f"#1234{k:02x}" for k, name in enumerate(_VARIABLES)}


@record
class Series:
    """One line of a chart; NaN breaks it. `colour`: a variable of page.css; `dots` marks each point.

    `band`: the lower and the upper end of its shaded interval.
    """

    name: str
    x: NDArray[Any]
    y: NDArray[Any]
    colour: str
    dots: bool = False
    band: tuple[NDArray[Any], NDArray[Any]] | None = None


@record
class Chart:
    """One chart: `marks` (x) are vertical lines; `expected` is the shaded range of y in which values should be.

    On a `path` both axes have the same scale, and start and end of the first series are marked. `slopes`: those of thin
    lines through the smallest value at the first x, on logarithmic axes.
    """

    title: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    note: str = ""
    log_x: bool = False
    log_y: bool = False
    path: bool = False
    zero: bool = False  # the y axis starts at zero
    expected: tuple[float, float] | None = None
    marks: Sequence[float] = ()
    slopes: Sequence[float] = ()


class Row(NamedTuple):
    """A value with its interval, and its name on the left."""

    name: str
    value: float
    low: float
    high: float
    colour: str


def draw(chart: Chart) -> Markup:
    """Return a `<figure>` with the chart and the names of its lines, or with a sentence if there is no data."""
    usable = [(s, drawn) for s in chart.series if (drawn := _drawn(chart, s)).any()]
    if not usable:
        return figure(chart.title, chart.note, Markup('<p class="none">No data.</p>'))
    canvas, axes = _axes(chart.x_label, chart.y_label, (chart.log_x, chart.log_y))
    if chart.expected is not None:
        axes.axhspan(*chart.expected, color=_COLOUR["ok"], alpha=0.16, lw=0)
    for x in chart.marks:
        axes.axvline(x, color=_COLOUR["lost"], lw=1, ls=":")
    for s, drawn in usable:
        marker = "o" if s.dots or drawn.sum() == 1 else ""
        axes.plot(s.x, s.y, color=_COLOUR[s.colour], lw=3.0 if s.colour == "truth" else 1.8, marker=marker, ms=5)
    _add_bands_and_slopes(axes, chart, [s for s, _ in usable])
    if chart.zero and not chart.log_y:
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    if chart.path:
        axes.set_aspect("equal", adjustable="datalim")
        s, drawn = usable[0]
        for k, fill in zip(np.flatnonzero(drawn)[[0, -1]], ("truth", "card"), strict=True):
            axes.plot([s.x[k]], [s.y[k]], "o", ms=9, mfc=_COLOUR[fill], mec=_COLOUR["truth"], mew=2)
    names = [(s.name, s.colour) for s, _ in usable] if len(usable) > 1 else []
    return figure(chart.title, chart.note, _svg(canvas, chart.title), names)


def _add_bands_and_slopes(axes: Any, chart: Chart, series: Sequence[Series]) -> None:
    """Draw them without changing the visible part of the plane."""
    limits = axes.get_xlim(), axes.get_ylim()
    for s in series:
        if s.band is not None:
            axes.fill_between(s.x, *s.band, color=_COLOUR[s.colour], alpha=0.12, lw=0)
    for slope in chart.slopes:
        x, y = np.asarray(series[0].x, float), min(float(np.nanmin(s.y)) for s in series)
        ends = np.array([x[0], x[-1]])
        axes.plot(ends, y * (ends / ends[0]) ** slope, color=_COLOUR["axis"], lw=0.8, ls="--")
    if chart.slopes or any(s.band is not None for s in series):
        axes.set(xlim=limits[0], ylim=limits[1])


def intervals(title: str, x_label: str, rows: Sequence[Row], note: str = "") -> Markup:
    """Return a `<figure>` with a value and its interval in each row, on a logarithmic axis; the line is at 1."""
    canvas, axes = _axes(x_label, "", (True, False), height_px=max(_HEIGHT_PX, 60 + 20 * len(rows)))
    axes.axvline(1.0, color=_COLOUR["axis"], lw=1, ls="--")
    for k, row in enumerate(rows):
        axes.plot([row.low, row.high], [k, k], color=_COLOUR[row.colour], lw=1.8)
        axes.plot([row.value], [k], color=_COLOUR[row.colour], marker="o", ms=7)
    axes.set_yticks(range(len(rows)), [row.name for row in rows])
    axes.invert_yaxis()
    axes.grid(False, axis="y")
    for text, row in zip(axes.get_yticklabels(), rows, strict=True):
        text.set(color=_COLOUR[row.colour], weight="bold")
    return figure(title, note, _svg(canvas, title))


def lifetimes(title: str, spans: Sequence[Sequence[int]], note: str) -> Markup:
    """Return a `<figure>` with one line per span [first, last], in order."""
    canvas, axes = _axes("frame", "points, by first frame", (False, False), 2 * _WIDTH_PX)
    x = np.array([[first, max(last, first + 0.15), np.nan] for first, last in spans]).ravel()
    axes.plot(x, np.repeat(np.arange(len(spans)), 3), color=_COLOUR["c1"], lw=max(0.5, min(2.0, 170 / len(spans))))
    axes.invert_yaxis()
    return figure(title, note, _svg(canvas, title), kind="wide")


def needles(title: str, note: str, image: NDArray[Any], groups: Sequence[tuple[str, str, NDArray[Any]]]) -> Markup:
    """Return a `<figure>` with lines on a grey image (h, w), from a dot to their other end.

    `groups`: name, colour, and ends (n, 2, 2) in px of the image, the dot second.
    """
    (height, width), every = image.shape, max(1, round(image.shape[1] / _WIDTH_PX))
    canvas, axes = _axes("", "", (False, False), height_px=round(_WIDTH_PX * height / width))
    canvas.set_layout_engine(None)
    axes.set_position((0, 0, 1, 1))
    axes.set_axis_off()
    rows, columns = height // every, width // every
    small = image[: rows * every, : columns * every].reshape(rows, every, columns, every).mean(axis=(1, 3))
    low, high = np.percentile(small, (1, 99))
    pale = 0.35 + 0.65 * np.clip((small - low) / max(high - low, 1.0), 0, 1)  # needles stand out
    extent = (-0.5, columns * every - 0.5, rows * every - 0.5, -0.5)
    axes.imshow(pale, cmap="gray", vmin=0, vmax=1, extent=extent, interpolation="nearest")
    for _, colour, ends in groups:
        lines = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        axes.plot(*lines.T, color=_COLOUR[colour], lw=1.6)
        axes.plot(*ends[:, 1].T, "o", color=_COLOUR[colour], ms=3.4, mec="none")
    axes.set(xlim=extent[:2], ylim=extent[2:])
    return figure(title, note, _svg(canvas, title), [(name, colour) for name, colour, ends in groups if len(ends)])


def figure(
    title: str, note: str, content: Markup, names: Sequence[tuple[str, str]] = (), kind: str = "chart"
) -> Markup:
    """Return a `<figure>` with title, note, the `names` of lines with their colours, and content."""
    small = Markup(" <span>{}</span>").format(note) if note else ""
    keys = Markup("").join(
        Markup('<span class="key"><i style="background:var(--{})"></i>{}</span>').format(colour, name)
        for name, colour in names
    )
    caption = Markup("<figcaption><b>{}</b>{}</figcaption>").format(title, small)
    legend = Markup('<div class="legend">{}</div>').format(keys) if names else ""
    return Markup('<figure class="{}">{}{}{}</figure>').format(kind, caption, legend, content)


def _drawn(chart: Chart, s: Series) -> NDArray[np.bool_]:
    """Return a mask of the points of a line that can be drawn."""
    x, y = np.asarray(s.x, float), np.asarray(s.y, float)
    return np.isfinite(x) & np.isfinite(y) & ((x > 0) | (not chart.log_x)) & ((y > 0) | (not chart.log_y))


def _axes(
    x_label: str, y_label: str, log: tuple[bool, bool], width_px: int = _WIDTH_PX, height_px: int = _HEIGHT_PX
) -> tuple[Any, Any]:
    """Return a figure with one point per px, and its axes."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(width_px / 72, height_px / 72), dpi=72, layout="constrained")
    axes = canvas.add_subplot()
    axes.set_frame_on(False)
    axes.grid(color=_COLOUR["line"], lw=1)
    axes.set_axisbelow(True)
    axes.tick_params(colors=_COLOUR["soft"], labelsize=_TEXT_PX, length=0, which="both")
    for axis, label, logarithmic in zip((axes.xaxis, axes.yaxis), (x_label, y_label), log, strict=True):
        if logarithmic:
            (axes.set_xscale if axis is axes.xaxis else axes.set_yscale)("log")
        axis.set_label_text(label + " (logarithmic)" * logarithmic, size=_TEXT_PX, color=_COLOUR["soft"])
    return canvas, axes


def _svg(canvas: Any, title: str) -> Markup:
    """Return the figure as SVG with the colours and font of the page; equal figures give equal bytes."""
    from matplotlib import rc_context
    from matplotlib.ticker import LogLocator, MaxNLocator, StrMethodFormatter

    for axis in (canvas.axes[0].xaxis, canvas.axes[0].yaxis):
        if axis.get_scale() == "log":
            low, high = axis.get_view_interval()
            if high < 5 * low:  # it contains no decade
                axis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
            else:  # on a wide one only powers of ten are labelled
                axis.set_major_locator(LogLocator(subs=(1,) if high >= 300 * low else (1, 2, 5), numticks=9))
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axis.set_minor_formatter("")
    file = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "stream_sfm"}):
        canvas.savefig(file, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    box = f"0 0 {canvas.get_figwidth() * 72:.0f} {canvas.get_figheight() * 72:.0f}"
    text = file.getvalue()
    text = text[text.index(">", text.index("<svg")) + 1 :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text)
    text = re.sub(r' id="(figure|axes|patch|line2d|matplotlib|xtick|ytick|text)[^"]*"', "", text)
    for name, colour in _COLOUR.items():
        text = text.replace(colour, f"var(--{name})")
    start = Markup('<svg viewBox="{}" role="img" aria-label="{}">').format(box, title)
    return start + Markup(re.sub(r"\n\s*", "\n", text))
