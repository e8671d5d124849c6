"""Turns a solution in rectified axes into the estimate of a frame in axes of the physical left camera."""

from dataclasses import field, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..camera.rectification import Rectifier
from ..camera.unseen_errors import PhysicalAxes
from ..config import RigConfig
from ..frontend.front_end import StereoFrontEnd
from ..frontend.learnt.template_errors import TemplateErrors
from ..geometry import Array
from ..inertial.state import SCALE
from ..record import record, rows_of
from ..rig_model.terms import TERMS
from ..types import (
    CommonErrors,
    FrameEstimate,
    InertialEstimate,
    Observations,
    Prediction,
    RelativeMotions,
    Solution,
    Status,
)

if TYPE_CHECKING:
    from ..frontend.mono.front_end import MonoFrontEnd


@record
class Observed:
    """The observations of one frame, and what else is needed to make estimates from them.

    `timings_ms`: of each stage that led to them. From the front-end, as of this frame: `errors` that the views of a
    point share; `turn_rad` (3,), by which right views are corrected since frame `turned_at`; `moving`: the
    homogeneous points (n, 4) in view and their twist (6,), None before the first motion.
    """

    observations: Observations
    timings_ms: dict[str, float]
    errors: TemplateErrors = field(default_factory=TemplateErrors)
    turn_rad: Array = field(default_factory=lambda: np.zeros(3))
    turned_at: int = 0
    moving: tuple[Array, Array] | None = None


class PhysicalEstimates:
    """Makes estimates in physical axes, including the errors of lengths and axes that no view shows.

    `frontend` gives the errors of the rig in pixels; `unscaled`: there is one camera.
    """

    def __init__(
        self, rectifier: Rectifier, frontend: "StereoFrontEnd | MonoFrontEnd", config: RigConfig, unscaled: bool
    ) -> None:
        self._rect_from_cam, self._frontend, self._unscaled = rectifier.rect_from_cam, frontend, unscaled
        self._disparity_at_1m_px = rectifier.projection.f_px * rectifier.projection.baseline_m
        self._exact = unscaled or config.exact  # with one camera no length is known anyway
        self._std_axes_rad = config.std_axes_rad
        unseen = () if self._exact else (config.std_baseline, config.std_axes_rad)
        self._axes = PhysicalAxes(self._rect_from_cam, *unseen)

    def estimate(self, observed: Observed, solution: Solution, estimator_ms: float) -> FrameEstimate:
        """Turn the solution of an observed frame, in rectified axes, into axes of the physical left camera.

        The covariance of each point includes the disparity error that all its views share. Points seen for the
        first time are not yet reported: one match of left and right may be wrong, which only a second view can
        show.
        """
        observations = observed.observations
        solution = solution if solution.inertial is None else _in_metres(solution, solution.inertial.scale)
        axes = self._axes_with(solution.inertial)
        weights = None if solution.common is None else solution.common.weights(len(TERMS))
        by_common = None if solution.common is None else solution.common.jacobian
        pose = _motions(axes, solution.world_from_cam[None], solution.cov_pose[None], by_common, weights)
        values = {f.name: getattr(solution, f.name) for f in fields(Solution)}  # fields without axes stay unchanged
        return FrameEstimate(
            **values
            | self._structure(axes, observed, solution)
            | {
                "world_from_cam": pose[0][0],
                "cov_pose": pose[1][0],
                "window_world_from_cam": axes.poses(solution.window_world_from_cam),
                "rig": self._frontend.rig_in_px(observed.turn_rad, solution.rig),
                "relative": self._relative(axes, solution.relative, weights),
                "common": self._common(solution, pose[2][0], observed.turned_at),
                "inertial": None if solution.inertial is None else self._turned(solution.inertial),
            },
            frame_index=observations.frame_index,
            stamp_ns=int(observations.stamp_ns),
            counts={
                "tracked": len(observations.track_ids) - observations.n_new,
                "new": observations.n_new,
                "used": len(solution.track_ids),
                "rejected": len(solution.rejected_ids),
            },
            timings_ms=observed.timings_ms | {"estimator": estimator_ms},
            unscaled=self._unscaled,
            rig_change=None if observations.rig is None else observations.rig.change,
        )

    def _structure(
        self, axes: PhysicalAxes, observed: Observed, solution: Solution
    ) -> dict[str, Array | NDArray[np.int64]]:
        """Return the fields of an estimate that are points: those in view that are reported, and those that ended."""
        seen = observed.observations
        new_ids = seen.track_ids[len(seen.track_ids) - seen.n_new :]
        shown = np.flatnonzero(~core.among(solution.track_ids, new_ids))
        std_shared = self._std_shared(observed.errors, solution.track_ids[shown])
        in_cam, in_world = (
            axes.points(rows_of(points, shown), rows_of(cov, shown), std_shared, frame_from_cam)
            for points, cov, frame_from_cam in (
                (solution.points_in_cam, solution.cov_points, np.eye(4)),
                (solution.points_in_world, solution.cov_points_in_world, solution.world_from_cam),
            )
        )
        ended = axes.points(
            solution.ended_points_in_world,
            solution.ended_cov_points_in_world,
            self._std_shared(observed.errors, solution.ended_ids),
            solution.window_world_from_cam[0],  # an ended point was last seen at about the beginning of the window
        )
        return {
            "track_ids": solution.track_ids[shown],
            "points_in_cam": in_cam[0],
            "cov_points": in_cam[1],
            "points_in_world": in_world[0],
            "cov_points_in_world": in_world[1],
            "ended_points_in_world": ended[0],
            "ended_cov_points_in_world": ended[1],
        }

    def prediction(self, found: Prediction) -> Prediction:
        """Turn a prediction in rectified axes into axes of the physical left camera."""
        axes, pose = self._axes_with(found.inertial), found.world_from_cam.copy()
        pose[:3, 3] *= 1 + found.inertial.scale
        poses, cov, _ = _motions(axes, pose[None], found.cov_pose[None], None, None)
        return Prediction(found.stamp_ns, poses[0], cov[0], self._turned(found.inertial))

    def _axes_with(self, inertial: InertialEstimate | None) -> PhysicalAxes:
        """Return the physical axes, with lengths as uncertain as inertia leaves them."""
        if inertial is None or self._exact:
            return self._axes
        std_scale = float(np.sqrt(inertial.cov_of(SCALE)[0, 0]))
        return PhysicalAxes(self._rect_from_cam, std_scale, self._std_axes_rad)

    def _turned(self, inertial: InertialEstimate) -> InertialEstimate:
        """Return the inertial state in axes of the physical camera."""
        cam_from_rect = self._rect_from_cam[:3, :3].T
        turn = np.eye(len(inertial.cov))
        for k in range(0, 12, 3):
            turn[k : k + 3, k : k + 3] = cam_from_rect
        return replace(
            inertial,
            velocity=cam_from_rect @ inertial.velocity,
            gravity=cam_from_rect @ inertial.gravity,
            cov=turn @ inertial.cov @ turn.T,
        )

    def _relative(
        self, axes: PhysicalAxes, relative: RelativeMotions | None, weights: Array | None
    ) -> RelativeMotions | None:
        """Return relative motions in axes of the physical camera, with the errors that no view shows."""
        if relative is None:
            return None
        seen = relative.frame_from_newest, relative.cov, relative.common_jacobian
        poses, cov, by_common = _motions(axes, *seen, weights)
        return RelativeMotions(relative.frame_indices, poses, cov, None if self._exact else by_common)

    def _common(self, solution: Solution, jacobian: Array, since: int) -> CommonErrors | None:
        """Return the errors that all frames `since` one share, and those that no view shows; both move the pose."""
        if self._exact or solution.status in (Status.INITIALISING, Status.LOST):
            return None
        if solution.common is None:
            return CommonErrors(np.zeros(3), np.eye(3), jacobian, since)
        t = len(TERMS)
        cov = np.eye(3 + t)
        cov[3:, 3:] = solution.common.cov[:t, :t]
        mean = np.concatenate([np.zeros(3), solution.common.mean[:t]])
        return CommonErrors(mean, cov, jacobian, since)

    def _std_shared(self, errors: TemplateErrors, track_ids: NDArray[np.int64]) -> Array:
        """Return σ (n,) of inverse depths, 1/m, by the disparity error that all views of a point share, eq. (18)."""
        return errors.std_disparity_px(track_ids) / self._disparity_at_1m_px


def _motions(
    axes: PhysicalAxes, poses: Array, cov: Array, by_rig: Array | None, weights: Array | None
) -> tuple[Array, Array, Array]:
    """Poses (n, 4, 4), covariances and perturbations by common errors, as `PhysicalAxes.motions` turns them.

    Of the rig errors, which move the motions by (…, 6, m), the physical terms count as common. They predict the
    field over the image by `weights` (m, t); the rest of the field is an own error of the motion.
    """
    of_terms = None if by_rig is None or weights is None else (by_rig @ weights).reshape(len(poses), 6, -1)
    return axes.motions(poses, cov, of_terms)


def _in_metres(solution: Solution, scale: float) -> Solution:
    """Return in metres a solution whose lengths from images are too short by a share `scale`."""
    if not scale:
        return solution
    k = 1 + scale

    def longer(poses: Array) -> Array:
        return np.concatenate([poses[..., :3], poses[..., 3:] * np.array([k, k, k, 1.0])[:, None]], axis=-1)

    lengths = np.diag(np.repeat([k, 1.0], 3))
    relative, common = solution.relative, solution.common
    if relative is not None:
        by_common = None if relative.common_jacobian is None else lengths @ relative.common_jacobian
        motions, cov = longer(relative.frame_from_newest), lengths @ relative.cov @ lengths
        relative = RelativeMotions(relative.frame_indices, motions, cov, by_common)
    return replace(
        solution,
        world_from_cam=longer(solution.world_from_cam),
        cov_pose=lengths @ solution.cov_pose @ lengths,
        points_in_cam=k * solution.points_in_cam,
        cov_points=k**2 * solution.cov_points,
        points_in_world=k * solution.points_in_world,
        cov_points_in_world=k**2 * solution.cov_points_in_world,
        ended_points_in_world=k * solution.ended_points_in_world,
        ended_cov_points_in_world=k**2 * solution.ended_cov_points_in_world,
        window_world_from_cam=longer(solution.window_world_from_cam),
        relative=relative,
        common=None if common is None else replace(common, jacobian=lengths @ common.jacobian),
    )
