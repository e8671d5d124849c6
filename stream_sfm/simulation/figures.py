"""The figures of the studies as PNG and SVG. Only this file loads matplotlib, and without a display."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .figure6 import BATCHES
from .studies import REFERENCE
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
_LOG_SCALE_ABOVE = 20  # times the expected value: beyond it the consistent estimators would share one spot
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
_PANELS = {
    "nees_pose": "pose: normalised\nsquared error",
    "nees_point": "local point",
    "nees_point_in_world": "point in the world",
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


def efficiency(report: Report) -> Figure:
    """Draw the variance over the bound of every estimator, with intervals; one panel per quantity."""
    estimators = report["conditions"]["nominal"]["estimators"]
    values = {name: entry["over_bound"] for name, entry in estimators.items()}
    title = "Variance over the Cramér–Rao bound (1 is the limit)"
    return _bars(values, dict.fromkeys(values[REFERENCE], 1.0), title)


def consistency(report: Report) -> Figure:
    """Draw the mean normalised squared errors of every estimator; the dotted line is that of a true covariance."""
    estimators = report["conditions"]["nominal"]["estimators"]
    return _bars(estimators, report["expected"], "Normalised squared error (dotted: expected)")


def calibration(report: Report) -> Figure:
    """Draw the variance over the bound and the NEES of the pose, with a wrong rig and errors that last."""
    estimators = next(iter(report["conditions"].values()))["estimators"]
    values = {name: {**entry["over_bound"], "nees_pose": entry["nees_pose"]} for name, entry in estimators.items()}
    expected = {q: report["expected"][q] for q in next(iter(values.values()))}
    title = "Wrong calibration, lasting errors: variance over the bound, and consistency (dotted: expected)"
    return _bars(values, expected, title)


def _bars(values: dict[str, Any], expected: dict[str, float], title: str) -> Figure:
    """Draw one panel per expected quantity, one row per estimator, each value with its interval."""
    with plt.rc_context(_STYLE):
        size = (2.8 * len(expected), 3.4)
        figure, axes = plt.subplots(1, len(expected), figsize=size, sharey=True, layout="constrained")
        names = list(values)[::-1]
        for axis, (quantity, right) in zip(axes, expected.items(), strict=True):
            intervals = [values[name][quantity] for name in names]
            middle = np.array([v["value"] for v in intervals])
            spread = np.array([[v["value"] - v["low"], v["high"] - v["value"]] for v in intervals]).T
            ends = np.maximum(spread, 0)
            axis.errorbar(middle, range(len(names)), xerr=ends, fmt="o", color=_BATCH_COLOURS[2], capsize=2)
            axis.axvline(right, color="black", ls=":")
            if middle.max() > _LOG_SCALE_ABOVE * right:
                axis.set_xscale("log")
            axis.set_title(_PANELS.get(quantity, quantity.replace("_", " ")))
        axes[0].set_yticks(range(len(names)), names)
        figure.suptitle(title, fontsize=11)
        return figure


def rates(report: Report) -> Figure:
    """Draw the drift rate over the track length, and local structure over the window, with their laws."""
    with plt.rc_context(_STYLE):
        figure, (left, right) = plt.subplots(1, 2, figsize=(8.2, 3.4), layout="constrained")
        spans, windows = report["drift_over_span"], report["structure_over_window"]
        x = spans["span_frames"]
        left.loglog(x, spans["theory"], "k:", label="3/(L²−1)")
        left.loglog(x, spans["rotation_relative"], "o", color=_BATCH_COLOURS[2], label="rotation")
        left.loglog(x, spans["position_relative"], "x", color="#d95f02", label="position")
        left.set(xlabel="frames L in which a point is seen", ylabel="drift rate over that of L = 2")
        left.set_xticks(x, map(str, x))
        x = windows["window_frames"]
        right.loglog(x, windows["theory"], "k:", label="(H_b + (L−b)/b)/L, L = 16")
        right.loglog(x, [v["value"] for v in windows["relative"]], "o", color=_BATCH_COLOURS[2], label="bound")
        right.set(xlabel="frames b in the window", ylabel="local structure over one view")
        right.set_xticks(x, map(str, x))
        for axis in (left, right):
            axis.minorticks_off()
            axis.legend()
        return figure
