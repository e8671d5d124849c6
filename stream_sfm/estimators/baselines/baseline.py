"""The common part of the baselines: how their maps begin, continue and are lost."""

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...geometry import Array, se3
from ...geometry.point_views import PointViews
from ...geometry.resection import Resection
from ...geometry.robust_rules import RobustRules
from ...geometry.stereo import StereoProjection
from ...geometry.view_stages import CorrectedViews, RawViews
from ...rig_model.terms import by_turn
from ...types import Observations, Solution, Status
from ..initial_motion import initial_motion
from ..lifecycle import LostError, WorldPoints, first_solution, lost_solution, recorded, too_few_inliers
from ..motion_model import MotionModel


class Baseline(ABC):
    """An estimator (see `Estimator`) that begins maps with `_begin` and continues them with `_advance`."""

    name: str

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._projection = projection
        self._config, self._robust = config, config.rules.of(RobustRules)
        self._motion = MotionModel(config.motion)
        self._structure: WorldPoints | None = None  # the points that end if the map is lost; None: there is no map

    def step(self, observations: Observations) -> Solution:
        """Process the next frame; see `Estimator.step`."""
        observations = _without_turn(self._projection, observations)
        try:
            if self._structure is not None:
                return recorded(self._motion, observations, *self._advance(observations, self._structure))
            solution = first_solution(self._projection, self._robust, self._motion, observations)
            if solution.status is Status.INITIALISING:
                self._structure = self._begin(observations, solution)
            return solution
        except np.linalg.LinAlgError:
            reason = "the points that are left do not determine the motion"
        except LostError as lost:
            reason = str(lost)
        ended, self._structure = self._structure, None
        return lost_solution(observations, reason, *self._motion.predict(observations.stamp_ns), ended)

    @abstractmethod
    def _begin(self, obs: Observations, first: Solution) -> WorldPoints:
        """Begin a map in the camera of `first`, and return its structure."""

    @abstractmethod
    def _advance(self, obs: Observations, before: WorldPoints) -> tuple[Solution, WorldPoints]:
        """Return the estimate of a frame and the points that end with it; `before`: the structure until now.

        Raises LostError or LinAlgError if the map cannot continue.
        """

    def _initial_motion(
        self, obs: Observations, rows: NDArray[np.intp], points: Array, cov: Array, world_from_previous: Array
    ) -> Resection:
        """Find the motion since the previous camera from points (n, 3) there; see `initial_motion`."""
        predicted, _ = self._motion.predict(obs.stamp_ns)
        start, robust = se3.inverse(predicted) @ world_from_previous, self._robust
        views = PointViews(self._projection, points, cov, CorrectedViews(obs.z_px[rows]), obs.cov_px[rows], robust)
        found = initial_motion(views, obs, start)
        if found is None:
            raise LostError(too_few_inliers(0, len(rows), robust))
        return found


def _without_turn(projection: StereoProjection, observations: Observations) -> Observations:
    """Return the observations without a turn of the right camera that is larger than those before."""
    rig = observations.rig
    if rig is None or not len(rig.turn):
        return observations
    turned_px = by_turn(projection, observations.z_px, (rig.turn_root @ rig.turn)[:, None])[..., 0]
    return replace(observations, z_px=RawViews(observations.z_px - turned_px))
