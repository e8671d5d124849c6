"""Study: what estimates are worth where the calibration is wrong and errors of views last along their tracks.

The rig's errors are drawn from what `rig.…` assumes. The window learns them, and how long errors last, from the views
alone; beside it stand windows that take the rig for exact, the errors for white, or both. The bound has the same
unknowns, eqs. (76) and (77).
"""

from collections.abc import Callable
from collections.abc import Sequence as Listed
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..camera.refinement import TERMS
from ..config import Config
from ..estimators import make_estimator
from ..estimators.baselines.calibration_bound import bound_with_rig
from ..frontend.persistence import Persistence
from ..frontend.rig_effects import RigEffects
from ..geometry.se3 import Array
from ..types import Observations, Solution, Status
from . import conditions
from .conditions import Measured, Report, by_condition, lost_share
from .measure import errors, traces
from .scenes import Scene, Sequence
from .statistics import mean, ratio
from .trials import Progress

QUANTITIES = ("rotation", "position", "local_structure")
EXPECTED = dict.fromkeys(QUANTITIES, 1.0) | {"nees_pose": 6.0, "nees_rig": float(len(TERMS))}
_STEPS = 4  # to where a view is seen with errors of the rig, each a hundredth of the one before


@dataclass(frozen=True, slots=True)
class Window:
    """The default estimator, told of the rig's possible errors or not, and of how long errors last or not."""

    label: str
    rig: bool
    lasting: bool

    def told(self, observations: Observations) -> Observations:
        """Return the observations with what this window is told."""
        return replace(
            observations,
            rig_effects=observations.rig_effects if self.rig else None,
            rig_effects_at=observations.rig_effects_at if self.rig else None,
            inflation=observations.inflation if self.lasting else None,
        )


WINDOWS = (
    Window("cross-frame", rig=True, lasting=True),
    Window("errors as white", rig=True, lasting=False),
    Window("rig as exact", rig=False, lasting=True),
    Window("rig as exact, errors as white", rig=False, lasting=False),
)
_OF_EXACT_RIG = tuple(replace(w, rig=False) for w in WINDOWS[:2])  # which they are right to take for exact


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition(conditions.Condition):
    """What is wrong in a scene: the rig, by its prior, or not."""

    wrong_rig: bool

    @property
    def windows(self) -> tuple[Window, ...]:
        """The windows that differ under this condition."""
        return WINDOWS if self.wrong_rig else _OF_EXACT_RIG

    def job(self) -> Callable[[np.random.SeedSequence], Measured]:
        """Return the measurement of one sequence of the scene."""
        return partial(measure, condition=self)


# Row differences of real rigs scatter by 0.12 to 0.16 px.
_SCENE = Scene(track_length=8, std_px=0.15, round_off=False)
_LASTING = replace(_SCENE, autocorrelation=0.75)
_FRAMES = (10, 15, 20, 25, 30)
CONDITIONS = (
    Condition("wrong_rig_lasting_errors", _LASTING, _FRAMES, wrong_rig=True),
    Condition("wrong_rig", _SCENE, _FRAMES, share=0.5, wrong_rig=True),
    Condition("lasting_errors", _LASTING, _FRAMES, share=0.5, wrong_rig=False),
)


def seen_by_wrong_rig(sequence: Sequence, error: Array) -> tuple[Observations, ...]:
    """Return what a rig with errors (m,), in σ of what is assumed, sees of a scene, with all that a front-end adds."""
    model = RigEffects(sequence.projection, Config().rig, None)
    persistence, result = Persistence(), []
    for o in sequence.observations:
        z_px = o.z_px
        for _ in range(_STEPS if error.any() else 0):
            z_px = o.z_px + model.of(z_px) @ error
        inflation = persistence.inflation(o.track_ids, z_px, o.cov_px)
        effects = model.of(z_px)
        result.append(
            replace(
                o,
                z_px=z_px,
                rig_effects=effects,
                rig_effects_at=model.of,
                rig_of_disparity=model.of_disparity,
                inflation=inflation,
            )
        )
    return tuple(result)


def measure(seed: np.random.SeedSequence, condition: Condition) -> Measured:
    """Run one trial, and return label -> quantity -> values at the frames of the condition, NaN where one was lost.

    The variances of the bound are under "bound".
    """
    of_scene, of_rig = seed.spawn(2)
    frames = condition.frames
    sequence = condition.scene.sequence(of_scene)
    error = np.random.default_rng(of_rig).normal(size=len(TERMS)) * condition.wrong_rig
    observations = seen_by_wrong_rig(sequence, error)
    result = {w.label: _measure_one(w, sequence, observations, error, frames) for w in condition.windows}
    known = observations if condition.wrong_rig else tuple(replace(o, rig_effects=None) for o in observations)
    rho = condition.scene.autocorrelation
    bounds = [
        bound_with_rig(sequence.projection, known, sequence.world_from_cam, sequence.points_in_world, n, rho)
        for n in frames
    ]
    rows = [traces(bound, slice(None)) for bound in bounds]
    result["bound"] = {q: np.array([row[q] for row in rows]) for q in QUANTITIES}
    return result


def _measure_one(
    window: Window, sequence: Sequence, observations: Listed[Observations], error: Array, frames: Listed[int]
) -> dict[str, Array]:
    estimator = make_estimator("cross-frame", sequence.projection, Config())
    result = {name: np.full(len(frames), np.nan) for name in EXPECTED}
    for o in observations:
        solution = estimator.step(window.told(o))
        if o.frame_index in frames and solution.status is not Status.LOST:
            found = errors(sequence, o.frame_index, solution) | {"nees_rig": _nees_rig(solution, error)}
            for name in EXPECTED:
                result[name][frames.index(o.frame_index)] = found[name]
    return result


def _nees_rig(solution: Solution, error: Array) -> float:
    """Return the squared error of what is known about the rig, by its covariance; NaN where nothing is."""
    if solution.rig is None:
        return np.nan
    away = solution.rig.mean - error
    return float(away @ np.linalg.solve(solution.rig.cov, away))


def _evaluate(data: Measured) -> Report:
    bound = data["bound"]
    return {
        label: {
            "over_bound": {q: ratio(entry[q], bound[q]) for q in QUANTITIES},
            **{q: mean(entry[q]) for q in ("nees_pose", "nees_rig") if np.isfinite(entry[q]).any()},
            "lost_share": lost_share(entry),
        }
        for label, entry in data.items()
        if label != "bound"
    }


def calibration(
    trials: int,
    seed: int,
    executor: Executor | None,
    progress: Progress | None = None,
    conditions: tuple[Condition, ...] = (),
) -> Report:
    """Measure variance over the bound and normalised errors of the windows; by condition."""
    chosen = conditions or CONDITIONS
    parts = by_condition(chosen, _evaluate, trials, seed, executor, progress)
    by_name = {c.name: parts[c.name] | {"wrong_rig": c.wrong_rig} for c in chosen}
    return {"experiment": "calibration", "seed": seed, "expected": EXPECTED, "conditions": by_name}


def total_trials(trials: int) -> int:
    """Return how many trials the study runs altogether."""
    return conditions.total_trials(trials, CONDITIONS)
