"""The page of `evaluate`: finished runs side by side against ground truth, a table and four charts."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from ..types import Trajectory
from ..wording import counted
from . import charts
from .figures import ACCURACY, FURTHER, table
from .lengths import unit_for
from .methods import label, of_runs
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
    poses = {run.name: run.trajectory.world_from_cam for run in scaled if len(run.trajectory)}
    return render(
        "evaluation.html.j2",
        title=counted(len(runs), "run"),
        runs=[(run, looks(run.name), label(run.method)) for run in runs],
        accuracy=table((*ACCURACY, *FURTHER[:2]), [run.figures for run in runs], {"errors": unit}),
        charts=[
            charts.errors(traces, unit, looks),
            charts.rotation_errors(traces, looks),
            charts.nees(traces, looks=looks),
            charts.path(poses, traces, unit, looks=looks),
        ],
    )
