"""The monocular cross-frame window: how its map begins, and its reports about the scale.

Views are 2-vectors; everything else is `CrossFrame`. The joint prior carries the scale from point to point, in units of
the first baseline. The scale drifts, and the covariances include the drift.
"""

from dataclasses import replace

from ...config import Config
from ...geometry.robust_rules import RobustRules
from ...geometry.stereo import StereoProjection
from ...types import Observations, Solution, Status
from .cross_frame import CrossFrame

_UNIT = "the first depths are known: the distance to the first frame is the unit of length"
_SAME_SCENE = "new map at the predicted pose, its unit such that the scene is as far away as before"


class CrossFrameMono:
    """The monocular estimator (see `Estimator`); its maps begin at `Observations.start`."""

    name = "cross-frame"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self.projection = projection
        self.config = config
        self.window = CrossFrame(projection, config)
        self.ever_mapped = False
        self.has_map = False

    def step(self, observations: Observations) -> Solution:
        """Process the next frame; see `Estimator.step`. The status is initialising until the first depths are known."""
        if observations.start is None or not self.has_map:
            solution = self._start(observations)
        else:
            solution = self._advance(observations)
        self.has_map = observations.start is not None and solution.status != Status.LOST
        self.ever_mapped |= self.has_map
        if not self.ever_mapped:
            return replace(solution, status=Status.INITIALISING)
        return solution

    def _start(self, observations: Observations) -> Solution:
        """Begin a map once the front-end knows depths; until then the frame is lost."""
        start = observations.start
        if start is None:
            return replace(self.window.step(observations), reason=observations.note)
        if not self.ever_mapped:
            self.window = CrossFrame(self.projection, self.config)
            self.window.motion.restart(observations.stamp_ns, start.first_from_cam, start.cov_first_from_cam)
        solution = self.window.step(replace(observations, z_px=start.z_px, cov_px=start.cov_px))
        if solution.status == Status.INITIALISING:
            return replace(solution, reason=_SAME_SCENE if self.ever_mapped else _UNIT)
        return solution

    def _advance(self, observations: Observations) -> Solution:
        """Estimate the next frame; it is degraded if few depths carry the scale."""
        solution = self.window.step(observations)
        known, needed = len(solution.track_ids), self.config.rules.of(RobustRules).degraded_inliers
        if solution.status == Status.OK and known < needed:
            reason = f"the depth of only {known} points is known (fewer than {needed}): the scale may change"
            return replace(solution, status=Status.DEGRADED, reason=reason)
        return solution
