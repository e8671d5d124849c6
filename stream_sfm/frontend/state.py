"""What the front-end knows between two frames: one record, which a step replaces and never changes."""

from dataclasses import field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..camera.pixels import FEWEST_BITS
from ..config import Config
from ..config.rules import Rules
from ..geometry import Array, se3
from ..geometry.stereo import StereoProjection
from ..record import changed, record
from .alignment import Aligners
from .ambiguity import AmbiguityMemory
from .disparity_error import DisparityError
from .pair_check import PairCheck
from .prepared import PreparedImages
from .right_turn import TurnWatch
from .rows import Rows
from .start_check import StartCheck
from .step_check import StepCheck
from .suspicions import Suspicions
from .template_errors import TemplateErrors
from .timing import Timing
from .tracks import Tracks
from .unsteadiness import Unsteadiness


class RightSides(NamedTuple):
    """Where right sides are sought: the rows, a turn (3,) of the right camera, and the twist (6,) of the points."""

    rows: Rows
    turn_rad: Array
    twist: Array


@record
class Setup:
    """What does not change during a run: the projection of the rectified images, and all settings.

    `right_area` (h, w): pixels of the right image around which a whole patch shows the scene; None: all of them.
    """

    projection: StereoProjection
    config: Config
    right_area: NDArray[np.bool_] | None = None

    @cached_property
    def rules(self) -> Rules:
        """The numbers by which the front-end decides."""
        return self.config.rules

    @property
    def slide_px(self) -> float:
        """s r of eq. (17): how far a template slides where it changes by all of itself, px of templates."""
        return self.rules.errors.slide * self.config.frontend.window_radius_px

    def unseen_in_right(self, z_px: Array) -> NDArray[np.bool_]:
        """Which views (n, 4) have a right side where a mask says that it cannot be of the scene."""
        if self.right_area is None:
            return np.zeros(len(z_px), bool)
        return ~core.inside_area(self.right_area, z_px[:, 2:].copy())

    @cached_property
    def std_acceleration(self) -> Array:
        """σ (6,) of the acceleration, m/s², and of the angular one, rad/s², that the camera may have."""
        return np.array(self.config.motion.std_acceleration)


@record
class MapState:
    """How far the map of one camera has come; a pair does not need it.

    `mapped`: whether there is a map; before, `waiting` says for what, and the opening frame had `n_opened` points. Ids
    from `first_unseen_id` on have not been handed out. `rho_scene`: median inverse depth of what was last in view, 0
    before the first map; `cov_start` (6, 6): of first_from_now when the map has begun.
    """

    mapped: bool = False
    waiting: str = ""
    n_opened: int = 0
    first_unseen_id: int = 0
    rho_scene: float = 0.0
    cov_start: Array = field(default_factory=lambda: np.zeros((6, 6)))


@record
class FrontEndState:
    """The state between two frames; nothing in it is ever written to.

    - `frame_index`: of the next frame; `stamp_ns`: of the latest one, None before the first; `grey_bits`: of 16-bit
      images that are used, by the brightest ones so far.
    - `previous`: the images that the next frame is followed from, of a frame at `previous_ns`. `tracks` are the points
      that are followed, `next_id` is the id of the next new one. `cam_from_start` (4, 4): the front-end's own chain of
      motions, which predicts how patches look and is not an estimate; `velocity` (6,): ξ of the last motion per second;
      `unsteadiness`: how motions change, None before there were two.
    - `aligners`: templates and noise of views; `rows`, `timing`: what is known of the cameras; `turn_rad` (3,): of the
      right camera since its calibration, for which right views are corrected, as they are since frame `turned_at`;
      `rows_waiting` (n, 4): new views of a frame whose velocity is not known yet, which a late camera would turn into
      rows that are off.
    - `turn_watch`: of the right camera, None where it cannot turn; `pair`: whether left and right fit each other;
      `background_hidden`: since the last frame that was followed; `ambiguity`: between two motions; `start`:
      whether the map has started with the motion of the camera; `steps`: whether both images have been displaced;
      `suspicions`: what several frames together say against their images.
    - `errors`: what is learnt of errors that views of a point share; `disparity`: of its error, as far as it is known.
    - `map`: with one camera, how far the map has come.
    """

    aligners: Aligners
    timing: Timing
    rows: Rows
    turn_watch: TurnWatch | None
    errors: TemplateErrors
    disparity: DisparityError | None = None
    turn_rad: Array = field(default_factory=lambda: np.zeros(3))
    turned_at: int = 0
    frame_index: int = 0
    stamp_ns: int | None = None
    grey_bits: int = FEWEST_BITS
    previous: PreparedImages | None = None
    previous_ns: int = 0
    tracks: Tracks = field(default_factory=Tracks.none)
    next_id: int = 0
    cam_from_start: Array = field(default_factory=lambda: np.eye(4))
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    unsteadiness: Unsteadiness | None = None
    background_hidden: bool = False
    ambiguity: AmbiguityMemory = field(default_factory=AmbiguityMemory)
    start: StartCheck = field(default_factory=StartCheck)
    steps: StepCheck = field(default_factory=StepCheck)
    suspicions: Suspicions = field(default_factory=Suspicions)
    rows_waiting: Array | None = None
    pair: PairCheck = field(default_factory=PairCheck)
    map: MapState = field(default_factory=MapState)

    @property
    def turn_root(self) -> Array:
        """A root (3, e) of the covariance of turns that the right camera has from frame to frame, radians."""
        return np.zeros((3, 0)) if self.turn_watch is None else self.turn_watch.root

    def with_turn(self, z_px: Array, cov_px: Array) -> Array:
        """Return covariances (n, 4, 4) of views (n, 4) as measurements of depth, which a turn of their frame moves."""
        return core.with_turn(self.rows.projection, z_px, cov_px, self.turn_root)

    @property
    def rows_with_delay(self) -> Rows:
        """What is known of the rows with the delay that an estimator has found."""
        return self.rows.with_delay(float(self.timing.mean[0]), float(self.timing.cov[0, 0]))

    def right_sides(self, twist: Array) -> RightSides:
        """Where right sides of points with a twist (6,) are sought."""
        return RightSides(self.rows_with_delay, self.turn_rad, twist)

    def change_to(self, cam_from_previous: Array, stamp_ns: int) -> Array | None:
        """By how much (6,) the motion into a frame differs from the last one; None where that is not known."""
        if not self.velocity.any():
            return None
        return se3.log(cam_from_previous) - self.velocity * (stamp_ns - self.previous_ns) / 1e9

    def followed_from(self, images: PreparedImages, stamp_ns: int) -> "FrontEndState":
        """The state after a frame from whose images the next one is followed."""
        return changed(self, previous=images.shrunk(), previous_ns=stamp_ns)

    def lost(self) -> "FrontEndState":
        """The state without tracks and velocity, and all that was learnt from these."""
        return changed(
            self,
            tracks=Tracks.none(),
            velocity=np.zeros(6),
            timing=changed(self.timing, twist=None),
            ambiguity=AmbiguityMemory(rules=self.ambiguity.rules),
            start=StartCheck(rules=self.start.rules),
            steps=StepCheck(rules=self.steps.rules),  # how a new map moves is not known
            suspicions=self.suspicions.interrupted(),
            background_hidden=False,
            turn_watch=None if self.turn_watch is None else self.turn_watch.calm(),
        )

    def may_wait(self, stamp_ns: int, max_gap_s: float) -> bool:
        """Whether the tracks of the last frame that was followed may still be found later than at that stamp."""
        return len(self.tracks) > 0 and stamp_ns - self.previous_ns < max_gap_s * 1e9
