"""Figure 6 of the paper as PNG and SVG, drawn without a display."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .figure6 import BATCHES
from .trials import Report

_STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "legend.frameon": False,
    "svg.hashsalt": "stream-sfm",
}
_DPI = 160  # legible on a screen of high density; a smaller file than for print
_BATCH_COLOURS = ("#9ecae1", "#4f97c8", "#2171b5", "#08306b")
_OTHERS = {
    "frame-to-frame": ("frame to frame", "#d95f02", "-"),
    "ekf": ("EKF", "#7b3294", "--"),
    "iterated-ekf": ("iterated EKF", "#c51b7d", "-."),
    "cross-frame": ("joint prior, b = 8", "#1b9e77", "-"),
    "bound": ("Cramér–Rao bound", "black", ":"),
}
_ROWS = {
    "rotation": "pose: rotation, mrad",
    "position": "pose: position, mm",
    "global_structure": "global structure, mm",
    "local_structure": "local structure, mm",
}


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write name.png and name.svg, and return their paths."""
    paths = [folder / f"{name}.png", folder / f"{name}.svg"]
    with plt.rc_context(_STYLE):  # equal bytes for equal results
        figure.savefig(paths[0], dpi=_DPI)
        figure.savefig(paths[1], metadata={"Date": None})
    plt.close(figure)
    return paths


def figure6(report: Report) -> Figure:
    """Draw twelve panels: CC anchored, CC literal, WC; pose, global and local structure against the frame number."""
    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(4, 3, figsize=(11.0, 10.4), sharex=True, sharey="row", layout="constrained")
        kinds = (("cc", "CC, anchored"), ("literal", "CC, literal"), ("wc", "world-centred (WC)"))
        for column, (kind, title) in enumerate(kinds):
            axes[0, column].set_title(title, fontweight="bold")
            for row, (quantity, label) in enumerate(_ROWS.items()):
                _curves(axes[row, column], report, kind, quantity)
                if column == 0:
                    axes[row, column].set_ylabel(f"RMS error\n{label}")
            axes[-1, column].set_xlabel("frame number n")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        figure.suptitle(f"Errors of motion and structure, {report['trials']} random scenes", fontsize=11)
        return figure


def _curves(axis: Axes, report: Report, kind: str, quantity: str) -> None:
    """Draw one panel, in milliradians or millimetres."""
    frames, curves = report["frames"], report["curves"]
    for b, colour in zip(BATCHES, _BATCH_COLOURS, strict=True):
        axis.plot(frames, 1e3 * np.array(curves[f"{kind}_b{b}"][quantity]), color=colour, label=f"b = {b}")
    for key, (label, colour, style) in _OTHERS.items():
        axis.plot(frames, 1e3 * np.array(curves[key][quantity]), style, color=colour, label=label, lw=1.4)
    axis.set_ylim(bottom=0)
    axis.set_xlim(frames[0], frames[-1])
