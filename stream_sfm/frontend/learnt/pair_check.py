"""Checks whether left image, right image and calibration are consistent; section 8, "A pair that does not fit".

A camera may be frozen or knocked, or the cameras exchanged or not triggered together. Most of the left image may then
still move rigidly, but that motion need not be the camera's. Nearly all points whose left side agrees with it should be
found in the right image, where their depth predicts them. Points also vanish from the right image one by one when a
near object hides them. So points that were already missing in the last frame without a problem are no evidence.
"""

from dataclasses import field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...camera.rig import StereoRig
from ...config import Config
from ...config.section import Section, expert
from ...geometry import Array
from ...geometry.evidence import Evidence, ratio_of_share
from ...geometry.point_views import PointViews
from ...geometry.resection import MANY_VIEWS, Resection
from ...geometry.robust_rules import RobustRules
from ...geometry.stereo import StereoProjection, clamp_depth
from ...geometry.view_stages import CorrectedViews
from ...pictures.content import frozen
from ...pictures.prepared import PreparedImages
from ...record import changed, record
from ..tracks import Tracks
from .rows import Rows


class PairRules(Section, frozen=True, kw_only=True):
    """Whether the left image, the right image and the calibration fit each other."""

    # Sample logs have 0.64 or more, the end of a bare corridor less; a stopped, swapped or turned camera is below
    # 0.3.
    fit: Annotated[float, expert("share of the points agreeing on the left that agree on the right", 0, 1)] = 0.5
    # No moving body has as many by chance.
    fewest_old: Annotated[int, expert("least number of points from before a problem that end it", 1, 2000)] = 8
    # One frame with a problem has this evidence. New points that fit end it within a second for most cameras.
    bound_nats: Annotated[float, expert("evidence that begins or ends a problem, nats", 0.1, 1e6)] = 7.0
    memory_frames: Annotated[float, expert("frames over which new points show that images fit", 1, 1e6)] = 30.0
    # Twice as many agree where the images fit: half of the points say nothing, as near objects hide some.
    new_favour: Annotated[float, expert("a of eq. (7c) for new points and images that fit", 1.01, 1e4)] = 2.0
    good_share: Annotated[float, expert("share of all points that agree in a good frame", 0, 1)] = 0.6
    # With real calibrations, rows differ by up to 1.9 px in a corner.
    max_rows_px: Annotated[float, expert("largest row difference of left and right, px", 0.1, 1e8)] = 2.5
    # Real matches scatter around their polynomial by up to 0.3 px.
    max_scatter_px: Annotated[float, expert("largest scatter of the rows of matches, px", 0.05, 1e8)] = 0.5
    # It is 1.2 at most on any sample log, and 5 to 30 with a wrong calibration.
    max_factor: Annotated[float, expert("largest variance of views over that by image noise", 1, 1e8)] = 4.0
    # Principal points of real cameras are within 0.1 of the middle. In a calibration for half the resolution they
    # lie at a quarter of the size, for twice the resolution in the corner. In a cropped image they can be anywhere.
    same_place: Annotated[float, expert("share of the size by which a principal point may differ", 0, 0.5)] = 0.03


def _none() -> NDArray[np.int64]:
    return np.empty(0, np.int64)


@record
class Found:
    """The tracks (n) that were found in a frame, as they were `before` it.

    `z_px` (n, 4), `cov_px` (n, 4, 4): their views; `motion`: the motion found from these; `has_samples`: whether there
    are inertial samples that have agreed with the images for a while.
    """

    before: Tracks
    z_px: Array
    cov_px: Array
    motion: Resection
    has_samples: bool = False


@record
class PairFit:
    """How the tracks `ids` (n,) fit that were found in a frame and should be in the right image as well.

    `left` (n,): which agree with the motion in the left image; `both` (n,): which do in both images; `has_samples`: as
    in `Found`; `missing` (k,): ids of tracks that were not found in the right image.
    """

    ids: NDArray[np.int64]
    left: NDArray[np.bool_]
    both: NDArray[np.bool_]
    has_samples: bool = False
    missing: NDArray[np.int64] = field(default_factory=_none)

    @classmethod
    def of(cls, found: Found, projection: StereoProjection, config: Config, missed: NDArray[np.int64]) -> "PairFit":
        """Return the fit of the tracks found in a frame; `missed` (k,): ids of those missing on the right before."""
        motion, before, has_right = found.motion, found.before, np.isfinite(found.z_px[:, 2])
        right_px = projection.project_homogeneous(clamp_depth(before.points @ motion.cam_from_ref.T))[:, 2]
        margin_px = 2 * before.scale * config.frontend.window_radius_px
        inside = (right_px > margin_px) & (right_px < projection.width - 1 - margin_px)
        left, both = motion.accepted, motion.accepted & has_right
        if np.count_nonzero(both & inside) < config.rules.of(PairRules).good_share * np.count_nonzero(inside):
            points = before.points, before.cov_points(projection)
            left_px = CorrectedViews(np.where([True, True, False, False], found.z_px, np.nan))
            views = PointViews(projection, *points, left_px, found.cov_px, config.rules.of(RobustRules))
            root, _ = views.linearise(motion.cam_from_ref)
            left = left | (views.squared_residuals(motion.cam_from_ref, root) < motion.spread * views.gate)
        missing = before.ids[inside & ~has_right]
        counts = inside & (has_right | ~core.among(before.ids, missed))  # not those that are missing again
        return cls(before.ids[counts], left[counts], both[counts], found.has_samples, missing)


@record
class PairCheck:
    """The evidence so far: `problem` describes what is wrong, or is empty.

    `evidence`: that left and right do not fit each other. `first_id`: the first id of tracks that began during the
    problem. `missing` (k,): ids of tracks that were not found in the right image in the last frame without a problem.
    """

    evidence: Evidence
    problem: str = ""
    first_id: int = 0
    missing: NDArray[np.int64] = field(default_factory=_none)
    rules: PairRules = PairRules()

    @classmethod
    def of(cls, rules: PairRules, missing: NDArray[np.int64] | None = None) -> "PairCheck":
        """Return the check without a problem, after a frame in which these tracks were `missing` on the right."""
        evidence = Evidence(rules.bound_nats, rules.memory_frames)
        return cls(evidence, missing=_none() if missing is None else missing, rules=rules)

    def after(self, problem: str, fit: PairFit | None, next_id: int) -> tuple["PairCheck", bool]:
        """Return the check after a frame with a `problem`, or none, and the `fit` of its tracks (None: none followed).

        Tracks that begin in this frame have ids from `next_id` on. Also returns whether all tracks must be dropped,
        because a problem has ended without points from before it.
        """
        was_there, bound = self.evidence.is_there, self.rules.bound_nats
        if problem:  # no frame of a sound pair has one
            first_id = self.first_id if was_there else next_id
            return changed(self, evidence=self.evidence.after(bound), problem=problem, first_id=first_id), False
        if fit is None:
            return self, False
        if not was_there or self._old_fit(fit):
            return PairCheck.of(self.rules, fit.missing), False
        agree, n = int(np.count_nonzero(fit.both)), len(fit.both)
        evidence = self.evidence.after(-ratio_of_share(agree, n, self.rules.new_favour))
        if evidence.is_there:
            return changed(self, evidence=evidence), False
        return PairCheck.of(self.rules), True

    def _old_fit(self, fit: PairFit) -> bool:
        """Whether more points from before the problem fit than a body has by chance, and half of the survivors."""
        old = fit.ids < self.first_id
        least = max(self.rules.fewest_old, self.rules.fit * np.count_nonzero(old & fit.left))
        return bool(np.count_nonzero(old & fit.both) >= least)


def problem_of(
    images: PreparedImages,
    previous: PreparedImages | None,
    fit: PairFit | None,
    rows: Rows,
    factor: float,
    rules: PairRules,
) -> str:
    """Return what is wrong in a frame, with its likely cause, or an empty string.

    `previous`: the images before; `fit`: of its tracks; `factor`: the variance factor of the views.
    """
    if problem := rows_problem(rows, rules):
        return problem
    if factor > rules.max_factor:
        return (
            f"view errors are {np.sqrt(factor):.1f} times as large as the images explain: does the calibration belong "
            "to these cameras and this resolution?"
        )
    if fit is None:
        return ""
    if problem := frozen(images, previous):
        return problem
    n_left = np.count_nonzero(fit.left)
    n_both = np.count_nonzero(fit.both)  # these agree in the left image as well
    if n_left < MANY_VIEWS or n_both >= rules.fit * n_left:
        return ""
    if fit.has_samples and n_left < rules.good_share * len(fit.left):  # bodies hide the scene
        return ""
    return (
        f"of {n_left} points that agree in the left image {n_both} do in the right one: is one "
        "camera covered, frozen or moved, are left and right exchanged, or are the images not of one moment?"
    )


def rows_problem(rows: Rows, rules: PairRules) -> str:
    """Return why the rows of matches cannot be those of a calibrated pair, or an empty string."""
    if rows.largest_px > rules.max_rows_px:
        return (
            f"the rows of left and right differ by up to {rows.largest_px:.1f} px: does the calibration belong to "
            "these cameras and this resolution, or are left and right exchanged?"
        )
    if rows.unexplained_px > rules.max_scatter_px:
        return (
            f"the rows of matches scatter by {rows.unexplained_px:.1f} px: are left and right exchanged, or are the "
            "images not of one moment?"
        )
    return ""


def resolution_problem(rig: StereoRig, rules: PairRules) -> str:
    """Return that the principal points are those of images of half or twice the size, or an empty string."""
    at = np.array([camera.K[:2, 2] / (camera.width, camera.height) for camera in rig.cameras.values()])
    for factor, name in ((0.5, "half"), (2.0, "twice")):
        if (np.abs(at - factor / 2) < rules.same_place).all():
            left = rig.left
            return (
                f"the principal point ({left.K[0, 2]:.0f}, {left.K[1, 2]:.0f}) is the centre of images of {name} the "
                f"size, but these have {left.width}×{left.height} pixels: does the calibration belong to this "
                "resolution?"
            )
    return ""
