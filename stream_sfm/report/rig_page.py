"""The page of a rig: what the images of a run show of its calibration, over the image and term by term."""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from ..config import Config
from ..frontend.learnt.rows import Rows
from ..geometry import Array
from ..geometry.stereo import StereoProjection
from ..record import changed, record
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import disparity_over_image
from ..rig_model.terms import GROUPS, TERMS
from .motions import MOTIONS, coverage
from .svg import figure
from .tables import Name, Table, render

_SHAPE = (9, 16)  # cells of a map, down and across
_UNITS = {
    "focal_length": "%",
    "delay_s": "ms",
    "readout_s": "ms",
    "turning_rad_s": "mrad/min",
    "focusing_per_s": "%/s",
}
_MOST_PX = 1.0  # difference at full colour, unless a map has more


@record
class RigRun:
    """A run with one calibration: the errors that it has found, and its rows.

    `title`: which calibration; `figures`: of the run, as (name, value); `seen` (9, 16): points by part of the image.
    """

    title: str
    text: str
    figures: Sequence[tuple[str, str]]
    projection: StereoProjection
    estimate: RigEstimate | None
    rows: Rows
    seen: Array


def render_rig(log: str, runs: Sequence[RigRun], config: Config) -> str:
    """Render the page of one rig: a run with the calibration, or one before and one after its refinement."""
    return render(
        "rig.html.j2",
        title=log,
        runs=[(run.title, run.text, _maps(run)) for run in runs],
        compared=_compared(runs),
        terms=[(run.title, _terms(run.estimate)) for run in runs if run.estimate is not None],
        motions=_motions(runs, config),
    )


def _maps(run: RigRun) -> list[Markup]:
    """Return the maps of rows, disparity and coverage."""
    down, across = _SHAPE
    rows_px, std_px = run.rows.over_image(down, across)
    maps = [over_image("Rows, left − right", rows_px.reshape(_SHAPE), std_px.reshape(_SHAPE), "px")]
    if run.estimate is not None:
        further = changed(run.estimate, mean=run.estimate.further)
        maps.append(over_image("Disparity", *disparity_over_image(run.projection, further, _SHAPE), "px"))
    share = 100 * run.seen / max(run.seen.sum(), 1.0)
    return [*maps, over_image("Where points were seen", share, np.zeros(_SHAPE), "%")]


def over_image(title: str, values: Array, std: Array, unit: str) -> Markup:
    """Return a `<figure>` with values (rows, columns) over the left image; pale where σ is larger than the value.

    Positive and negative values have two colours; the most intense is that of the largest value, one unit at least.
    """
    most = max(float(np.abs(values).max()), _MOST_PX)
    height, width = values.shape
    cells = []
    for (row, column), value in np.ndenumerate(values):
        opacity = abs(value) / most * min(1.0, abs(value) / max(float(std[row, column]), 1e-9))
        cells.append(
            Markup('<rect x="{}" y="{}" width="31" height="21" style="fill:var(--{})" fill-opacity="{:.2f}"/>').format(
                32 * column, 22 * row, "c1" if value >= 0 else "c2", opacity
            )
            + Markup('<text x="{}" y="{}" text-anchor="middle" font-size="9" style="fill:var(--{})">{}</text>').format(
                32 * column + 15.5, 22 * row + 14, "ink", f"{value:.2f}".replace("-", "−")
            )
        )
    start = Markup('<svg viewBox="0 0 {} {}" role="img" aria-label="{}">')
    content = start.format(32 * width - 1, 22 * height - 1, title) + Markup("").join(cells) + Markup("</svg>")
    return figure(title, unit, content)


def _compared(runs: Sequence[RigRun]) -> Table:
    names = [name for name, _ in runs[0].figures]
    rows = [(Name(run.title), [(value, "") for _, value in run.figures]) for run in runs]
    return Table([(name, "") for name in names], rows)


def _terms(estimate: RigEstimate) -> Table:
    """Return each term with its σ, what the thirds of the run say, and on how many σ they agree."""
    units = [(_UNITS.get(group.key, "px"), group.per_unit) for group in GROUPS for _ in group.terms]
    rows = []
    for k, (name, (unit, factor)) in enumerate(zip(TERMS, units, strict=True)):
        std = float(np.sqrt(estimate.cov[k, k]))
        by_thirds = () if estimate.thirds is None else estimate.thirds
        thirds = [_with_std(of[0, k], of[1, k], factor) for of in by_thirds]
        agree = "–" if estimate.evidence is None else f"{estimate.evidence[k]:.1f} σ"
        before = f"± {factor * estimate.prior_std[k]:.3g}"
        cells = [_with_std(float(estimate.mean[k]), std, factor), before, *(thirds or ["–"] * 3), agree]
        rows.append((Name(f"{name}, {unit}"), [(cell, "") for cell in cells]))
    headings = ("error", "beforehand", "1st third", "2nd third", "3rd third", "agree on")
    return Table([(heading, "") for heading in headings], rows)


def _with_std(value: float, std: float, factor: float) -> str:
    return f"{factor * value:+.3g} ± {factor * std:.2g}".replace("-", "−")


def _motions(runs: Sequence[RigRun], config: Config) -> list[tuple[str, list[int], str]]:
    """Return what motions show: the name, how far σ has shrunk by each run in per cent, and the motion to record."""
    shown = [coverage(run.estimate, config) for run in runs if run.estimate is not None]
    return [
        (name, [round(100 * float(of_run[k])) for of_run in shown], motion)
        for k, (name, _, motion) in enumerate(MOTIONS)
    ]
