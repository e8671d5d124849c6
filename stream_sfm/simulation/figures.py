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
_ROWS = (
    ("rotation", "pose: rotation, mrad", 1e3),
    ("position", "pose: position, mm", 1e3),
    ("global_structure", "global structure, mm", 1e3),
    ("local_structure", "local structure, mm", 1e3),
)


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write name.png and name.svg, and return their paths."""
    paths = [folder / f"{name}.png", folder / f"{name}.svg"]
    figure.savefig(paths[0], dpi=_DPI)
    figure.savefig(paths[1], metadata={"Date": None})
    plt.close(figure)
    return paths


def figure6(report: dict[str, Any]) -> Figure:
    """Draw twelve panels: CC anchored, CC literal, WC; pose, global and local structure against the frame number."""
    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(4, 3, figsize=(11.0, 10.4), sharex=True, sharey="row", layout="constrained")
        kinds = (("cc", "CC, anchored"), ("literal", "CC, literal"), ("wc", "world-centred (WC)"))
        for column, (kind, title) in enumerate(kinds):
            axes[0, column].set_title(title, fontweight="bold")
            for row, (quantity, label, scale) in enumerate(_ROWS):
                _curves(axes[row, column], report, kind, quantity, scale)
                if column == 0:
                    axes[row, column].set_ylabel(f"RMS error\n{label}")
            axes[-1, column].set_xlabel("frame number n")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        figure.suptitle(f"Errors of motion and structure, {report['trials']} random scenes", fontsize=11)
        return figure


def _curves(axis: Axes, report: dict[str, Any], kind: str, quantity: str, scale: float) -> None:
    frames, curves = report["frames"], report["curves"]
    for b, colour in zip(BATCHES, _BATCH_COLOURS, strict=True):
        axis.plot(frames, scale * np.array(curves[f"{kind}_b{b}"][quantity]), color=colour, label=f"b = {b}")
    for key, (label, colour, style) in _OTHERS.items():
        axis.plot(frames, scale * np.array(curves[key][quantity]), style, color=colour, label=label, lw=1.4)
    axis.set_ylim(bottom=0)
    axis.set_xlim(frames[0], frames[-1])


def efficiency(report: dict[str, Any]) -> Figure:
    """Draw the variance over the bound of every estimator, with intervals; one panel per quantity."""
    return _bars(
        report["conditions"]["nominal"]["estimators"],
        "over_bound",
        {
            "rotation": "rotation",
            "position": "position",
            "global_structure": "global structure",
            "local_structure": "local structure",
        },
        dict.fromkeys(("rotation", "position", "global_structure", "local_structure"), 1.0),
        "Variance over the Cramér–Rao bound (1 is the limit)",
    )


def consistency(report: dict[str, Any]) -> Figure:
    """Draw the mean normalised squared errors of every estimator; the dotted line is that of a true covariance."""
    return _bars(
        report["conditions"]["nominal"]["estimators"],
        None,
        {"nees_pose": "pose", "nees_point": "local point", "nees_point_in_world": "point in the world"},
        report["expected"],
        "Normalised squared error (dotted: expected)",
    )


def calibration(report: dict[str, Any]) -> Figure:
    """Draw the variance over the bound and the NEES of the pose, with a wrong rig and errors that last."""
    estimators = next(iter(report["conditions"].values()))["estimators"]
    return _bars(
        {label: {**entry["over_bound"], "nees_pose": entry["nees_pose"]} for label, entry in estimators.items()},
        None,
        {
            "rotation": "rotation",
            "position": "position",
            "local_structure": "local structure",
            "nees_pose": "pose: normalised\nsquared error",
        },
        report["expected"],
        "Wrong calibration, lasting errors: variance over the bound, and consistency (dotted: expected)",
    )


def _bars(
    estimators: dict[str, Any], key: str | None, panels: dict[str, str], expected: dict[str, float], title: str
) -> Figure:
    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(
            1, len(panels), figsize=(2.8 * len(panels), 3.4), sharey=True, layout="constrained"
        )
        names = list(estimators)[::-1]
        for axis, (quantity, label) in zip(axes, panels.items(), strict=True):
            values = [(estimators[n][key] if key else estimators[n])[quantity] for n in names]
            middle = np.array([v["value"] for v in values])
            spread = np.array([[v["value"] - v["low"], v["high"] - v["value"]] for v in values]).T
            axis.errorbar(
                middle, range(len(names)), xerr=np.maximum(spread, 0), fmt="o", color="#2171b5", capsize=2
            )
            axis.axvline(expected[quantity], color="black", ls=":")
            if middle.max() > _LOG_SCALE_ABOVE * expected[quantity]:
                axis.set_xscale("log")
            axis.set_title(label)
        axes[0].set_yticks(range(len(names)), names)
        figure.suptitle(title, fontsize=11)
        return figure


def rates(report: dict[str, Any]) -> Figure:
    """Draw the drift rate over the track length, and local structure over the window, with their laws."""
    with plt.rc_context(_STYLE):
        figure, (left, right) = plt.subplots(1, 2, figsize=(8.2, 3.4), layout="constrained")
        spans = report["drift_over_span"]
        left.loglog(spans["span_frames"], spans["theory"], "k:", label="3/(L²−1)")
        left.loglog(spans["span_frames"], spans["rotation_relative"], "o", color="#2171b5", label="rotation")
        left.loglog(spans["span_frames"], spans["position_relative"], "x", color="#d95f02", label="position")
        left.set(xlabel="frames L in which a point is seen", ylabel="drift rate over that of L = 2")
        windows = report["structure_over_window"]
        right.loglog(windows["window_frames"], windows["theory"], "k:", label="(H_b + (L−b)/b)/L, L = 16")
        right.loglog(
            windows["window_frames"], [v["value"] for v in windows["relative"]], "o", color="#2171b5", label="bound"
        )
        right.set(xlabel="frames b in the window", ylabel="local structure over one view")
        for axis, ticks in ((left, spans["span_frames"]), (right, windows["window_frames"])):
            axis.set_xticks(ticks, [str(t) for t in ticks])
            axis.minorticks_off()
            axis.legend()
        return figure
