"""The state of the window between two frames: one record, which a step replaces and never changes.

The reference camera p is the newest frame that has left the window; frames p+1 … n are in it with poses cam_from_ref.
Points are given by q in the cameras that first saw them (`inverse_depth`); the world is one more pose, which the prior
contains. The steps of a frame are functions of this record; `pipeline/` lists them in their order.
"""

from dataclasses import field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...config import WindowConfig
from ...geometry import Array
from ...geometry.stereo import StereoProjection
from ...record import changed, record
from .ambiguous_motions import AmbiguousMotions
from .inertia.inertial_window import InertialWindow
from .inertia.interval import JOINT
from .inverse_depth import State, WhitenedViews
from .map_points import MapPoints
from .normal_equations import System
from .outliers import Rejections
from .prior import Prior
from .reported.marginals import Marginals
from .rig_state import RigState
from .unknowns.exposures import Exposures
from .unknowns.focus_watch import FocusWatch
from .window_frame import WindowFrame


@record
class WindowState:
    """Frames, views, points and prior of one map: everything that exists only while the camera is tracked.

    Of frames: the `reference`; `frames`, the window, oldest first; `cams_from_ref` (F, 4, 4): their poses; `own` (F,
    e): amplitudes of the errors that the views of each frame share, in σ, the first one that of the focal length if
    `has_focus`; `exposures`: when frames were exposed; `inertia`: their inertial samples, None without.

    Of views: `views`, of these frames in their order, used or not; `first_views`: those of the reference while nothing
    else is in the prior; `places`: ids and expected places (n, 4) of the newest frame's tracks.

    Of points: `points`, all of the map; `rejections` of their tracks; `dropped`: ids of those that start again with
    their next view; `restarted`: of those that the newest frame started again.

    Of earlier frames: the `prior`, and the `amplitudes` (k,) of its modes. `ambiguous_motions`: further uncertainty of
    the newest pose; `focus`: whether the focal length changes.

    Of the latest frame: `solved`: the normal equations, factored; `read`: its marginals, as reported. Both are None
    until the map has begun.
    """

    projection: StereoProjection
    rules: WindowConfig
    reference: WindowFrame
    exposures: Exposures
    own: Array
    views: WhitenedViews
    first_views: WhitenedViews | None
    places: tuple[NDArray[np.int64], Array]
    points: MapPoints
    rejections: Rejections
    prior: Prior
    amplitudes: Array
    focus: FocusWatch
    frames: tuple[WindowFrame, ...] = ()
    cams_from_ref: Array = field(default_factory=lambda: np.empty((0, 4, 4)))
    has_focus: bool = False
    inertia: InertialWindow | None = None
    dropped: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    restarted: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    ambiguous_motions: AmbiguousMotions = field(default_factory=AmbiguousMotions)
    solved: System | None = None
    read: Marginals | None = None

    @property
    def system(self) -> System:
        """The latest normal equations, factored."""
        assert self.solved is not None  # a map begins by a step
        return self.solved

    @property
    def marginals(self) -> Marginals:
        """The marginals of the latest frame, as reported."""
        assert self.read is not None  # a map begins by a step
        return self.read

    @cached_property
    def world_from_ref(self) -> Array:
        """The pose (4, 4) of the reference camera at the current amplitudes of the prior's modes."""
        return self.prior.world(self.amplitudes)

    @cached_property
    def rig_error(self) -> Array:
        """The errors (m,) of the rig at the current amplitudes, which are removed from the views."""
        return self.prior.rig_at(self.amplitudes)

    @property
    def inertial_state(self) -> Array:
        """The inertial state (17,) of the reference camera at the current amplitudes; (0,) without inertia."""
        return self.prior.state_at(self.amplitudes)

    @property
    def all_frames(self) -> tuple[WindowFrame, ...]:
        """The reference, and the frames of the window."""
        return self.reference, *self.frames

    @property
    def newest_frame(self) -> WindowFrame:
        """The newest frame, which is the reference until there is a second one."""
        return self.frames[-1] if self.frames else self.reference

    @cached_property
    def newest_cam_from_ref(self) -> Array:
        """The pose (4, 4) of the newest camera."""
        return self.cams_from_ref[-1] if self.frames else np.eye(4)

    @cached_property
    def newest(self) -> slice:
        """The rows of the newest frame's views."""
        return slice(int(np.searchsorted(self.views.frame, len(self.frames) - 1)), len(self.views))

    @property
    def rig_left(self) -> RigState:
        """The rig that the next map begins with; a focal length that is changing becomes unknown."""
        return self.prior.rig.refocused()[0] if self.focus.moves else self.prior.rig

    @cached_property
    def true_cams(self) -> Array:
        """The cameras of the window (F, 4, 4), without apparent rotations by sliding patches if there is inertia."""
        return self.cams_from_ref if self.inertia is None else self.inertia.leads(self.cams_from_ref)[1]

    @cached_property
    def state(self) -> State:
        """The state that views are predicted from."""
        points = self.points
        return State(self.cams_from_ref, points.ids, points.ref_from_anchor, points.q, self.rig_error, self.own)

    def of_reference(self, points: MapPoints, own: Array | None = None) -> State:
        """Return the state for views of the reference camera alone, with its `own` amplitudes (1, e)."""
        own = np.zeros((1, self.own.shape[1])) if own is None else own
        return State(np.eye(4)[None], points.ids, points.ref_from_anchor, points.q, self.rig_error, own)

    def agreeing(self, fewest: int) -> NDArray[np.int64]:
        """Return the ascending ids of the newest frame's used views of points that have so many of them in the map."""
        ids = self.views.ids[self.newest][self.views.used[self.newest]]
        seen = core.times_among(ids, self.views.ids, self.views.used) >= fewest
        return ids[seen | core.among(ids, self.prior.ids)]

    def moved(self, to: core.MovedWindow) -> "WindowState":
        """Return the state with all its variables after a step."""
        inertia = self.inertia
        if inertia is not None and self.frames:
            of_poses, of_modes = to.step[: 6 * len(self.frames)], to.step[-len(to.amplitudes) :]
            inertia = inertia.moved(of_poses, self.prior.world_modes[JOINT["state"]] @ of_modes)
        return changed(
            self,
            inertia=inertia,
            cams_from_ref=to.cams_from_ref,
            own=to.own,
            points=changed(self.points, q=to.q),
            amplitudes=to.amplitudes,
        )

    def with_prior(self, prior: Prior) -> "WindowState":
        """Return the state with another prior, at its mean."""
        return changed(self, prior=prior, amplitudes=np.zeros(prior.modes.shape[2]))

    @cached_property
    def cov_ambiguous(self) -> Array:
        """The covariance (6, 6) that second motions, and patches that slide alike, add to the newest pose."""
        return self.ambiguous_motions.of_newest(self.newest_cam_from_ref)

    @property
    def cov_pose(self) -> Array:
        """The covariance (6, 6) of the newest pose in the world from the latest system."""
        return core.newest_pose_covariance(self.state, self.system) + self.cov_ambiguous

    def newest_marginals(self) -> Marginals:
        """Return the marginals of the newest frame from the latest system."""
        return Marginals.compute(self.system, self.state, self.world_from_ref, self.cov_ambiguous)
