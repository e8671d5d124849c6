"""The joint prior of the window: information about points and world from all frames that left it, section 6.

Everything is expressed in the reference camera, and factored, eq. (29),

    q_i = mean_i + F_i y + e_i,   ω = F_w y,   y ~ N(0, I_k),   e_i ~ N(0, D_i) independent,

with common modes F and their amplitudes y. The last m modes are ∂q and ∂ω by the rig's errors, and their amplitudes are
the deviations of these errors from their mean (`rig_state.py`). A window with any number of points is so solved with
one small dense system; a dense information matrix over 200 points contains the same and costs fifty times as much. Each
absorbed frame adds the six modes of its unknown pose; modes that are negligible compared with the points' own noise are
folded into D, so that every point keeps its marginal covariance. ω is the right perturbation of world_from_ref. With
inertia, the inertial state (`interval.py`) is expressed in the same modes as the world.
"""

from dataclasses import field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array, se3
from ...geometry.linear import LEAST_VARIANCE, scaled_cholesky
from ...geometry.stereo import StereoProjection
from ...inertial.state import BIASES, GRAVITY, STATE, VELOCITY
from ...record import changed, record
from .inertia.interval import JOINT, OF_LEAVING, Leaving
from .inverse_depth import State, WhitenedViews
from .layout import Layout, layout
from .rig_state import RigState

# A mode is negligible if it adds less to the variance of anything reported (a pose, a motion, a point) than this share
# of the variance by the points' own noise. With 0.5, poses move by 0.02 to 0.05 of their σ against a prior that keeps
# every mode, with 0.02 by 0.001, at 2 to 4 times as many modes; from 1 on they move by 0.2 σ on euroc_mh01.
_NEGLIGIBLE_SHARE = 0.5


@record
class Prior:
    """Gaussian knowledge of N points and of the world.

    `ids` (N,), ascending; `mean` (N, 3) of q in their anchors, which the map keeps; `cov` (N, 3, 3) = D; `modes` (N, 3,
    k) = F; `world_from_ref` (4, 4): mean of the reference camera's pose; `world_modes` (6, k) = F_w. `rig`: knowledge
    of the m errors of the rig, to which the last m modes belong. `state` (17,): mean of the inertial state, for which
    `world_modes` has further rows, (23, k); (0,) without inertia.
    """

    ids: NDArray[np.int64]
    mean: Array
    cov: Array
    modes: Array
    world_from_ref: Array
    world_modes: Array
    rig: RigState
    state: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def from_first_frame(
        cls,
        ids: NDArray[np.int64],
        mean: Array,
        cov: Array,
        by_own: Array,
        by_rig: Array,
        world_from_ref: Array,
        cov_pose: Array,
        rig: RigState,
    ) -> "Prior":
        """Begin a map: points seen by the reference camera, whose own pose has `cov_pose` (6, 6).

        `by_own` (N, 3, e) and `by_rig` (N, 3, m): ∂q by the errors that the frame's views share, and by the rig's
        errors; apart from these the points are independent.
        """
        root = scaled_cholesky(cov_pose + LEAST_VARIANCE * np.eye(6))
        modes = np.concatenate([np.zeros((len(ids), 3, 6)), by_own, by_rig], axis=2)
        world_modes = np.concatenate([root, np.zeros((6, modes.shape[2] - 6))], axis=1)
        return cls(ids, mean, cov, modes, world_from_ref, world_modes, rig)

    def with_first_views(self, mean: Array, cov: Array, by_own: Array, by_rig: Array) -> "Prior":
        """Return the prior of a map that contains only its first frame, with the views of that frame relinearised.

        `mean` (N, 3) and `cov` (N, 3, 3): of q at the current mean of the rig's errors; `by_own` and `by_rig` as in
        `from_first_frame`.
        """
        modes = self.modes.copy()
        modes[..., layout(pose=6, own=by_own.shape[2])["own"]] = by_own
        modes[..., self.of_modes["rig"]] = by_rig
        return changed(self, mean=mean, cov=cov, modes=modes)

    def with_own_of_first(self, at: int, n: int) -> "Prior":
        """Return the prior of a map's first frame with n more `own` amplitudes at `at`, without any effect yet.

        They follow the existing ones, as `with_first_views` expects, and precede those of an inertial state.
        """
        modes, world_modes = (np.insert(m, [at] * n, 0.0, axis=-1) for m in (self.modes, self.world_modes))
        return changed(self, modes=modes, world_modes=world_modes)

    def world(self, amplitudes: Array) -> Array:
        """Return world_from_ref (4, 4) at the given amplitudes (k,) of the modes."""
        return se3.orthonormalise(self.world_from_ref @ se3.exp(self.world_modes[JOINT["pose"]] @ amplitudes))

    def state_at(self, amplitudes: Array) -> Array:
        """Return the inertial state (17,) at the given amplitudes (k,) of the modes."""
        return np.asarray(self.state + self.world_modes[JOINT["state"]] @ amplitudes)

    def rig_at(self, amplitudes: Array) -> Array:
        """Return the errors (m,) of the rig at the given amplitudes (k,) of the modes; the rig's come last."""
        mean = self.rig.mean
        return np.asarray(mean + amplitudes[len(amplitudes) - len(mean) :])

    @cached_property
    def of_modes(self) -> Layout:
        """The layout of the modes: the prior's own, and those of the rig's errors."""
        return layout(own=self.modes.shape[2] - len(self.rig), rig=len(self.rig))

    def with_state(self, state: Array, joint: Array) -> "Prior":
        """Return the prior with an inertial state (17,), whose covariance with the world is in `joint` (23, 23).

        The part correlated with the world is expressed in the prior's own modes; the rest gets 17 modes that no point
        shares.
        """
        pose, at = JOINT["pose"], JOINT["state"]
        world, of = self.world_modes[pose], self.of_modes
        of_own, of_rig = world[:, of["own"]], world[:, of["rig"]]
        by_world = np.linalg.solve(joint[pose, pose] + LEAST_VARIANCE * np.eye(6), joint[pose, at]).T
        left = joint[at, at] - by_world @ joint[pose, at]
        # a billionth of the variances keeps the rest above rounding
        root = scaled_cholesky(0.5 * (left + left.T) + np.diag(1e-9 * np.diag(joint[at, at])))
        now = layout(own=of_own.shape[1], state=STATE, rig=of_rig.shape[1])
        rows = np.zeros((JOINT.size, now.size))
        rows[pose, now["own"]], rows[pose, now["rig"]] = of_own, of_rig
        rows[at, now["own"]], rows[at, now["state"]] = by_world @ of_own, root
        none = np.zeros((*self.modes.shape[:2], STATE))
        modes = [self.modes[..., of["own"]], none, self.modes[..., of["rig"]]]
        return changed(self, state=state, world_modes=rows, modes=np.concatenate(modes, axis=2))

    def without_state(self) -> "Prior":
        """Return the prior without its inertial state, whose information about everything else stays."""
        return changed(self, world_modes=self.world_modes[JOINT["pose"]], state=np.zeros(0))

    def absorb_frame(
        self,
        projection: StereoProjection,
        state: State,
        views: WhitenedViews,
        seen_later: NDArray[np.bool_],
        amplitudes: Array,
        cam_from_ref: Array,
        leaving: Leaving | None = None,
    ) -> "Prior":
        """Return the posterior given the views of one camera, with that camera as the new reference, eqs. (31)–(36).

        `state` and `views`: of that camera, the new reference; `seen_later` (P,): points that later frames see, which
        stay. `amplitudes` y (k,) and `cam_from_ref` X (4, 4): the current estimate, the linearisation point.

        The anchors move with the points, C' = X C, so q does not change. The prior contains no information about the
        error ξ of the new camera's pose: with K' = ∂q'/∂P', δq' = δq + K'G ξ and ω' = Ad(X) ω − ξ, six modes without
        prior information. The errors that the frame's views share add e modes of σ = 1, which come first. With Λ =
        D⁻¹ + V, points given the modes are N(Λ⁻¹(D⁻¹(mean + F y) + V…), Λ⁻¹), and the modes have information S = P + Σ
        FᵀD⁻¹F − Σ GᵀΛ⁻¹G with G = D⁻¹F, less the effect of the rig's modes on the views. `leaving`: information about
        slide, velocity and walk of biases of the frame, twelve more modes. New points share only the frame's own and
        the rig's modes with the others. Six modes represent the world exactly, 17 more the inertial state, and those of
        the rig stay. What another mode adds to the points, in units of their own noise and summed over the points,
        bounds what it adds to anything that follows from them, eq. (36a); a negligible one is moved to that noise.
        """
        at = self._with_frame(views.own.shape[2], leaving is not None)
        world, inertial_state, world_modes = self._seen_from(cam_from_ref, amplitudes, leaving, at)
        found = core.absorb_frame(
            *(projection, state, views, views.stereo, views.var_drift, seen_later, self, amplitudes, world_modes),
            *self._about(leaving, at),
            _NEGLIGIBLE_SHARE,
        )
        rig = changed(self.rig, mean=self.rig_at(amplitudes), information=found.information, weighted=found.weighted)
        moved = found.world_step[JOINT["pose"]]
        return Prior(
            *(found.ids, found.mean, found.cov, found.modes),
            world_from_ref=se3.orthonormalise(world @ se3.exp(moved)),
            world_modes=found.world_modes,
            rig=rig,
            state=inertial_state + found.world_step[JOINT["state"]],
        )

    def _with_frame(self, e: int, has_inertia: bool) -> Layout:
        """Return the layout of the modes when a frame leaves; `e`: number of its `own` amplitudes."""
        inertial = {"slide": 3, "velocity": 3, "walk": 6} if has_inertia else {}
        of = self.of_modes
        before, rig = (of[name].stop - of[name].start for name in ("own", "rig"))
        return layout(frame=e, before=before, translation=3, rotation=3, **inertial, rig=rig)

    def _seen_from(
        self, cam_from_ref: Array, amplitudes: Array, leaving: Leaving | None, at: Layout
    ) -> tuple[Array, Array, Array]:
        """Return the world (4, 4) and the inertial state of `absorb_frame` in the leaving camera, and their modes."""
        of, state, rows = self.of_modes, self.state, self.world_modes[JOINT["state"]]
        if leaving is not None:
            cam_from_ref = se3.exp(np.concatenate([np.zeros(3), leaving.slide])) @ cam_from_ref
            state, rows = self._state_in(cam_from_ref, leaving, self.state_at(amplitudes), at)
        before = se3.adjoint(cam_from_ref) @ self.world_modes[JOINT["pose"]]
        modes = np.zeros((6, at.size))
        modes[:, at["before"]], modes[:, at["rig"]] = before[:, of["own"]], before[:, of["rig"]]
        modes[:, at.span("translation", "rotation")] = -np.eye(6)
        if leaving is not None:
            modes[3:, at["slide"]] = -np.eye(3)  # a slide rotates the camera just as its pose does
            modes = np.concatenate([modes, rows])
        return self.world(amplitudes) @ se3.inverse(cam_from_ref), state, modes

    def _about(self, leaving: Leaving | None, at: Layout) -> tuple[Array, Array]:
        """Return the inertial information (s, s) about a leaving frame by modes in the layout `at`, and its sums."""
        if leaving is None:
            return np.zeros((0, 0)), np.zeros(0)
        about, weighted = np.zeros((at.size, at.size)), np.zeros(at.size)
        state, of, rows = self.world_modes[JOINT["state"]], self.of_modes, OF_LEAVING
        moving = np.flatnonzero(state.any(axis=0))  # most modes do not affect the state
        beside = np.where(moving < of["rig"].start, at["before"].start, at["rig"].start - of["rig"].start)
        touched = np.arange(at.size)
        here = touched[at.span("translation", "rotation")], touched[at.span("slide", "velocity")]
        touched = np.concatenate([*here, moving + beside])
        j = np.zeros((rows.size, len(touched)))
        j[rows["pose"], :6] = j[rows.span("slide", "velocity"), 6:12] = np.eye(6)
        j[rows["state"], 12:] = state[:, moving]
        about[np.ix_(touched, touched)] += j.T @ leaving.h @ j
        weighted[touched] += j.T @ leaving.g
        walk = range(at["walk"].start, at["walk"].stop)
        about[walk, walk] += 1.0
        return about, weighted

    def _state_in(self, x: Array, leaving: Leaving, now: Array, at: Layout) -> tuple[Array, Array]:
        """Return the inertial state (17,) in the leaving camera x (4, 4), and its modes in the layout `at`."""
        rows, of = np.zeros((STATE, at.size)), self.of_modes
        rows[:, at["before"]] = self.world_modes[JOINT["state"], of["own"]]
        rows[:, at["rig"]] = self.world_modes[JOINT["state"], of["rig"]]
        state = now.copy()
        state[VELOCITY], state[GRAVITY] = leaving.velocity, x[:3, :3] @ now[GRAVITY]
        rows[GRAVITY] = x[:3, :3] @ rows[GRAVITY]
        turned = -se3.skew(state[GRAVITY])
        rows[GRAVITY, at["rotation"]] += turned
        rows[GRAVITY, at["slide"]] += turned
        rows[VELOCITY] = 0
        rows[VELOCITY, at["velocity"]] = np.eye(3)
        rows[BIASES, at["walk"]] = np.diag(leaving.std_walk)
        return state, rows

    def with_field(self, n: int) -> "Prior":
        """Return the prior with n more errors of the rig, of a field without any effect on its points so far."""
        modes = np.concatenate([self.modes, np.zeros((*self.modes.shape[:2], n))], axis=2)
        world_modes = np.concatenate([self.world_modes, np.zeros((len(self.world_modes), n))], axis=1)
        return changed(self, modes=modes, world_modes=world_modes, rig=self.rig.with_field(n))

    def with_rig_change(self, change: tuple[RigState, Array, Array]) -> "Prior":
        """Return the prior after the errors of the rig have changed, eq. (72e); `change` as in `RigState.changed`.

        Points and world keep their estimates, with as many additional modes, as their views have the old errors.
        """
        rig, kept, apart = change
        own = self.modes.shape[2] - len(rig)

        def moved(modes: Array) -> Array:
            of_rig = modes[..., own:]
            return np.concatenate([of_rig @ apart, modes[..., :own], of_rig @ kept], axis=-1)

        return changed(self, modes=moved(self.modes), world_modes=moved(self.world_modes), rig=rig)
