"""What a replay of a log, or of a part of it, finds of its rig, and how well it goes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.refinement import DIFFERENCE, disparity_rms_px
from ..camera.rig import StereoRig
from ..config import Config
from ..frontend.rows import Rows
from ..geometry import Array
from ..geometry.stereo import StereoProjection
from ..recording.stereo_log import open_log
from ..report.records import RunRecord
from ..report.verdict import judged
from ..rig_model.estimate import RigEstimate
from ..rig_model.terms import lens_shift_rms_px
from ..types import InertialEstimate, Selection, Status
from .replay import replay_with_lane


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A replay of selected frames of a log with a rig: its `summary`, its record, and the rows of its front-end."""

    path: Path
    selection: Selection
    projection: StereoProjection
    summary: dict[str, Any]
    record: RunRecord
    rows: Rows

    @property
    def rig(self) -> RigEstimate | None:
        """The latest estimate of the rig errors."""
        return self.record.rig

    @property
    def unit(self) -> InertialEstimate | None:
        """The latest estimate of the inertial unit."""
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

    def found_px(self) -> Array:
        """Return the errors (3,) that this run still finds, by `PARTS` of a refinement, RMS over the image."""
        assert self.rig is not None
        error = self.rig.further
        shared = lens_shift_rms_px(self.projection, error)
        return np.array([disparity_rms_px(error), shared, abs(float(error[DIFFERENCE][0]))])


def look(path: Path, rig: StereoRig, config: Config, selection: Selection | None) -> Look:
    """Replay frames of a log with a rig, without files. Raises as `replay`."""
    chosen = selection or Selection()
    result, lane = replay_with_lane(open_log(path, calibration=rig), config, chosen)
    state = lane.observer.state
    return Look(path, chosen, lane.observer.projection, result.summary, lane.record, state.rows)
