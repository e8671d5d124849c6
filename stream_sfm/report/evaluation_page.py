"""The page of `evaluate`: finished runs side by side against ground truth, a table and four charts."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from ..types import Trajectory
from ..wording import counted
from . import charts
from .methods import of_method, of_runs
from .tables import ACCURACY, FURTHER, Figure, Name, table, unit_for
from .template import render
from .traces import trace_of


class Evaluated(NamedTuple):
    """A run with its figures against ground truth, as `evaluate` returns them."""

    name: str
    method: str
    figures: dict[str, Any]
    trajectory: Trajectory
    truth: Trajectory


def render_evaluation(runs: Sequence[Evaluated]) -> str:
    """Render runs as HTML; one of a single camera, whose lengths have no unit, is in the table alone."""
    scaled = [run for run in runs if "ate_rmse_m" in run.figures]
    found = {run.name: trace_of(run.trajectory, run.truth) for run in scaled}
    traces = {name: trace for name, trace in found.items() if trace is not None}
    unit = unit_for(*(trace.position_m for trace in traces.values()))
    looks = of_runs([run.name for run in runs])
    names = [Name(run.name, of_method(run.method).name, looks(run.name).colour) for run in runs]
    figures = (Figure("frames_compared", "frames"), *ACCURACY, *FURTHER[:2])
    return render(
        "evaluation.html.j2",
        title=counted(len(runs), "run"),
        accuracy=table(figures, names, [run.figures for run in runs], {"errors": unit}),
        charts=[
            charts.errors(traces, unit, looks),
            charts.rotation_errors(traces, looks),
            charts.nees(traces, looks=looks),
            charts.path({r.name: r.trajectory.world_from_cam for r in scaled if len(r.trajectory)}, traces, looks),
        ],
    )
