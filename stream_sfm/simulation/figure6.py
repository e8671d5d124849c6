"""Figure 6 of the paper: errors against the frame number, one curve per batch size, for CC (two ways) and for WC.

Rotation errors are angles θ; the paper's norm of the difference of two rotation matrices is 2√2 sin(θ/2), √2 θ for
small angles. CC is drawn as the paper writes it (literal) and with the joint covariance of prior and leaving view
(anchored).

The scene is the paper's own: natural visibility, about 200 mm per frame, round-off noise. Beside the paper's curves
stand the default estimator, two EKFs, frame-to-frame concatenation, and the bound.
"""

from functools import partial

import msgspec
import numpy as np

from .measure import QUANTITIES, Method, measure
from .scenes import Scene
from .trials import Job, Measured, Report, Study

BATCHES = (1, 2, 4, 8)  # paper: the batch sizes b of its figure
FRAMES = tuple(range(1, 31))  # paper: 31 frames
SCENE = Scene()
METHODS = (
    *(Method("cross-frame-cc", b, f"cc_b{b}") for b in BATCHES),
    *(Method("cross-frame-cc-literal", b, f"literal_b{b}") for b in BATCHES),
    *(Method("cross-frame-wc", b, f"wc_b{b}") for b in BATCHES),
    Method("cross-frame"),
    Method("ekf"),
    Method("iterated-ekf"),
    Method("frame-to-frame"),
)


def _jobs() -> dict[str, Job]:
    return {"figure6": Job(partial(measure, scene=SCENE, methods=METHODS, frames=FRAMES))}


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


FIGURE6 = Study(_jobs, _report)
