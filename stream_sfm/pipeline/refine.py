"""Refines the calibration of a rig from logs: what each run has learnt about its errors, put together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.calibration.read import Where
from ..camera.refinement import TERMS, Refinement, combine, disparity_rms_px
from ..camera.rig import StereoRig
from ..config import Config
from ..engine import Engine
from ..errors import ConfigError, FrameError, LogError
from ..frontend.rig_effects import disparity_over_image, prior_std_px
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..recording import StereoLog, open_log
from ..report.records import CalibrationError
from ..types import RigEstimate, Selection
from .calibration import CalibrationSink
from .prefetch import prepared_ahead

# σ that a refinement is given when the same frames are used once more, in units of its own: they count twice then, and
# with this their second say is a quarter of the first.
_USED_AGAIN = 2.0
_ROWS, _COLUMNS = 5, 9  # of the places in the image where the pages give the error of the disparity
_TELLING = 0.1  # of a distance: what is said about an error is where it reaches that


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RefinedRig:
    """The result of a calibration: the `rig` with its refinement, and what each log has told (None: nothing)."""

    rig: StereoRig
    estimates: tuple[RigEstimate | None, ...]

    def __repr__(self) -> str:
        return f"<RefinedRig from {len(self.estimates)} logs: {self.rig.refinement!r}>"


def calibrate(
    logs: Sequence[str | Path | StereoLog],
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    calibration: Where | StereoRig | None = None,
) -> RefinedRig:
    """Refine the calibration that the logs share, or the given one. Their cameras must be the same.

    The refinement that a calibration has already is left out: what is learnt replaces it. Raises ConfigError; LogError
    also where the images show errors that are not learnt, such as exchanged cameras.
    """
    config = config or Config()
    check_calibrates(config)
    opened = [log if isinstance(log, StereoLog) else open_log(log, calibration=calibration) for log in logs]
    rig = replace(opened[0].stereo_rig, refinement=None)
    for log in opened[1:]:
        if not _same(rig, log.stereo_rig):
            raise ConfigError(
                f"{log.path} has other cameras, or another calibration, than {opened[0].path}: "
                "logs that refine one calibration must have it in common"
            )
    estimates = tuple(_learn_or_refuse(log, rig, config, selection or Selection()) for log in opened)
    known = [e for e in estimates if e is not None]
    if not known:
        return RefinedRig(rig, estimates)
    priors_px = np.array([e.prior_std for e in known])
    refinement = combine([Refinement(e.mean, e.cov) for e in known], priors_px, prior_std_px(config.rig))
    return RefinedRig(replace(rig, refinement=refinement), estimates)


def refined_for_itself(log: StereoLog, config: Config, selection: Selection) -> StereoRig:
    """The rig of a log, refined by the same frames that are going to be estimated with it; as it is if it is right.

    Where the right camera is turned on the way, by the frames before: the turn is found in the second run, too.
    """
    check_calibrates(config)
    rig = replace(log.stereo_rig, refinement=None)
    estimate, _ = _learn(log, rig, config, selection, until_a_change=True)
    if estimate is None or not estimate.applied:
        return log.stereo_rig
    return replace(log.stereo_rig, refinement=Refinement(estimate.mean, _USED_AGAIN**2 * estimate.cov))


def calibration_error(projection: StereoProjection, estimate: RigEstimate) -> CalibrationError:
    """The whole error of the given calibration for the pages, from an estimate in pixels: in numbers and as a field."""
    error_px, std_px = disparity_over_image(projection, estimate, (_ROWS, _COLUMNS))
    return CalibrationError(describe(estimate, projection.f_px * projection.baseline_m), error_px, std_px)


def describe(estimate: RigEstimate, disparity_at_1m_px: float) -> dict[str, Any]:
    """The section `rig` of summary.json: errors of the calibration in pixels, and what they mean."""
    refined = estimate.refined
    std_px, rms_px = np.sqrt(np.diag(estimate.cov)), disparity_rms_px(estimate.mean)
    within_px = _uncertainty_px(estimate.cov)
    far_m = _TELLING * disparity_at_1m_px / max(rms_px, 1e-9)
    if estimate.applied and refined is not None:
        text = (
            f"refined by {disparity_rms_px(refined):.2f} px of disparity, and corrected by "
            f"{disparity_rms_px(estimate.mean - refined):.2f} px more, as these images show"
        )
    elif estimate.applied:
        text = (
            f"wrong by {rms_px:.2f} px of disparity, which is corrected: without that, distances beyond {far_m:.3g} m "
            "would be off by 10 % and more"
        )
    elif refined is not None:
        text = (
            f"refined by {rms_px:.2f} px of disparity, with which the images agree; right within {within_px:.2f} px"
        )
    else:
        text = f"agrees with the images; the disparity is right within {within_px:.2f} px"
    return {
        "applied": estimate.applied,
        "terms": list(TERMS),
        "error_px": estimate.mean.tolist(),
        "std_px": std_px.tolist(),
        "disparity_rms_px": rms_px,
        "text": text,
    }


def _uncertainty_px(cov_px2: Array) -> float:
    """σ of the disparity, root mean square over the image."""
    root = np.linalg.cholesky(cov_px2)
    return float(np.sqrt(sum(disparity_rms_px(column) ** 2 for column in root.T)))


def check_calibrates(config: Config) -> None:
    """Raise a ConfigError where calibrating is not possible with this configuration."""
    config.needs_scale("calibrate")
    if config.rig.exact:
        raise ConfigError("rig.exact says that the calibration has no error: leave it out to calibrate")
    if config.method != "cross-frame":
        raise ConfigError(f"the method {config.method} does not calibrate: use cross-frame")


def _learn_or_refuse(log: StereoLog, rig: StereoRig, config: Config, selection: Selection) -> RigEstimate | None:
    """What the frames of a log tell. Raises LogError where the calibration is wrong in ways that are not learnt."""
    latest, problems = _learn(log, rig, config, selection)
    if problems:
        raise LogError("; ".join(problems), hint=("left", "right", "calibration", "inspect"))
    return latest


def _learn(
    log: StereoLog, rig: StereoRig, config: Config, selection: Selection, until_a_change: bool = False
) -> tuple[RigEstimate | None, list[str]]:
    """What the frames of a log tell about the errors of the rig, as it is in the end, and why they cannot tell
    anything, such as exchanged cameras. None where they do not, or no frame was estimated.

    `until_a_change`: as it is at first.
    """
    engine, latest = Engine(rig, config), None
    check = CalibrationSink(log, announced=False)
    frames = prepared_ahead(engine, log.frames(selection))
    try:
        for frame, prepared in frames:
            try:
                estimate = engine.step(frame, prepared)
            except FrameError:
                continue
            if until_a_change and estimate.rig_change is not None:
                break
            latest = estimate.rig or latest
            check.write(estimate, frame)
            if check.problems:
                break
    finally:
        frames.close()
    check.close()
    return (None if check.problems else latest), check.problems


def _same(a: StereoRig, b: StereoRig) -> bool:
    return replace(a, refinement=None).to_toml() == replace(b, refinement=None).to_toml()
