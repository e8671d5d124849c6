"""What the images tell about the calibration, as a picture: by how much the disparity errs over the left image, and σ.

It is the whole error of the calibration that was given, whether it was learnt before or in this run.

It changes slowly: it is shown whenever a run has become half as long again, and at its end.
"""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ..camera.rectification import Rectifier
from ..camera.rig import StereoRig
from ..geometry.se3 import Array
from ..report.calibration_field import describe
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import disparity_error, disparity_over_image
from ..types import FrameEstimate
from . import layout

_CELL_PX = 8  # of the picture: the field is smooth
_FIGURES = np.array([1, 3, 5]) / 6  # of the width and height: where the picture says how large the error is
_FIGURE_COLOUR = (235, 235, 235)
_LEAST_SCALE_PX = 0.1  # of the strongest colour: less than that is no error worth colour
_MORE, _LESS, _NONE = np.array([217, 130, 43]), np.array([59, 125, 216]), np.array([30, 30, 34])
_LONGER = 1.5  # times as many frames as at the last picture


class CalibrationField:
    """Shows the estimates of a rig's errors that come with the frames; nothing where the rig is exact."""

    def __init__(self, rig: StereoRig) -> None:
        self._projection = Rectifier(rig).projection
        self._shown_at = 0
        self._latest: FrameEstimate | None = None

    def write(self, estimate: FrameEstimate, stream: rr.RecordingStream) -> None:
        """Take an estimate, and show what it says about the rig if the last picture is old."""
        if estimate.rig is None:
            return
        self._latest = estimate
        if estimate.frame_index >= _LONGER * self._shown_at:
            self._show(estimate.rig, estimate.frame_index, stream)

    def close(self, stream: rr.RecordingStream) -> None:
        """Show the last estimate, and say what it means where errors are corrected."""
        if self._latest is None or self._latest.rig is None:
            return
        layout.set_time(stream, self._latest)
        if self._latest.frame_index > self._shown_at:
            self._show(self._latest.rig, self._latest.frame_index, stream)
        if self._latest.rig.applied or self._latest.rig.refined is not None:
            p = self._projection
            text = describe(p, self._latest.rig)["text"]
            stream.log(layout.STATUS, rr.TextLog(f"calibration: {text}", level="INFO"))

    def _show(self, rig: RigEstimate, frame_index: int, stream: rr.RecordingStream) -> None:
        self._shown_at = max(frame_index, 1)
        p = self._projection
        cells = (max(p.height // _CELL_PX, 1), max(p.width // _CELL_PX, 1))
        cells_px, _ = disparity_over_image(p, rig, cells)
        stream.log(layout.CALIBRATION, rr.Image(_coloured(cells_px), color_model="RGB"))
        places_px = np.stack(np.meshgrid(p.width * _FIGURES, p.height * _FIGURES), axis=2).reshape(-1, 2) - 0.5
        error_px, std_px = disparity_error(p, rig, places_px)
        labels = [f"{e:+.2f} ± {s:.2f}" for e, s in zip(error_px, std_px, strict=True)]
        points = rr.Points2D(
            (places_px + 0.5) / _CELL_PX,
            labels=labels,
            colors=_FIGURE_COLOUR,
            radii=rr.Radius.ui_points(1.0),
            show_labels=True,
        )
        stream.log(layout.CALIBRATION_LABELS, points)


def _coloured(error_px: Array) -> NDArray[np.uint8]:
    """Colours (rows, columns, 3) of errors, as strong as they are large."""
    strength = np.abs(error_px)[..., None] / max(float(np.abs(error_px).max()), _LEAST_SCALE_PX)
    towards = np.where(error_px[..., None] > 0, _MORE, _LESS)
    return np.asarray(np.round(_NONE + strength * (towards - _NONE)), np.uint8)
