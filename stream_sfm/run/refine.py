"""Refines the calibration of a rig by what replays of its logs find, and checks it on frames it was not made from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..camera.calibration.document import Where
from ..camera.refinement import LENS_TERMS, LENSES, KnownTiming, Refinement, combine
from ..camera.rig import StereoRig
from ..camera.settings import SETTINGS
from ..config import Config
from ..errors import ConfigError, LogError
from ..frontend.learnt.row_turn import turn_by_rows
from ..geometry import se3
from ..inertial.state import AXES, CLOCK, SCALE
from ..logs.recording.stereo_log import open_log
from ..report.inertia import fixed_error, inertial_findings
from ..report.motions import not_shown, shows_focal
from ..rig_model.estimate import CERTAIN, RigEstimate, is_certain
from ..rig_model.terms import AT_TIMING, TERMS, prior_std
from ..types import InertialEstimate, Selection
from .held_back import checked, worse
from .looks import Look, look
from .mending import focal_of, together, with_longer_focal, with_right_turned


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RefinedRig:
    """The `rig` with what was refined, and replays of each log `before` and `after`.

    `notes`: sentences about what is written, how it was checked, what is refused and why, and what no motion showed;
    `of_unit`: sentences about the inertial unit, by log.
    """

    rig: StereoRig
    before: tuple[Look, ...]
    after: tuple[Look, ...]
    notes: tuple[str, ...]
    of_unit: tuple[tuple[str, ...], ...]

    def __repr__(self) -> str:
        return f"<RefinedRig from {len(self.before)} logs: {self.rig.refinement!r}>"


def refine(
    logs: Sequence[str | Path],
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    calibration: Where | StereoRig | None = None,
) -> RefinedRig:
    """Refine the calibration that the logs share, or the given one. Their cameras must be the same.

    Rows that differ become a turn of the right camera, and a certain focal length is written to both. Errors of
    disparity and lenses become a refinement, as far as they help frames from which they were not made: other logs, or
    the other half of a single one. Anything with which the whole replay becomes worse is refused, with the reason.

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
    for log in opened:
        if replace(log.stereo_rig, refinement=None, timing=None).to_toml() != rig.to_toml():
            raise ConfigError(
                f"{log.path} has other cameras, or another calibration, than {opened[0].path}: "
                "all logs that refine a calibration must have this calibration"
            )
    refining = _Refining(rig, [log.path for log in opened], config, selection)
    refining.mend_rows()
    refining.mend_focal()
    if problems := [problem for of in refining.looks for problem in of.summary["problems"]]:
        raise LogError("; ".join(problems), hint=("left", "right", "calibration", "inspect"))
    refining.refine_lenses()
    return refining.result()


class _Refining:
    """The calibration so far, `rig`, the replays of all logs with it, `looks`, and `notes` on it."""

    def __init__(self, rig: StereoRig, paths: Sequence[Path], config: Config, selection: Selection | None) -> None:
        self.rig, self._paths, self._config, self._selection = rig, paths, config, selection
        self.looks = self.before = self._look(rig)
        self.notes: list[str] = []

    @property
    def _estimates(self) -> list[RigEstimate]:
        return [of.rig for of in self.looks if of.rig is not None]

    def _look(self, rig: StereoRig) -> list[Look]:
        return [look(open_log(path, calibration=rig), self._config, self._selection) for path in self._paths]

    def _take(self, rig: StereoRig, name: str) -> bool:
        """Use a rig for what follows, unless one of the logs becomes worse; returns whether it is used."""
        looks = self._look(rig)
        for plain, of in zip(self.looks, looks, strict=True):
            if why := worse(plain, of):
                self.notes.append(f"{name}: not written, as with it {of.path.name} becomes worse: {why}")
                return False
        self.rig, self.looks = rig, looks
        return True

    def mend_rows(self) -> None:
        """Turn the right camera so that rows agree."""
        first = self.rig
        for _ in range(SETTINGS.row_rounds):
            turn = turn_by_rows([of.rows for of in self.looks])
            if not turn.is_real or not self._take(with_right_turned(self.rig, turn.rad), "rows"):
                break
        if self.rig is not first:
            by = se3.log(self.rig.right_from_left @ se3.inverse(first.right_from_left))[3:]
            self.notes.append(
                f"rows: the right camera is turned by {np.degrees(np.linalg.norm(by)):.3f}°; they differed by "
                f"{_rms([of.rows.rms_px for of in self.before]):.2f} px, and now by "
                f"{_rms([of.rows.rms_px for of in self.looks]):.2f} px"
            )

    def mend_focal(self) -> None:
        """Write a certain focal length into both cameras, if runs with it find none."""
        share, std = focal_of(self._estimates)
        name = "focal length"
        if share and self._take(with_longer_focal(self.rig, share), name):
            self.notes.append(f"{name}: {100 * share:+.2f} ± {100 * std:.2f} %, written to K")

    def refine_lenses(self) -> None:
        """Add a refinement of disparity and lenses, as far as held-back frames are better with it, and the timing."""
        known = [of for of in self.looks if of.rig is not None]
        if not known:
            self.notes.append("no frame was tracked, so nothing was learnt")
            return
        timing = timing_of(self._estimates, self._config)
        rig = replace(self.rig, timing=timing)
        prior_px = prior_std(self._config.rig)[: len(LENS_TERMS)]

        def of_looks(looks: Sequence[Look]) -> Refinement:
            estimates = [of.rig for of in looks if of.rig is not None]
            std_px = np.array([e.prior_std[: len(LENS_TERMS)] for e in estimates])
            return combine([e.refinement for e in estimates], std_px, prior_px)

        def again(of: Look, refinement: Refinement | None, selection: Selection) -> Look:
            with_it = replace(rig, refinement=refinement)
            return look(open_log(of.path, calibration=with_it), self._config, selection)

        found = checked(known, again, of_looks)
        self.notes += found.notes
        parts = found.parts
        if LENSES in parts and not any(shows_focal(estimate) for estimate in self._estimates):
            parts = [part for part in parts if part != LENSES]
            self.notes.append(
                "lenses of both cameras: not written, as a focal length that is not shown looks like them"
            )
        refinement = of_looks(known).only(parts, prior_px) if parts else None
        if found.why:
            self.notes.append(f"no refinement of disparity and lenses: {found.why}")
        name = "refinement" if timing is None else "refinement and timing"
        taken = bool(refinement or timing) and self._take(replace(rig, refinement=refinement), name)
        if taken and refinement is not None:
            differ, usual_px = "how much the logs differ", SETTINGS.logs_differ * prior_px[0]
            if len(known) == 1:
                differ = (
                    f"what logs of one rig usually differ by ({usual_px:.2f} px in each term), as there is only one"
                )
            self.notes.append(f"σ of the refinement contains {differ}")

    def result(self) -> RefinedRig:
        """Return the rig with the findings about its inertial unit as well, and all that was notes."""
        units = [of.unit for of in self.looks]
        rig = with_unit(self.rig, [unit for unit in units if unit is not None])
        of_unit = tuple(() if unit is None else tuple(inertial_findings(unit)) for unit in units)
        notes = (*self.notes, *not_shown(self._estimates, self._config))
        return RefinedRig(rig, tuple(self.before), tuple(self.looks), notes, of_unit)


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def timing_of(estimates: Sequence[RigEstimate], config: Config) -> KnownTiming | None:
    """Return delay and readout from independent runs; None if no run is certain of either, and agrees in its thirds."""
    values: list[float] = []
    certain = False
    for term in range(len(TERMS))[AT_TIMING]:
        mean, var = np.array([(e.mean[term], e.cov[term, term]) for e in estimates]).T
        sure = (mean**2 > CERTAIN**2 * var) & np.array([e.agrees((TERMS[term],)) for e in estimates])
        values += together(mean[sure], var[sure]) if sure.any() else (0.0, float(prior_std(config.rig)[term]))
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
