"""Refines the calibration of a rig by combining the errors that a replay of each log has found."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..camera.calibration.document import Where
from ..camera.refinement import LENS_TERMS, KnownTiming, combine
from ..camera.rig import StereoRig
from ..config import Config
from ..errors import ConfigError, LogError
from ..geometry import se3
from ..inertial.state import AXES, CLOCK, SCALE
from ..recording.stereo_log import open_log
from ..report.inertia import fixed_error, inertial_findings
from ..rig_model.estimate import CERTAIN, RigEstimate, is_certain
from ..rig_model.terms import AT_TIMING, TERMS, prior_std
from ..types import Frame, FrameEstimate, InertialEstimate, Selection
from .replay import replay


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RefinedRig:
    """The `rig` with its refinement, the result of each log (None: nothing), and sentences about the inertial unit."""

    rig: StereoRig
    estimates: tuple[RigEstimate | None, ...]
    of_unit: tuple[tuple[str, ...], ...] = ()

    def __repr__(self) -> str:
        return f"<RefinedRig from {len(self.estimates)} logs: {self.rig.refinement!r}>"


def refine(
    logs: Sequence[str | Path],
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    calibration: Where | StereoRig | None = None,
) -> RefinedRig:
    """Refine the calibration that the logs share, or the given one. Their cameras must be the same.

    A refinement in the calibration is ignored, because the new one replaces it. Certain findings of inertial
    samples about their clock, their axes, and the scale of lengths go into the calibration itself. Raises
    ConfigError, and LogError also if the images show errors that are not estimated, such as swapped cameras.
    """
    config = config or Config()
    config.needs_scale("refine")
    if config.rig.exact or config.method != "cross-frame":
        raise ConfigError(f"neither rig.exact nor the method {config.method} refines a calibration: leave them out")
    opened = [open_log(log, calibration=calibration) for log in logs]
    rig = replace(opened[0].stereo_rig, refinement=None, timing=None)
    estimates, units = [], []
    for log in opened:
        if replace(log.stereo_rig, refinement=None, timing=None).to_toml() != rig.to_toml():
            raise ConfigError(
                f"{log.path} has other cameras, or another calibration, than {opened[0].path}: "
                "all logs that refine a calibration must have this calibration"
            )
        latest = _Latest()
        result = replay(open_log(log.path, calibration=rig), None, config, selection, sinks=[latest])
        if result.problems:
            raise LogError("; ".join(result.problems), hint=("left", "right", "calibration", "inspect"))
        estimates.append(latest.rig)
        units.append(latest.unit)
    known = [e for e in estimates if e is not None]
    if known:
        n = len(LENS_TERMS)
        priors_px = np.array([e.prior_std[:n] for e in known])
        refinement = combine([e.refinement for e in known], priors_px, prior_std(config.rig)[:n])
        rig = replace(rig, refinement=refinement, timing=timing_of(known, config))
    found = [() if unit is None else tuple(inertial_findings(unit)) for unit in units]
    return RefinedRig(with_unit(rig, list(filter(None, units))), tuple(estimates), tuple(found))


class _Latest:
    """A sink that keeps the latest estimates of the rig errors and of the inertial unit."""

    rig: RigEstimate | None = None
    unit: InertialEstimate | None = None

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        self.rig = estimate.rig or self.rig
        self.unit = estimate.inertial or self.unit

    def close(self) -> None:
        """Nothing is open."""


def timing_of(estimates: Sequence[RigEstimate], config: Config) -> KnownTiming | None:
    """Return delay and readout from independent runs; None if no run is certain of either."""
    values, certain = [], False
    for term in range(len(TERMS))[AT_TIMING]:
        mean, var = np.array([(e.mean[term], e.cov[term, term]) for e in estimates]).T
        sure = mean**2 > CERTAIN**2 * var
        information = (1 / var[sure]).sum()
        if sure.any():
            values += [float((mean[sure] / var[sure]).sum() / information), float(information**-0.5)]
        else:
            values += [0.0, float(prior_std(config.rig)[term])]
        certain |= bool(sure.any())
    return KnownTiming(*values) if certain else None


def with_unit(rig: StereoRig, units: Sequence[InertialEstimate]) -> StereoRig:
    """Return a rig with the certain findings of independent runs: clock and axes of its unit, and its baseline.

    The unit measures in metres, so if lengths from images alone are too short, so is the baseline.
    """
    if rig.imu is None:
        return rig
    found = []
    for group in (CLOCK, AXES, SCALE):
        sure = [known for known in (fixed_error(unit, group) for unit in units) if is_certain(*known)]
        information = sum((np.linalg.inv(cov) for _, cov in sure), np.zeros((group.stop - group.start,) * 2))
        weighted = sum((np.linalg.solve(cov, error) for error, cov in sure), np.zeros(len(information)))
        found.append(np.linalg.solve(information, weighted) if sure else weighted)
    clock, axes, scale = found
    turned = rig.imu.cam_from_imu @ se3.exp(np.concatenate([np.zeros(3), axes]))
    unit = replace(rig.imu, cam_from_imu=turned, time_offset_s=rig.imu.time_offset_s + float(clock[0]))
    right_from_left = rig.right_from_left.copy()
    right_from_left[:3, 3] *= 1 + float(scale[0])
    return replace(rig, imu=unit, right_from_left=right_from_left)
