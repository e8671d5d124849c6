"""The tracks found in a frame with all that is known about them, from which its motion is estimated."""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array
from ..geometry.point_views import PointViews
from ..geometry.robust_rules import RobustRules
from ..geometry.view_stages import CorrectedViews, TimedViews
from ..record import changed, record
from ..rig_model.terms import by_turn
from .aligned_views import AlignedViews
from .learnt.usual_turns import ApparentTurns
from .rough_motion import RoughMotion
from .rules import MotionRules
from .state import FrontEndState
from .step import Step
from .tracks import Tracks

_LEFT = np.array([True, True, False, False])


@record
class Seen:
    """The tracks (n) that were found in a frame: their rows `before`, their `views` now, and `point_views`.

    `weights` (n,): their votes; `weight`: the sum of votes of all tracks that should have been found. `apparent_turns`:
    apparent turns of the right camera, None for an exact rig. `turned` (n,): which views agree with an unusual turn, if
    the motion is sought from the left sides alone.
    """

    before: Tracks
    views: AlignedViews
    point_views: PointViews
    weights: Array
    weight: float
    apparent_turns: ApparentTurns | None = None
    turned: NDArray[np.bool_] | None = None

    @classmethod
    def of(cls, step: Step, state: FrontEndState, rough: RoughMotion, twist: Array, views: AlignedViews) -> "Seen":
        """Return the tracks that were found, near a rough motion, with a `twist` (6,) of the points.

        Errors that all views share are those of delay, readout, rows and disparity, and finally of a turn of the right
        camera.
        """
        setup, motion = step.setup, rough.cam_from_previous
        before, weights = state.tracks.keep(views.rows), state.tracks.weights(setup.rules.of(MotionRules))
        drift_px = setup.rules.of(MotionRules).slides_most * core.template_drift(
            views.points, motion, before.scale, setup.slide_px
        )
        cov_points = before.cov_points(setup.projection, drift_px)
        known_px: Array | float = 0.0
        unknown_px = apparent_turns = None
        if state.turn_watch is not None and state.disparity is not None:
            known_px, of_disparity = state.disparity.effects(before.points, motion, views.z_px)
            of_rig = state.timing, state.rows_with_delay
            seen, std_twist = (before.points, views.points, views.z_px), setup.std_acceleration * step.dt_s
            of_timing, cov_turn = core.unknown_errors(*of_rig, *seen, twist, std_twist)
            var_delay_s2 = float(state.timing.cov[0, 0])
            if step.by_inertia is not None and state.timing.twist is not None:
                # points contain turns of earlier frames, which two frames smooth but a gyroscope resolves
                earlier = state.timing.twist[3:]
                cov_turn = cov_turn + var_delay_s2 * np.outer(earlier, earlier)
            apparent_turns = ApparentTurns(cov_turn, twist[3:], var_delay_s2)
            of_turn = by_turn(setup.projection, views.z_px, state.turn_root)
            unknown_px = np.concatenate([of_timing, of_disparity, of_turn], axis=2)
        point_views = PointViews(
            setup.projection,
            before.points,
            cov_points,
            CorrectedViews(views.z_px - known_px),
            views.cov_px,
            setup.rules.of(RobustRules),
            unknown_px,
        )
        weight = float(weights[views.in_view].sum())
        return cls(before, views, point_views, weights[views.rows], weight, apparent_turns)

    def by_left(self, turned: NDArray[np.bool_]) -> "Seen":
        """Return the same without right sides; `turned` (n,): the views whose right sides agree with a turn."""
        views = changed(self.views, z_px=TimedViews(np.where(_LEFT, self.views.z_px, np.nan)))
        return changed(self, views=views, point_views=self.point_views.by_left(), turned=turned)

    @property
    def found_px(self) -> TimedViews:
        """The views (n, 4) for the check of left against right, with the right sides that agree with a turn."""
        if self.turned is None:
            return self.views.z_px
        return TimedViews(np.where(self.turned[:, None], self.views.any_row_px, self.views.z_px))
