"""Charts as inline SVG, drawn by matplotlib: lines with their names at their ends, and values with intervals.

Colours are CSS variables of page.css, so that one chart serves light mode, dark mode and print: matplotlib draws in
colours that stand for them. It is imported when a page is drawn.
"""

import io
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ..record import record

WIDTH, HEIGHT = 480, 270
_VARIABLES = ("c1", "c2", "c4", "c6", "other", "truth", "ink", "soft", "axis", "line", "ok", "lost", "card")
_COLOUR = {name: f"#1234{k:02x}" for k, name in enumerate(_VARIABLES)}
_OF_STYLE = {
    "m-cross-frame": "c1", "m-iterated-ekf": "c2", "m-ekf": "c4", "m-frame-to-frame": "c6", "m-truth": "truth",
}  # fmt: skip
_WIDTHS = {"m-cross-frame": 2.6, "m-truth": 3.2, "m-other": 1.2}  # px
_MANY_TICKS = 300  # of the ends of a logarithmic axis: from here on only powers of ten are named
_TEXT_PX, _CHARACTER_PX, _LABEL_PX = 11, 6.6, 13  # size of the text; a label's width per character, and its height


@record
class Series:
    """One line of a chart; NaN breaks it.

    `style` is that of a method, see `methods.py`; `dots` marks each point; a `quiet` line is named only where there is
    room.
    """

    name: str
    x: NDArray[Any]
    y: NDArray[Any]
    style: str
    dots: bool = False
    quiet: bool = False


@record
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


class Row(NamedTuple):
    """A value with the ends of its interval, named at the left."""

    name: str
    value: float
    low: float
    high: float
    style: str


def draw(chart: Chart) -> Markup:
    """A `<figure>` with the chart, or with a sentence where there is no data."""
    usable = [s for s in chart.series if _drawn(chart, s).any()]
    if not usable:
        return figure(chart.title, chart.note, Markup('<p class="none">No data.</p>'))
    canvas, axes = _axes(chart.x_label, chart.y_label, (chart.log_x, chart.log_y))
    if chart.expected is not None:
        axes.axhspan(*chart.expected, color=_COLOUR["ok"], alpha=0.16, lw=0)
    for x in chart.marks:
        axes.axvline(x, color=_COLOUR["lost"], lw=1, ls=":")
    for s in usable:
        colour, marker = _colour(s.style), "o" if s.dots or _drawn(chart, s).sum() == 1 else ""
        axes.plot(s.x, s.y, color=colour, lw=_WIDTHS.get(s.style, 1.8), marker=marker, ms=5)
    if chart.zero and not chart.log_y:
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    if chart.path:
        axes.set_aspect("equal", adjustable="datalim")
    named = len(usable) > 1
    room = 0.0 if chart.path or not named else _CHARACTER_PX * max(len(s.name) for s in usable)
    canvas.subplots_adjust(right=1 - (12 + room) / WIDTH)
    axes.get_xlim(), axes.get_ylim()  # fixes the limits, which depend on nothing that follows
    axes.apply_aspect()
    if chart.path:
        _mark_ends(axes, usable[0], _drawn(chart, usable[0]))
    if named:
        _name_lines(axes, [(s, np.flatnonzero(_drawn(chart, s))[-1]) for s in usable], WIDTH)
    return figure(chart.title, chart.note, _svg(canvas, chart.title))


def intervals(title: str, x_label: str, rows: Sequence[Row], note: str = "") -> Markup:
    """A `<figure>` with a value and its interval in each row, on a logarithmic axis; the line is at 1."""
    if not rows:
        return figure(title, note, Markup('<p class="none">No data.</p>'))
    canvas, axes = _axes(x_label, "", (True, False))
    axes.axvline(1.0, color=_COLOUR["axis"], lw=1, ls="--")
    for k, row in enumerate(rows):
        axes.plot([row.low, row.high], [k, k], color=_colour(row.style), lw=1.8)
        axes.plot([row.value], [k], color=_colour(row.style), marker="o", ms=7)
    axes.set_yticks(range(len(rows)), [row.name for row in rows])
    axes.invert_yaxis()
    axes.grid(False)
    for text, row in zip(axes.get_yticklabels(), rows, strict=True):
        text.set(color=_colour(row.style), weight="bold")
    left = 14 + 1.2 * _CHARACTER_PX * max(len(row.name) for row in rows)
    canvas.subplots_adjust(left=left / WIDTH, right=1 - 12 / WIDTH)
    return figure(title, note, _svg(canvas, title))


def figure(title: str, note: str, content: Markup, kind: str = "chart") -> Markup:
    """A `<figure>` with its title, a note beside it, and what it shows."""
    small = Markup(" <span>{}</span>").format(note) if note else ""
    caption = Markup("<figcaption><b>{}</b>{}</figcaption>").format(title, small)
    return Markup('<figure class="{}">{}{}</figure>').format(kind, caption, content)


def lifetimes(spans: Sequence[Sequence[int]], width: int = 2 * WIDTH) -> Markup:
    """One line per span [first, last], in order."""
    canvas, axes = _axes("frame", "points, by first frame", (False, False), width)
    x = np.array([[first, max(last, first + 0.15), np.nan] for first, last in spans]).ravel()
    axes.plot(x, np.repeat(np.arange(len(spans)), 3), color=_COLOUR["c1"], lw=max(0.5, min(2.0, 170 / len(spans))))
    axes.invert_yaxis()
    canvas.subplots_adjust(left=62 / width, right=1 - 12 / width)
    return _svg(canvas, "Track lifetimes")


def _drawn(chart: Chart, s: Series) -> NDArray[np.bool_]:
    """Which points of a line can be drawn."""
    x, y = np.asarray(s.x, float), np.asarray(s.y, float)
    return np.isfinite(x) & np.isfinite(y) & ((x > 0) | (not chart.log_x)) & ((y > 0) | (not chart.log_y))


def _colour(style: str) -> str:
    return _COLOUR[_OF_STYLE.get(style, "other")]


def _axes(x_label: str, y_label: str, log: tuple[bool, bool], width: int = WIDTH) -> tuple[Any, Any]:
    """A figure of one point per px, and its axes."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(width / 72, HEIGHT / 72), dpi=72)
    canvas.subplots_adjust(left=62 / width, bottom=44 / HEIGHT, top=1 - 10 / HEIGHT)
    axes = canvas.add_subplot()
    axes.set_frame_on(False)
    axes.patch.set_visible(False)
    axes.grid(color=_COLOUR["line"], lw=1)
    axes.set_axisbelow(True)
    axes.tick_params(colors=_COLOUR["soft"], labelsize=_TEXT_PX, length=0, which="both")
    for axis, label, logarithmic in zip((axes.xaxis, axes.yaxis), (x_label, y_label), log, strict=True):
        if logarithmic:
            (axes.set_xscale if axis is axes.xaxis else axes.set_yscale)("log")
        said = f"{label} (logarithmic)" if logarithmic and "logarithmic" not in label else label
        axis.set_label_text(said, size=_TEXT_PX, color=_COLOUR["soft"])
    return canvas, axes


def _mark_ends(axes: Any, s: Series, drawn: NDArray[np.bool_]) -> None:
    """The start of a path as a dot, its end as a ring."""
    first, last = np.flatnonzero(drawn)[[0, -1]]
    places = axes.transData.transform([(s.x[k], s.y[k]) for k in (first, last)])
    close = abs(places[0, 1] - places[1, 1]) < _LABEL_PX
    for name, k, fill, (x_px, _) in zip(("start", "end"), (first, last), ("ink", "card"), places, strict=True):
        axes.plot([s.x[k]], [s.y[k]], "o", ms=9, mfc=_COLOUR[fill], mec=_COLOUR["ink"], mew=2)
        side, dx = ("left", 9) if x_px < WIDTH / 2 else ("right", -9)
        at = (dx, -18 if name == "end" and close else 7)
        axes.annotate(name, (s.x[k], s.y[k]), at, textcoords="offset pixels", ha=side, size=_TEXT_PX,
                      color=_COLOUR["soft"])  # fmt: skip


def _name_lines(axes: Any, ends: Sequence[tuple[Series, int]], right_px: float) -> None:
    """The name of each line beside its end, moved apart where they would overlap; quiet ones where there is room."""
    places = {s.name: axes.transData.transform((float(s.x[k]), float(s.y[k]))) for s, k in ends}
    taken: list[float] = []
    loud = sorted((s for s, _ in ends if not s.quiet), key=lambda s: places[s.name][1])
    for s in (*loud, *(s for s, _ in ends if s.quiet)):
        x, y = places[s.name]
        if s.quiet and any(abs(y - other) < _LABEL_PX for other in taken):
            continue
        if not s.quiet and taken:
            y = max(y, taken[-1] + _LABEL_PX)
        taken.append(y)
        beyond = x + 4 + _CHARACTER_PX * len(s.name) > right_px
        axes.annotate(s.name, (x - 6 if beyond else x + 4, y), xycoords="figure pixels", va="center",
                      ha="right" if beyond else "left", color=_colour(s.style), size=_TEXT_PX + 0.5,
                      weight="normal" if s.quiet else "bold")  # fmt: skip


def _svg(canvas: Any, title: str) -> Markup:
    """The figure as SVG that takes its colours and its font from the page; equal figures give equal bytes."""
    from matplotlib import rc_context
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    for axis in (canvas.axes[0].xaxis, canvas.axes[0].yaxis):
        if axis.get_scale() == "log":
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < _MANY_TICKS * low else (1,), numticks=9))
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axis.set_minor_formatter("")
    file = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "stream_sfm"}):
        canvas.savefig(file, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    box, text = f"0 0 {canvas.get_figwidth() * 72:.0f} {HEIGHT}", file.getvalue()
    text = text[text.index(">", text.index("<svg")) + 1 :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text)
    text = re.sub(r' id="(figure|axes|patch|line2d|matplotlib|xtick|ytick|text)[^"]*"', "", text)
    for name, colour in _COLOUR.items():
        text = text.replace(colour, f"var(--{name})")
    start = Markup('<svg viewBox="{}" role="img" aria-label="{}">').format(box, title)
    return start + Markup(re.sub(r"\n\s*", "\n", text))
