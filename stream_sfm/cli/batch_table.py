"""The main figures of a batch, one row per log."""

from typing import Any

from rich import box
from rich.markup import escape
from rich.table import Table

from .printing import cleaned, number, stdout_console

_PIPED_WIDTH = 120  # columns: names of logs are long
_TRUTH_COLUMNS = {"ate_rmse_aligned_m": "ATE\nm", "final_drift_percent": "drift\n%", "t_rel_percent": "t_rel\n%"}


def print_batch(content: dict[str, Any]) -> None:
    """Print the content of batch.json; it fits into 80 columns."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("log", overflow="fold", min_width=8)
    table.add_column("status", no_wrap=True)
    for heading in ("frames", "lost", "path\nm", *_TRUTH_COLUMNS.values(), "time\nms/frame"):
        table.add_column(heading, justify="right", no_wrap=True)
    for log in cleaned(content["logs"]):
        summary = log["summary"]
        if summary is None:
            table.add_row(escape(log["name"]), log["status"])
            continue
        frames, truth = summary["frames"], summary.get("ground_truth", {})
        figures = [summary["path_length_m"], *map(truth.get, _TRUTH_COLUMNS), summary["timing_ms"]["total"]["p50"]]
        cells = (number(figure, ".3g") for figure in figures)
        table.add_row(escape(log["name"]), log["status"], str(frames["estimated"]), str(frames["lost"]), *cells)
    stdout_console(_PIPED_WIDTH).print(table)


def print_many(content: dict[str, Any]) -> None:
    """Print the ratios of comparison.json, one row per method."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    runs = "logs" if content["interval_over"] == "logs" else "starts"
    for heading in ("error over cross-frame", "position", "rotation", runs):
        table.add_column(heading, no_wrap=True)
    for key, found in content["error_over_cross_frame"].items():
        cells = [_with_interval(found[quantity]) for quantity in ("position", "rotation")]
        table.add_row(key.replace("_", "-"), *cells, str(found["position"]["samples"]))
    stdout_console(_PIPED_WIDTH).print(table)


def _with_interval(figure: dict[str, Any]) -> str:
    low_high = figure["ci95"]
    interval = "" if low_high is None else escape(f" [{low_high[0]:.2f}, {low_high[1]:.2f}]")
    return f"{figure['value']:.2f}{interval}"
