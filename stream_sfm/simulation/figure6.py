"""Figure 6 of the paper: errors against the frame number, one curve per batch size, for CC (two ways) and for WC.

Rotation errors are angles θ; the paper's norm of the difference of two rotation matrices is 2√2 sin(θ/2), √2 θ for
small angles. CC is drawn as the paper writes it (literal) and with the joint covariance of prior and leaving view
(anchored).

The scene is that of the paper: natural visibility, about 200 mm per frame, round-off noise. Besides the curves of the
paper there are the default estimator, two EKFs, frame-to-frame concatenation, and the bound.
"""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from .measure import QUANTITIES, Measured, Method
from .scenes import Scene
from .studies import Report, Study, judged

BATCHES = (1, 2, 4, 8)  # paper: the batch sizes b of its figure
FRAMES = tuple(range(1, 31))  # paper: 31 frames
SCENE = Scene()
KINDS = {  # prefix of the labels -> estimator, and title of a column of panels
    "cc": ("cross-frame-cc", "CC, anchored"),
    "literal": ("cross-frame-cc-literal", "CC, literal"),
    "wc": ("cross-frame-wc", "world-centred (WC)"),
}
_STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "legend.frameon": False,
    "svg.hashsalt": "stream-sfm",  # equal bytes for equal results
}
_BATCH_COLOURS = ("#9ecae1", "#4f97c8", "#2171b5", "#08306b")
_OTHERS = {
    "frame-to-frame": ("frame to frame", "#d95f02", "-"),
    "ekf": ("EKF", "#7b3294", "--"),
    "iterated-ekf": ("iterated EKF", "#c51b7d", "-."),
    "cross-frame": ("joint prior, b = 8", "#1b9e77", "-"),
    "bound": ("Cramér–Rao bound", "black", ":"),
}
METHODS = (
    *(Method(name, b, f"{kind}_b{b}") for kind, (name, _) in KINDS.items() for b in BATCHES),
    *(Method(name) for name in reversed(_OTHERS) if name != "bound"),
)
_ROWS = ("pose: rotation, mrad", "pose: position, mm", "global structure, mm", "local structure, mm")


def _report(measured: dict[str, Measured]) -> Report:
    """Report RMS errors by estimator, quantity and frame: `curves[label][quantity]`, rad and m, with label "bound"."""
    return {
        "scene": msgspec.to_builtins(SCENE),
        "frames": list(FRAMES),
        "curves": {
            label: {q: np.sqrt(np.nanmean(entry[q], axis=0)).tolist() for q in QUANTITIES}
            for label, entry in measured["figure6"].items()
        },
    }


FIGURE6 = Study(lambda: {"figure6": judged(SCENE, FRAMES, METHODS)}, _report)


def draw(report: Report, folder: Path) -> None:
    """Draw twelve panels into figure6.png and figure6.svg: CC anchored, CC literal, WC; pose and structure by frame."""
    import matplotlib  # late, as it takes a second to import

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    frames, curves = report["frames"], report["curves"]
    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(4, 3, figsize=(11.0, 10.4), sharex=True, sharey="row", layout="constrained")
        for column, (kind, (_, title)) in enumerate(KINDS.items()):
            axes[0, column].set_title(title, fontweight="bold")
            axes[-1, column].set_xlabel("frame number n")
            for axis, quantity in zip(axes[:, column], QUANTITIES, strict=True):  # in milliradians or millimetres
                for b, colour in zip(BATCHES, _BATCH_COLOURS, strict=True):
                    values = 1e3 * np.array(curves[f"{kind}_b{b}"][quantity])
                    axis.plot(frames, values, color=colour, label=f"b = {b}")
                for key, (label, colour, style) in _OTHERS.items():
                    values = 1e3 * np.array(curves[key][quantity])
                    axis.plot(frames, values, style, color=colour, label=label, lw=1.4)
                axis.set(ylim=(0, None), xlim=(frames[0], frames[-1]))
        for axis, label in zip(axes[:, 0], _ROWS, strict=True):
            axis.set_ylabel(f"RMS error\n{label}")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        figure.suptitle(f"Errors of motion and structure, {report['trials']} random scenes", fontsize=11)
        figure.savefig(folder / "figure6.png", dpi=160)  # legible on a dense screen, smaller than for print
        figure.savefig(folder / "figure6.svg", metadata={"Date": None})
    plt.close(figure)
