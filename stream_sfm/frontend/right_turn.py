"""Detects a right camera that is knocked out of alignment during a run, and corrects a turn that persists.

Depths and motion predict where points are seen on the right, and the calibration predicts their rows. A small turn of
the right camera shifts all of them, eq. (72d), by a field with three unknowns that is the same for near and far points.
It is estimated in every frame together with the motion. A few hundredths of a milliradian are usual. Real rigs that
vibrate or are not quite synchronous have more, so a turn is compared with the usual turns of the same run.

The motion of a frame with an unusual turn is estimated from the left image, with the depths that are known from before.
Once three such frames in a row have shown the same turn, all further measurements on the right are corrected for it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config import RobustConfig
from ..config.rules import TurnRules
from ..geometry import Array
from ..geometry.linear import symmetric
from ..geometry.medians import MEMORY_FRAMES
from ..geometry.point_views import PointViews
from ..geometry.stereo import StereoProjection, places_over_image
from ..record import changed, record
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import RigModel
from ..rig_model.terms import TERMS, effects_of_turn, terms_of_turn
from ..types import RigChange


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
    return changed(
        estimate, mean=estimate.mean + turned, mean_if_wrong=estimate.mean_if_wrong + turned, p_wrong=1.0
    )


@record
class TurnWatch:
    """Statistics of a run's turns.

    `usual` (3, 3): the covariance of measured usual turns; `real` (3, 3): the same without measurement noise, with the
    root `root`; `frames`: how many they are learnt from. `settings`: for the gate of its views. `unusual`: the unusual
    turns (3,) of the latest consecutive frames.
    """

    projection: StereoProjection
    rules: TurnRules
    settings: RobustConfig
    usual: Array
    real: Array
    root: Array
    frames: int
    unusual: tuple[Array, ...] = ()

    @classmethod
    def begun(cls, projection: StereoProjection, rules: TurnRules) -> "TurnWatch":
        """Return the watch before any frame."""
        guess = np.eye(3) * rules.first_guess_rad**2
        settings = RobustConfig(gate_probability=rules.gate)
        return cls(projection, rules, settings, guess, guess, _root(guess), rules.guess_frames)

    @property
    def lasting_rad(self) -> Array | None:
        """The turn (3,) that the latest frames have in common; None if they differ or are too few."""
        if len(self.unusual) < self.rules.lasting_frames:
            return None
        latest = np.array(self.unusual[-self.rules.lasting_frames :])
        mean = latest.mean(axis=0)
        apart = np.linalg.norm(latest - mean, axis=1).max()
        return mean if apart < self.rules.same * np.linalg.norm(mean) else None

    def calm(self) -> "TurnWatch":
        """Return the watch without its unusual turns, which are corrected now or have no track left to show them."""
        return changed(self, unusual=())

    def judge(
        self,
        points: Array,
        cov_points: Array,
        z_px: Array,
        cov_px: Array,
        cam_from_previous: Array,
        cov_expected: Array,
    ) -> tuple["TurnWatch", NDArray[np.bool_] | None]:
        """Return the watch after a frame, and which views (n,) agree with its turn if that is unusual, else None.

        `points` (n, 4) are homogeneous, in the previous camera, with covariances (n, 4, 4). Their views `z_px` (n, 4)
        in this frame have covariances (n, 4, 4); none of them was rejected for its row. The motion may be approximate.
        `cov_expected` (3, 3): of apparent turns that unknown delay and rows cause.
        """
        rules = self.rules
        n_seen = np.count_nonzero(np.isfinite(z_px[:, 2]))
        if n_seen < rules.min_views:
            return self.calm(), None
        views = PointViews(self.projection, points, cov_points, z_px, cov_px, self.settings)
        usual = self.usual + cov_expected
        rad, cov, agree, log_factor, chi2 = core.fit_turn(views, cam_from_previous, usual, rules)
        possible = self.projection.f_px * math.hypot(*rad) < rules.max_turn_px
        possible = possible and bool(np.count_nonzero(agree) > rules.agree * n_seen)
        stands_out = possible and log_factor > -math.log(rules.knocks)
        if not stands_out or len(self.unusual) >= rules.patience_frames:
            return self._learnt(rad, cov + cov_expected, stands_out, chi2), None
        return changed(self, unusual=(*self.unusual, rad)), agree

    def _learnt(self, rad: Array, cov: Array, stands_out: bool, chi2: float) -> "TurnWatch":
        """Return the watch after a frame whose turn (3,) counts as usual, even if it stands out.

        It was measured with `cov` (3, 3). The covariance of real turns follows by expectation maximisation (Dempster,
        Laird and Rubin 1977).
        """
        square, counts = np.outer(rad, rad), 1.0 if chi2 < self.rules.limit else self.rules.limit / chi2
        if stands_out:
            real = self.real + square
            return changed(self, usual=self.usual + square, real=real, root=_root(real), unusual=())
        frames = min(self.frames + 1, MEMORY_FRAMES)
        gain = np.linalg.solve(self.real + cov, self.real).T
        expected = symmetric(counts * gain @ square @ gain.T + self.real - gain @ self.real)
        real = self.real + (expected - self.real) / frames
        return changed(
            self,
            usual=self.usual + (counts * square - self.usual) / frames,
            real=real,
            root=_root(real),
            frames=frames,
            unusual=(),
        )


def _root(cov: Array) -> Array:
    """Return a root (3, 3) of a covariance (3, 3)."""
    return np.asarray(np.linalg.cholesky(cov), np.float64)
