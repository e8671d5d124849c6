"""Detects a right camera that is knocked out of alignment during a run, and corrects a turn that persists, eq. (72d).

A small turn shifts all right views by a field with three unknowns that is the same for near and far points. It is
estimated in every frame together with the motion, and compared with the usual turns of the same run: real rigs vibrate
or are not quite synchronous. A turn that is larger than those is where the resections of its frame begin, before any
view is gated, and views off their rows count if they agree with it. Once three frames in a row have shown the same
unusual turn, all further measurements on the right are corrected for it; otherwise they were usual turns of this rig.
"""

import math
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array
from ...geometry.point_views import PointViews
from ...geometry.robust_rules import RobustRules
from ...geometry.stereo import StereoProjection, places_over_image
from ...geometry.view_stages import CorrectedViews
from ...record import changed, record
from ...rig_model.estimate import RigEstimate
from ...rig_model.model import RigModel
from ...rig_model.terms import TERMS, effects_of_turn, terms_of_turn
from ...types import RigChange
from .usual_turns import ApparentTurns, Turn, TurnRules, UsualTurns


def shift_of_turn(projection: StereoProjection, rad: Array) -> float:
    """Return the RMS shift, px, of the right image by a turn (3,) of its camera."""
    return float(np.sqrt((_over_image(projection, rad) ** 2).sum(axis=1).mean()))


def rig_change(projection: StereoProjection, frame_index: int, rad: Array) -> RigChange:
    """Return the record of a turn (3,) of the right camera in a frame, with its effect on the images and depths."""
    disparity_px = float(np.sqrt((_over_image(projection, rad)[:, 0] ** 2).mean()))
    per_metre = disparity_px / (projection.f_px * projection.baseline_m)
    return RigChange(frame_index, rad, shift_of_turn(projection, rad), disparity_px, per_metre)


def _over_image(projection: StereoProjection, rad: Array) -> Array:
    """Return the shifts (n, 2) px of far points all over the image by a turn (3,)."""
    return np.asarray(effects_of_turn(projection, places_over_image(projection, 9, 9)) @ rad)


def with_turn(rig: RigModel, estimate: RigEstimate, rad: Array) -> RigEstimate:
    """Return an estimate in units of the terms, with a turn (3,) added for which the views were corrected."""
    turned = np.zeros(len(estimate.mean))
    turned[: len(TERMS)] = terms_of_turn(rig.projection) @ rad
    return changed(estimate, mean=estimate.mean + turned, mean_if_wrong=estimate.mean_if_wrong + turned, p_wrong=1.0)


@record
class TurnWatch:
    """The turns of a run.

    `usual`: those that are usual; `settings`: for the gate of views. `unusual`: the unusual turns of the latest
    consecutive frames. `larger_rad` (3,): the turn of the latest frame if it is larger than usual ones, else zero.
    """

    projection: StereoProjection
    rules: TurnRules
    settings: RobustRules
    usual: UsualTurns
    unusual: tuple[Turn, ...] = ()
    larger_rad: Array = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def begun(cls, projection: StereoProjection, rules: TurnRules) -> "TurnWatch":
        """Return the watch before any frame."""
        return cls(projection, rules, RobustRules(gate_probability=rules.gate), UsualTurns.begun(rules))

    @property
    def lasting_rad(self) -> Array | None:
        """The turn (3,) that the latest frames have in common; None if they differ or are too few."""
        if len(self.unusual) < self.rules.lasting_frames:
            return None
        latest = self.unusual[-self.rules.lasting_frames :]
        mean = np.mean([turn.rad for turn in latest], axis=0)
        apart = (changed(turn, rad=turn.rad - mean).distance2(self.usual.real) for turn in latest)
        return mean if max(apart) < self.rules.limit else None

    @property
    def unusual_rad(self) -> Array:
        """The turn (3,) of the latest frame if it is unusual, else zero."""
        return self.unusual[-1].rad if self.unusual else np.zeros(3)

    @property
    def root_left(self) -> Array:
        """A root (3, 3) of the covariance of the latest frame's turn without `unusual_rad`."""
        return np.asarray(np.linalg.cholesky(self.unusual[-1].cov)) if self.unusual else self.usual.root

    @property
    def larger(self) -> Array:
        """The amplitudes (3,) of the latest frame's turn by `usual.root`; none if it is no larger than usual."""
        if not self.larger_rad.any():
            return np.zeros(0)
        return np.asarray(np.linalg.solve(self.usual.root, self.larger_rad))

    def calm(self) -> "TurnWatch":
        """Return the watch without its unusual turns, which are corrected now or have no track left to show them."""
        return changed(self, unusual=(), larger_rad=np.zeros(3))

    def judge(
        self,
        points: Array,
        cov_points: Array,
        z_px: Array,
        cov_px: Array,
        cam_from_previous: Array,
        apparent: ApparentTurns,
    ) -> tuple["TurnWatch", NDArray[np.bool_] | None]:
        """Return the watch after a frame, and which views (n,) agree with its turn; None if it shows none.

        `points` (n, 4) are homogeneous, in the previous camera, with covariances (n, 4, 4). Their views `z_px` (n, 4)
        in this frame have covariances (n, 4, 4); none of them was rejected for its row. The motion may be approximate.
        `apparent`: the apparent turns by unknown errors of the rig.
        """
        rules = self.rules
        n_seen = np.count_nonzero(np.isfinite(z_px[:, 2]))
        if n_seen < rules.min_views:
            return self.calm(), None
        views = PointViews(self.projection, points, cov_points, CorrectedViews(z_px), cov_px, self.settings)
        rad, cov, agree, chi2 = core.fit_turn(views, cam_from_previous, self.usual.measured + apparent.cov, rules)
        turn = Turn(rad, cov, chi2, apparent)
        possible = self.projection.f_px * math.hypot(*rad) < rules.max_turn_px
        possible = possible and bool(np.count_nonzero(agree) > rules.agree * n_seen)
        usual, log_odds = self.usual.sized(turn)
        stands_out = possible and log_odds > -math.log(rules.knocks)
        if stands_out and len(self.unusual) < rules.patience_frames:
            return changed(self, usual=usual, unusual=(*self.unusual, turn), larger_rad=rad), agree
        larger = possible and turn.distance2(self.usual.root @ self.usual.root.T) > rules.limit
        for each in (*self.unusual, turn):  # this rig turns to and fro
            usual = usual.learnt(each)
        now = changed(self, usual=usual, unusual=(), larger_rad=rad if larger else np.zeros(3))
        return now, agree if possible else None
