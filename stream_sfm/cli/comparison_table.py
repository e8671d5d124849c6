"""The main figures of a comparison, one row per method."""

from typing import Any

from rich.table import Column, Table

from .printing import factors_text, number, stdout_console

_COLUMNS = {
    "ate_rmse_aligned_m": "ATE aligned\nm",
    "final_drift_percent": "drift\n%",
    "t_rel_percent": "t_rel\n%",
    "r_rel_deg_per_100m": "r_rel\n°/100 m",
    "nees_pose_mean": "NEES",
    "growth_exponent": "growth",
    "ms_per_frame_p50": "time\nms/frame",
}


def print_comparison(content: dict[str, Any]) -> None:
    """Print the content of report.json; a figure that does not exist for this log is a dash."""
    table = Table(
        Column("method", no_wrap=True), *(Column(name, justify="right", no_wrap=True) for name in _COLUMNS.values())
    )
    for key, figures in content["methods"].items():
        table.add_row(key.replace("_", "-"), *(number(figures[column], ".4g") for column in _COLUMNS))
    stdout_console().print(table)
    for name, spans in (content["self_test"] or {}).items():
        stdout_console().print(f"halves of the {name} differ by {factors_text(spans)}")
