"""The tracks found in a frame with all that is known about them, from which its motion is estimated."""

import math

import numpy as np

from .. import core
from ..geometry import Array
from ..geometry.point_views import PointViews
from ..geometry.robust_rules import RobustRules
from ..geometry.view_stages import CorrectedViews
from ..record import record
from ..rig_model.terms import by_turn
from .aligned_views import AlignedViews
from .learnt.usual_turns import ApparentTurns
from .rough_motion import RoughMotion
from .rules import MotionRules
from .state import FrontEndState
from .step import Step
from .tracks import Tracks

_NONE = np.zeros(0)


@record
class Seen:
    """The tracks (n) that were found in a frame: their rows `before`, their `views` now, and `point_views`.

    `weights` (n,): their votes; `weight`: the sum of votes of all tracks that should have been found. `apparent_turns`:
    apparent turns of the right camera, None for an exact rig. `amplitudes` (j,): of the shared errors, from which the
    motion is sought; None for zero.
    """

    before: Tracks
    views: AlignedViews
    point_views: PointViews
    weights: Array
    weight: float
    apparent_turns: ApparentTurns | None = None
    amplitudes: Array | None = None

    @classmethod
    def of(
        cls,
        step: Step,
        state: FrontEndState,
        rough: RoughMotion,
        twist: Array,
        views: AlignedViews,
        turn: Array = _NONE,
    ) -> "Seen":
        """Return the tracks that were found, near a rough motion, with a `twist` (6,) of the points.

        `turn` (e,): the amplitudes of a turn of the right camera from which the motion is sought; none for zero.

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
        unknown_px = apparent_turns = amplitudes = None
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
            std_rad = math.hypot(state.timing.mean[0], var_delay_s2**0.5) * step.std_turning(state.turning_error)
            apparent_turns = ApparentTurns(cov_turn, twist[3:], var_delay_s2, std_rad)
            of_turn = by_turn(setup.projection, views.z_px, state.turn_root)
            unknown_px = np.concatenate([of_timing, of_disparity, of_turn], axis=2)
            amplitudes = np.concatenate([np.zeros(unknown_px.shape[2] - len(turn)), turn])
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
        return cls(before, views, point_views, weights[views.rows], weight, apparent_turns, amplitudes)
