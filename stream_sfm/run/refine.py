"""Refines the calibration of a rig from logs: what each run has learnt about its errors, put together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..blas import one_thread
from ..camera.calibration.read import Where
from ..camera.known_timing import KnownTiming
from ..camera.rectification import Rectifier
from ..camera.refinement import TERMS, Refinement, combine
from ..camera.rig import StereoRig
from ..config import Config
from ..errors import ConfigError, LogError
from ..interrupts import Interruption
from ..observer import Observer
from ..recording import StereoLog, open_log
from ..report.calibration_field import describe
from ..rig_model.estimate import RigEstimate
from ..rig_model.terms import DELAY, READOUT, prior_std
from ..rig_model.terms import TERMS as TERMS_OF_RIG
from ..types import Frame, FrameEstimate, Selection
from .calibration import CalibrationSink
from .lane import Lane
from .loop import Enough, run

# σ that a refinement is given when the same frames are used once more, in units of its own: they count twice then, and
# with this their second say is a quarter of the first.
_USED_AGAIN = 2.0
_LOOK_FRAMES = 60  # some seconds, in which most cameras turn
_CERTAIN = 5.0  # σ from which on a delay or a readout is written down


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
    rig = replace(opened[0].stereo_rig, refinement=None, timing=None)
    for log in opened[1:]:
        if replace(log.stereo_rig, refinement=None, timing=None).to_toml() != rig.to_toml():
            raise ConfigError(
                f"{log.path} has other cameras, or another calibration, than {opened[0].path}: "
                "logs that refine one calibration must have it in common"
            )
    estimates = tuple(_learn_or_refuse(log, rig, config, selection or Selection()) for log in opened)
    known = [e for e in estimates if e is not None]
    if not known:
        return RefinedRig(rig, estimates)
    n = len(TERMS)
    priors_px = np.array([e.prior_std[:n] for e in known])
    refinement = combine([e.refinement for e in known], priors_px, prior_std(config.rig)[:n])
    return RefinedRig(replace(rig, refinement=refinement, timing=timing_of(known, config)), estimates)


def first_look(log: StereoLog) -> dict[str, Any] | None:
    """What the first frames of a log tell about the errors of its rig, as `rig` of summary.json; None: nothing."""
    estimate = _learn(log, log.stereo_rig, Config(), Selection(max_frames=_LOOK_FRAMES)).latest
    return None if estimate is None else describe(Rectifier(log.stereo_rig).projection, estimate)


def refined_for_itself(log: StereoLog, config: Config, selection: Selection) -> StereoRig:
    """The rig of a log, refined by the same frames that are going to be estimated with it; as it is if it is right.

    Where the right camera is turned on the way, by the frames before: the turn is found in the second run, too.
    """
    check_calibrates(config)
    learnt = _learn(
        log, replace(log.stereo_rig, refinement=None, timing=None), config, selection, until_a_change=True
    )
    estimate = learnt.latest
    if learnt.problems or estimate is None:
        return log.stereo_rig
    rig = replace(log.stereo_rig, timing=timing_of([estimate], config, _USED_AGAIN) or log.stereo_rig.timing)
    if not estimate.applied:
        return rig
    return replace(
        rig,
        refinement=Refinement(estimate.refinement.error_px, _USED_AGAIN**2 * estimate.refinement.cov_px2),
    )


def timing_of(estimates: Sequence[RigEstimate], config: Config, grown: float = 1.0) -> KnownTiming | None:
    """Delay and readout by independent runs, with `grown` times their σ; None where none is certain of either."""
    assumed, values, certain = prior_std(config.rig), [], False
    for term in (TERMS_OF_RIG.index(DELAY), TERMS_OF_RIG.index(READOUT)):
        mean, var = np.array([(e.mean[term], e.cov[term, term]) for e in estimates]).T
        told = mean**2 > _CERTAIN**2 * var
        if told.any():
            var_of_all = 1 / (1 / var[told]).sum()
            values += [float(var_of_all * (mean[told] / var[told]).sum()), float(grown * np.sqrt(var_of_all))]
            certain = True
        else:
            values += [0.0, float(assumed[term])]
    return KnownTiming(*values) if certain else None


def check_calibrates(config: Config) -> None:
    """Raise a ConfigError where calibrating is not possible with this configuration."""
    config.needs_scale("calibrate")
    if config.rig.exact:
        raise ConfigError("rig.exact says that the calibration has no error: leave it out to calibrate")
    if config.method != "cross-frame":
        raise ConfigError(f"the method {config.method} does not calibrate: use cross-frame")


def _learn_or_refuse(log: StereoLog, rig: StereoRig, config: Config, selection: Selection) -> RigEstimate | None:
    """What the frames of a log tell. Raises LogError where the calibration is wrong in ways that are not learnt."""
    learnt = _learn(log, rig, config, selection)
    if learnt.problems:
        raise LogError("; ".join(learnt.problems), hint=("left", "right", "calibration", "inspect"))
    return learnt.latest


class _Learner(CalibrationSink):
    """Keeps the `latest` estimate of the rig's errors, until there are `problems` that are not learnt."""

    def __init__(self, log: StereoLog, until_a_change: bool) -> None:
        super().__init__(log, announced=False)
        self._until_a_change = until_a_change
        self.latest: RigEstimate | None = None

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        if self._until_a_change and estimate.rig_change is not None:
            raise Enough
        self.latest = estimate.rig or self.latest
        super().write(estimate, frame)
        if self.problems:
            raise Enough


def _learn(
    log: StereoLog, rig: StereoRig, config: Config, selection: Selection, until_a_change: bool = False
) -> _Learner:
    """What the frames of a log tell about the errors of the rig; `until_a_change`: as it is at first."""
    learner = _Learner(log, until_a_change)
    with one_thread:
        lane = Lane(config, Observer(rig, config), None, None)
    course = run(log, [lane], [learner], selection=selection, interruption=Interruption())
    if (error := course.error or lane.error) is not None:
        raise error
    return learner
