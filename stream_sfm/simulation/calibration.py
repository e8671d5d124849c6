"""Study: the quality of estimates if the calibration is wrong and errors of views last along their tracks.

The rig errors are drawn from the priors in `rig.…`. The window learns them, and how long errors last, from the views
alone; it is compared with windows that assume an exact rig, white errors, or both. The bound has the same
unknowns, eqs. (76) and (77).
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..camera.refinement import LENS_TERMS
from ..config import Config
from ..estimators import make_estimator
from ..estimators.baselines.full_batch import cramer_rao_bound
from ..frontend.learnt.template_errors import TemplateErrors
from ..geometry import Array
from ..rig_model.model import RigModel
from ..types import LastingErrors, Observations, RigView, Solution
from .measure import Measured, bound_variances, errors, followed
from .scenes import Scene, Sequence
from .studies import Condition, Report, mean, of_conditions, ratio

QUANTITIES = ("rotation", "position", "local_structure")
EXPECTED = dict.fromkeys(QUANTITIES, 1.0) | {"nees_pose": 6.0, "nees_rig": float(len(LENS_TERMS))}


@dataclass(frozen=True, slots=True)
class Window:
    """The default estimator, with or without a model of rig errors and of lasting errors of views."""

    label: str
    rig: bool
    lasting: bool

    def observations_for(self, observations: Observations) -> Observations:
        """Return the observations with the knowledge of this window."""
        return replace(
            observations,
            rig=observations.rig if self.rig else None,
            lasting=observations.lasting if self.lasting else LastingErrors(),
        )


WINDOWS = (
    Window("cross-frame", rig=True, lasting=True),
    Window("errors as white", rig=True, lasting=False),
    Window("rig as exact", rig=False, lasting=True),
    Window("rig as exact, errors as white", rig=False, lasting=False),
)
_OF_EXACT_RIG = tuple(replace(w, rig=False) for w in WINDOWS[:2])  # for a rig that is exact


def seen_by_wrong_rig(sequence: Sequence, error: Array) -> tuple[Observations, ...]:
    """Return observations by a rig with errors (m,), in σ of its prior, with all additions of a front-end."""
    model = RigModel.of(sequence.projection, Config().rig)
    errors, result = TemplateErrors(), []
    amplitudes = np.concatenate([error, np.zeros(len(model) - len(error))])
    for o in sequence.observations:
        z_px = o.z_px
        # Iterations towards the view with rig errors; each step is a hundredth of the previous one.
        for _ in range(4 if error.any() else 0):
            z_px = o.z_px + model.effects(z_px) @ amplitudes
        errors = errors.after(o.track_ids, z_px, o.cov_px)
        result.append(replace(o, z_px=z_px, rig=RigView(model), lasting=LastingErrors(None, errors.inflation)))
    return tuple(result)


def measure(seed: np.random.SeedSequence, scene: Scene, wrong_rig: bool, frames: tuple[int, ...]) -> Measured:
    """Run one trial, and return label -> quantity -> values at `frames`, NaN where one was lost.

    `wrong_rig`: whether the rig has errors drawn from its prior. The variances of the bound are under "bound".
    """
    of_scene, of_rig = seed.spawn(2)
    sequence = scene.sequence(of_scene)
    error = np.random.default_rng(of_rig).normal(size=len(LENS_TERMS)) * wrong_rig
    observations = seen_by_wrong_rig(sequence, error)

    def figures(frame: int, solution: Solution) -> dict[str, float]:
        return errors(sequence, frame, solution) | {"nees_rig": _nees_rig(solution, error)}

    result = {}
    for window in WINDOWS if wrong_rig else _OF_EXACT_RIG:
        estimator = make_estimator("cross-frame", sequence.projection, Config())
        given = [window.observations_for(o) for o in observations]
        result[window.label] = followed(estimator, given, frames, tuple(EXPECTED), figures)
    known = observations if wrong_rig else tuple(replace(o, rig=None) for o in observations)
    rho, truth = scene.autocorrelation, (sequence.world_from_cam, sequence.points_in_world)
    bounds = [cramer_rao_bound(sequence.projection, known, *truth, n, rho) for n in frames]
    result["bound"] = {q: v for q, v in bound_variances(bounds).items() if q in QUANTITIES}
    return result


def _nees_rig(solution: Solution, error: Array) -> float:
    """Return the normalised squared error of the estimated rig; NaN without an estimate."""
    if solution.rig is None:
        return np.nan
    n = len(error)
    away = solution.rig.mean_if_wrong[:n] - error
    return float(away @ np.linalg.solve(solution.rig.cov_if_wrong[:n, :n], away))


def condition(
    scene: Scene, wrong_rig: bool, frames: tuple[int, ...] = (10, 15, 20, 25, 30), share: float = 1.0
) -> Condition:
    trial = partial(measure, scene=scene, wrong_rig=wrong_rig, frames=frames)
    return Condition(trial, share, scene=scene, frames=frames)


# Row differences of real rigs scatter by 0.12 to 0.16 px.
_SCENE = Scene(track_length=8, std_px=0.15, round_off=False)
_LASTING = replace(_SCENE, autocorrelation=0.75)
CONDITIONS = {
    "wrong_rig_lasting_errors": condition(_LASTING, wrong_rig=True),
    "wrong_rig": condition(_SCENE, wrong_rig=True, share=0.5),
    "lasting_errors": condition(_LASTING, wrong_rig=False, share=0.5),
}


def _over_bound(entry: dict[str, Array], data: Measured) -> Report:
    """Return the variance of a window over the bound, and its normalised errors."""
    known = {q: mean(entry[q]) for q in ("nees_pose", "nees_rig") if np.isfinite(entry[q]).any()}
    return {"over_bound": {q: ratio(entry[q], data["bound"][q]) for q in QUANTITIES}, **known}


CALIBRATION = of_conditions(CONDITIONS, _over_bound, expected=EXPECTED)
