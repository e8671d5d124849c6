"""What a replay of a log, or of a part of it, finds of its rig, and how well it goes."""

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.lens import project_into_image
from ..camera.models import Camera
from ..camera.refinement import DIFFERENCE, disparity_rms_px
from ..camera.rig import StereoRig
from ..config import Config
from ..errors import InputError
from ..frontend.learnt.rows import Rows
from ..geometry import Array
from ..geometry.stereo import StereoProjection
from ..logs.recording.stereo_log import StereoLog, open_log
from ..report.records import RunRecord
from ..report.rig_page import RigRun
from ..report.tables import text_of
from ..report.verdict import judged
from ..rig_model.estimate import RigEstimate
from ..rig_model.terms import lens_shift_rms_px
from ..types import Frame, FrameEstimate, InertialEstimate, Selection, Sink, Status
from .replay import replay_with_lane


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A replay of selected frames of a log with a rig: its `summary`, its record, and the rows of its front-end.

    `seen` (9, 16): how many points were used in each part of the left image.
    """

    path: Path
    selection: Selection
    projection: StereoProjection
    summary: dict[str, Any]
    record: RunRecord
    rows: Rows
    seen: Array

    @property
    def rig(self) -> RigEstimate | None:
        """The latest estimate of the rig errors."""
        return self.record.rig

    @property
    def unit(self) -> InertialEstimate | None:
        return self.record.unit

    @property
    def ok(self) -> int:
        """The number of frames with a good pose."""
        return self.record.count(Status.OK)

    @property
    def std_end_m(self) -> float:
        """σ of the last position."""
        cov = self.record.trajectory().cov_pose
        assert cov is not None  # every record has it
        return float(np.sqrt(np.trace(cov[-1, :3, :3])))

    @property
    def ate_m(self) -> float | None:
        """ATE after the best rigid motion, if the log has a ground truth."""
        truth = self.summary.get("ground_truth")
        return None if truth is None else truth.get("ate_rmse_aligned_m")

    def figures(self) -> dict[str, Any]:
        """Return the result in numbers, with the verdict on the calibration, as `text`."""
        rig, found = self.summary.get("rig"), judged(self.summary)
        further_px = None if self.rig is None else disparity_rms_px(self.rig.further)
        return {
            "frames": len(self.record),
            "ok": self.ok,
            "verdict": found["fit"],
            "text": found["text"],
            "rows_rms_px": None if rig is None else rig["rows_rms_px"],
            "disparity_further_px": further_px,
            "std_position_m": self.std_end_m,
            "ate_rmse_aligned_m": self.ate_m,
        }

    def as_run(self, title: str) -> RigRun:
        """Return what the page of the rig shows of this run; `title` names the calibration."""
        of = self.figures()
        further = None if self.rig is None else np.round(self.found_px(), 2)
        figures = [
            ("good frames", f"{of['ok']} of {of['frames']}"),
            ("rows, px", text_of(of["rows_rms_px"])),
            ("further disparity, px", text_of(None if further is None else further[0])),
            ("further lenses, px", text_of(None if further is None else further[1])),
            ("σ of the end, m", text_of(of["std_position_m"])),
            ("ATE, m", text_of(of["ate_rmse_aligned_m"])),
        ]
        return RigRun(title, of["text"], figures, self.projection, self.rig, self.rows, self.seen)

    def found_px(self) -> Array:
        """Return the errors (3,) that this run still finds, by `PARTS` of a refinement, RMS over the image."""
        assert self.rig is not None
        error = self.rig.further
        shared = lens_shift_rms_px(self.projection, error)
        return np.array([disparity_rms_px(error), shared, abs(float(error[DIFFERENCE][0]))])


def calibrations(log: str, chosen: dict[str, Any]) -> list[tuple[str, StereoRig]]:
    """Return the calibration of a log, or the one that is chosen, and the one before it was refined, if there is one.

    `chosen`: arguments of `open_log`. Before a refinement the calibration is that of the log, or else the same one
    without its refinement.
    """
    given = open_log(log, **chosen).stereo_rig
    before = replace(given, refinement=None, timing=None)
    if chosen["calibration"] is not None:
        with suppress(InputError):  # the log may have no calibration
            before = open_log(log, **(chosen | {"calibration": None})).stereo_rig
    if before.to_toml() == given.to_toml():
        return [("calibration", given)]
    return [("before", before), ("after", given)]


def look(log: StereoLog, config: Config, selection: Selection | None) -> Look:
    """Replay frames of a log, without files. Raises as `replay`."""
    chosen, coverage = selection or Selection(), _Coverage(log.stereo_rig.left)
    result, lane = replay_with_lane(log, config, chosen, [coverage])
    observer = lane.observer
    found = (result.summary, lane.record, observer.state.rows, coverage.seen)
    return Look(log.path, chosen, observer.projection, *found)


class _Coverage(Sink):
    """A sink that counts the points in each part of the left image."""

    def __init__(self, camera: Camera) -> None:
        self._camera, self.seen = camera, np.zeros((9, 16))

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Count the points of a frame."""
        pixels, camera = project_into_image(self._camera, estimate.points_in_cam), self._camera
        edges = [np.linspace(0, size, n + 1) for size, n in zip((camera.height, camera.width), (9, 16), strict=True)]
        self.seen += np.histogram2d(pixels[:, 1], pixels[:, 0], edges)[0]
