"""The inertial part of a map: the velocities and slides of its window, eliminated from its normal equations.

A slide is an apparent rotation from patches that slide alike, eq. (17a). The images show the camera's rotation with it,
the gyroscope without it. So poses of the window are those that the images show, and the true pose of camera k is
Exp(τ_k) X_k, with τ_k the sum of the slides δ up to k, each about its own camera. Velocities and slides occur in
inertial rows only.
"""

from dataclasses import field
from functools import cached_property
from typing import Any

import numpy as np

from .... import core
from ....geometry import Array, se3
from ....geometry.linear import scaled_cholesky, symmetric
from ....inertial.state import GRAVITY, GRAVITY_M_S2, STATE, VELOCITY
from ....record import changed, record
from ..layout import Layout, layout
from ..normal_equations import System
from .interval import JOINT, OF_LEAVING, Interval, Intervals, Known, Leaving
from .rules import InertiaRules

_LEAST_SLIDE_RAD = 1e-7
_OWN_SLIDE = np.eye(6)[:, 3:]  # Jacobian of the pose of a frame by its own slide


@record
class Eliminated:
    """Velocities and slides as functions of poses and inertial state, from the latest normal equations, eq. (82).

    `lead` (6F, 3F): Jacobian of true poses by slides; `cov` (6F, 6F): covariance of slides and velocities given poses
    and state, `gain` (6F, 6F + 17): their Jacobian by these, and `right` (6F,): their right-hand side, of which a step
    is made only once.
    """

    lead: Array
    cov: Array
    gain: Array
    right: Array


_NOTHING = Eliminated(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, STATE)), np.zeros(0))


@record
class InertialWindow:
    """Intervals, velocities (F, 3) and slides (F, 3) of the frames in the window, in their order.

    `factors` (3,): on the noise densities of gyroscope and accelerometer, and on σ of the slides, which are
    `std_slides` (F,). `eliminated`: velocities and slides in the latest normal equations.
    """

    cam_from_imu: Array
    factors: Array
    rules: InertiaRules
    knows_gravity: bool
    intervals: tuple[Interval, ...] = ()
    velocities: Array = field(default_factory=lambda: np.zeros((0, 3)))
    slides: Array = field(default_factory=lambda: np.zeros((0, 3)))
    std_slides: Array = field(default_factory=lambda: np.zeros(0))
    eliminated: Eliminated = _NOTHING

    @cached_property
    def rows(self) -> Intervals:
        """The intervals as arrays."""
        return Intervals.of(self.intervals, self.factors)

    def _with(self, **fields: Any) -> "InertialWindow":
        """Return the window with other values in some fields, none of which its `rows` depend on."""
        result = changed(self, **fields)
        vars(result).update(rows=self.rows)
        return result

    @property
    def _local(self) -> Layout:
        """The layout of the unknowns of the window that no view depends on."""
        return layout(slides=3 * len(self.intervals), velocities=3 * len(self.intervals))

    def with_newest(self, interval: Interval, velocity: Array, std_slide_rad: float) -> "InertialWindow":
        """Add the newest frame."""
        std_slide_rad = max(self.factors[2] * std_slide_rad, _LEAST_SLIDE_RAD)
        return changed(
            self,
            intervals=(*self.intervals, interval),
            velocities=np.concatenate([self.velocities, velocity[None]]),
            slides=np.concatenate([self.slides, np.zeros((1, 3))]),
            std_slides=np.append(self.std_slides, std_slide_rad),
        )

    def without_oldest(self) -> "InertialWindow":
        """Remove the oldest frame."""
        of_frames = self.velocities[1:], self.slides[1:], self.std_slides[1:]
        velocities, slides, std_slides = of_frames
        return changed(self, intervals=self.intervals[1:], velocities=velocities, slides=slides, std_slides=std_slides)

    def leads(self, cams_from_ref: Array) -> tuple[Array, Array]:
        """Return the Jacobian (6F, 3F) of true poses by slides, and the true poses (F, 4, 4), without the slides."""
        return core.slide_leads(cams_from_ref, self.slides)

    def linearised(self, cams_from_ref: Array, state: Array) -> tuple["InertialWindow", tuple[Array, Array]]:
        """Return information (6F + 17, …) and right-hand side of poses and state, the rest eliminated, eq. (82)."""
        about, weighted, *eliminated = core.inertial_information(
            self.rows, cams_from_ref, self.slides, self.std_slides, self.velocities, state, self.cam_from_imu
        )
        return self._with(eliminated=Eliminated(*eliminated)), (about, weighted)

    def moved(self, dposes: Array, dstate: Array) -> "InertialWindow":
        """Move velocities and slides with steps of poses (F, 6) and state (17,); their own step is made only once."""
        of = self.eliminated
        step = of.cov @ of.right
        step = step + of.gain @ np.concatenate([dposes.ravel(), dstate])
        return self._with(
            eliminated=changed(of, right=np.zeros(len(step))),
            slides=self.slides + step[self._local["slides"]].reshape(-1, 3),
            velocities=self.velocities + step[self._local["velocities"]].reshape(-1, 3),
        )

    def leaving(self, cam_from_ref: Array, state: Array, cov_gravity: Array) -> tuple[Leaving, "InertialWindow"]:
        """Return the information of the oldest interval and of the slide of its frame, which the prior absorbs.

        The length of gravity is part of it once, when its direction is known.
        """
        slide, velocity, std_slide = self.slides[0], self.velocities[0], self.std_slides[0]
        cam = se3.exp(np.concatenate([np.zeros(3), slide])) @ cam_from_ref
        residual, *both = self._oldest_rows(cam, Intervals.of(self.intervals[:1], self.factors), state)
        j = np.concatenate(both, axis=1)
        h, g = j.T @ j, -j.T @ residual
        rows = range(OF_LEAVING["slide"].start, OF_LEAVING["slide"].stop)
        h[rows, rows] += std_slide**-2
        g[rows] -= slide * std_slide**-2
        knows = self.knows_gravity
        if not knows and np.trace(cov_gravity) < self.rules.known_gravity_m2_s4:
            knows, at, gravity = True, OF_LEAVING.within("state", GRAVITY), state[GRAVITY]
            variance = self.rules.std_known_gravity_m_s2**2
            down = gravity / np.linalg.norm(gravity)
            h[at, at] += np.outer(down, down) / variance
            g[at] += down * (GRAVITY_M_S2 - np.linalg.norm(gravity)) / variance
        leaving = Leaving(h, g, slide, velocity, self.intervals[0].std_walk)
        return leaving, changed(self, knows_gravity=knows)

    def _oldest_rows(self, true_cam: Array, oldest: Intervals, state: Array) -> tuple[Array, Array, Array]:
        """Return residual (9,) and Jacobians of the oldest interval, as in `core.inertial_rows`."""
        return core.inertial_rows(oldest, true_cam[None], _OWN_SLIDE, self.velocities[:1], state, self.cam_from_imu)

    def true_poses(self, system: System) -> tuple[Array, Array]:
        """Return a root (6F, n + 3F) of the covariance of true poses given the rig's errors, and ∂ by these (6F, m)."""
        f, modes, of = len(self.intervals), system.prior.world_modes[JOINT["state"]], system.prior.of_modes
        of_own, of_rig = modes[:, of["own"]], modes[:, of["rig"]]
        poses, at = system.at["poses"], system.at["modes"]
        slides, shared = self._local["slides"], layout(poses=6 * f, state=STATE)
        turn = self.eliminated.lead @ self.eliminated.gain[slides]
        by_poses, by_state = turn[:, shared["poses"]] + np.eye(6 * f), turn[:, shared["state"]]
        root = by_poses @ system.root[poses] + by_state @ (of_own @ system.root[at])
        by_rig = by_poses @ system.by_rig[poses]
        by_rig = by_rig + by_state @ (of_own @ system.by_rig[at] + of_rig)
        left = self.eliminated.lead @ scaled_cholesky(self.eliminated.cov[slides, slides]) if f else np.zeros((0, 0))
        return np.concatenate([root, left], axis=1), by_rig

    def newest_mean(self, world_from_ref: Array, cams: Array, state: Array) -> tuple[Array, Array]:
        """Return pose (4, 4) and state (17,) of the newest camera; arguments as in `newest`."""
        x, now = self._newest_true_cam(cams), state.copy()
        now[GRAVITY] = x[:3, :3] @ state[GRAVITY]
        if self.intervals:
            now[VELOCITY] = self.velocities[-1]
        return se3.orthonormalise(world_from_ref @ se3.inverse(x)), now

    def _newest_true_cam(self, cams: Array) -> Array:
        return self.leads(cams)[1][-1] if self.intervals else np.eye(4)

    def newest(
        self, system: System, stamp_ns: int, world_from_ref: Array, cams: Array, state: Array
    ) -> tuple[Known, Array]:
        """Return pose and state of the newest camera with their joint covariance given the rig's errors, eq. (84).

        The second result (23, m) is the Jacobian of both by these errors. `cams` (F, 4, 4): poses as the images show
        them; none if the newest camera is the reference.
        """
        f, of_modes, of = len(self.intervals), system.prior.world_modes, system.prior.of_modes
        at = layout(poses=6 * f, world=6, state=STATE)
        x = self._newest_true_cam(cams)
        pose, now = self.newest_mean(world_from_ref, cams, state)
        # `rest` belongs to the independent parts of velocities and slides
        rows, rest = np.zeros((JOINT.size, at.size)), np.zeros((JOINT.size, 6 * f))
        rows[JOINT["pose"], at["world"]] = se3.adjoint(x)
        rows[JOINT["state"], at["state"]] = np.eye(STATE)
        if f:
            last, shared, slides = (
                self.eliminated.lead[-6:],
                layout(poses=6 * f, state=STATE),
                self._local["slides"],
            )
            moved = np.zeros((6, at.size))
            moved[:, at["poses"]][:, -6:] = np.eye(6)  # the newest one
            by_gain = last @ self.eliminated.gain[slides]
            moved[:, at["poses"]] += by_gain[:, shared["poses"]]
            moved[:, at["state"]] += by_gain[:, shared["state"]]
            rows[JOINT["pose"]] -= moved
            rest[JOINT["pose"], slides] = -last
            gravity, velocity = JOINT.within("state", GRAVITY), JOINT.within("state", VELOCITY)
            turned = -se3.skew(now[GRAVITY])
            rows[gravity] = x[:3, :3] @ rows[gravity] + turned @ moved[3:]
            rest[gravity, slides] = turned @ last[3:]
            rows[velocity] = 0
            rows[velocity, at["poses"]] = self.eliminated.gain[-3:, shared["poses"]]
            rows[velocity, at["state"]] = self.eliminated.gain[-3:, shared["state"]]
            rest[velocity, -3:] = np.eye(3)
        of_world = rows[:, at.span("world", "state")]
        by_variables = _of_system(system, rows[:, at["poses"]], of_world @ of_modes[:, of["own"]])
        root = by_variables @ system.root
        by_rig = by_variables @ system.by_rig + of_world @ of_modes[:, of["rig"]]
        cov = root @ root.T + rest @ self.eliminated.cov @ rest.T
        return Known(stamp_ns, pose, now, symmetric(cov)), by_rig

    def surprise(self, system: System, cams_from_ref: Array, state: Array) -> Array:
        """Compare the residuals of the oldest interval with their expected squares, diag(I − J Σ Jᵀ) of its own rows.

        The result (3, 4) has for gyroscope, accelerometer and slides: the sums of squared residuals weighted by these
        expected squares, of the squared weights, of the squared residuals without weights, and of the weights. If the
        expected square is small, a residual shows the noise of the images.
        """
        f = len(self.intervals)
        opened = self.intervals[0].opened
        if self.intervals[0].is_open or not self.intervals[0].complete:
            return np.zeros((3, 4))
        oldest = self.rows.oldest
        residual, of_oldest, of_own_local = self._oldest_rows(self.leads(cams_from_ref)[1][0], oldest, state)
        modes, of = system.prior.world_modes[JOINT["state"]], system.prior.of_modes
        of_own, of_rig = modes[:, of["own"]], modes[:, of["rig"]]
        at = layout(poses=6 * f, state=STATE)
        # rows of the interval, and of the slide of its frame in σ
        local, shared = np.zeros((12, self._local.size)), np.zeros((12, at.size))
        first = slice(0, 3)
        of_slide, std = self._local.within("slides", first), self.std_slides[0]
        local[:9, of_slide], local[9:, of_slide] = of_own_local[:, :3], np.eye(3) / std
        local[:9, self._local.within("velocities", first)] = of_own_local[:, 3:]
        shared[:9, :6], shared[:9, at["state"]] = of_oldest[:, :6], of_oldest[:, 6:]
        total = shared + local @ self.eliminated.gain
        by_variables = _of_system(system, total[:, at["poses"]], total[:, at["state"]] @ of_own)
        root = by_variables @ system.root
        by_rig = by_variables @ system.by_rig + total[:, at["state"]] @ of_rig
        parts = (root, root), (by_rig @ system.cov_rig, by_rig), (local @ self.eliminated.cov, local)
        left = np.clip(1 - sum((a * b).sum(axis=1) for a, b in parts), 0.0, 1.0)
        squares = np.concatenate([opened * residual**2, (self.slides[0] / std) ** 2])  # by the variance not widened
        rows = np.stack([left * squares, left**2, squares, left], axis=1)
        return np.array([rows[k].sum(axis=0) for k in (slice(0, 3), slice(3, 9), slice(9, 12))])


def _of_system(system: System, by_poses: Array, by_modes: Array) -> Array:
    """Return rows by poses (r, 6F) and by modes (r, k) as rows by all variables of a system, with zeros in between."""
    own = system.at["own"]
    between = np.zeros((len(by_poses), own.stop - own.start))
    return np.concatenate([by_poses, between, by_modes], axis=1)
