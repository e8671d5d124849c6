"""The state of the front-end between two frames: one record, which a step replaces and never changes."""

from collections.abc import Callable
from dataclasses import field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..camera.pixels import FEWEST_BITS
from ..config import Config
from ..config.rules import Rules
from ..geometry import Array
from ..geometry.stereo import StereoProjection
from ..pictures.checks import Suspicions
from ..pictures.prepared import PreparedImages
from ..pictures.torn import Copied
from ..record import changed, record
from .alignment import Aligners
from .learnt.disparity_error import DisparityError
from .learnt.pair_check import PairCheck, PairRules
from .learnt.right_turn import TurnWatch
from .learnt.rows import Rows
from .learnt.template_errors import TemplateErrors
from .learnt.timing import Timing, TurningError
from .rules import ErrorRules
from .second_motions.ambiguity import AmbiguityMemory
from .second_motions.start_check import StartCheck
from .second_motions.unsteadiness import Unsteadiness
from .tracks import Tracks


class RightSides(NamedTuple):
    """Predicts right sides: by row differences, a turn (3,) of the right camera, and the twist (6,) of the points."""

    rows: Rows
    turn_rad: Array
    twist: Array


@record
class Setup:
    """The constants of a run: the projection of the rectified images, and all settings.

    `right_area` (h, w): pixels of the right image around which a whole patch shows the scene; None if all do.
    `raw_shifts_px`: returns right minus left positions (n, 2) in the raw images of views (n, 4), None for one camera.
    """

    projection: StereoProjection
    config: Config
    right_area: NDArray[np.bool_] | None = None
    raw_shifts_px: Callable[[Array], Array] | None = None

    @cached_property
    def rules(self) -> Rules:
        """The thresholds of the front-end's decisions."""
        return self.config.rules

    @property
    def slide_px(self) -> float:
        """The drift s r of eq. (17) of a template that changes completely, in template pixels."""
        return self.rules.of(ErrorRules).slide * self.config.frontend.window_radius_px

    def unseen_in_right(self, z_px: Array) -> NDArray[np.bool_]:
        """Return which views (n, 4) have a right side that a mask excludes from the scene."""
        if self.right_area is None:
            return np.zeros(len(z_px), bool)
        return ~core.inside_area(self.right_area, z_px[:, 2:].copy())

    @cached_property
    def std_acceleration(self) -> Array:
        """The assumed σ (6,) of the camera's acceleration, m/s², and angular acceleration, rad/s²."""
        return np.array(self.config.motion.std_acceleration)


@record
class MapState:
    """The progress of the map with one camera; a pair does not need it.

    `mapped`: whether there is a map. Before that, `waiting` says what it waits for, and `n_opened` is the number of
    points of the opening frame. Ids from `first_unseen_id` on have not been handed out. `rho_scene`: the median inverse
    depth of the points last in view, 0 before the first map; `cov_start` (6, 6): of first_from_now at the map's start.
    """

    mapped: bool = False
    waiting: str = ""
    n_opened: int = 0
    first_unseen_id: int = 0
    rho_scene: float = 0.0
    cov_start: Array = field(default_factory=lambda: np.zeros((6, 6)))


@record
class FrontEndState:
    """The state between two frames, whose fields are never modified.

    - `frame_index`: of the next frame; `stamp_ns`: of the latest one, None before the first; `grey_bits`: the bits of
      16-bit images in use, according to the brightest so far.
    - `previous`: the images, at `previous_ns`, from which the next frame is followed; `copied`: which rows of the
      latest ones were those of `previous`. `tracks`: the points that are followed; `next_id`: the id of the next new
      one. `cam_from_start` (4, 4): the front-end's own chain of motions,
      which predicts how patches look and is not an estimate; `velocity` (6,): ξ of the last motion per second;
      `turning_error`: of twists that follow from it;
      `unsteadiness`: how much motions change, None before there are two.
    - `aligners`: templates and noise of views; `rows`, `timing`: the estimated errors of the cameras; `turn_rad` (3,):
      the turn of the right camera since its calibration for which right views are corrected, since frame `turned_at`;
      `rows_waiting` (n, 4): new views of a frame of unknown velocity, in which a late camera would look like wrong
      rows.
    - `turn_watch`: detects turns of the right camera, None if it cannot turn; `pair`: whether left and right are
      consistent; `background_hidden`: whether the background is, since the last frame that was followed; `ambiguity`:
      between two motions; `start`: whether the map has started with the motion of the camera; `pictures`: what is
      suspected of all images.
    - `errors`: the learnt errors that views of a point share; `disparity`: the estimated disparity error.
    - `map`: with one camera, the progress of the map.
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
    copied: Copied = Copied(None, None)
    tracks: Tracks = field(default_factory=Tracks.none)
    next_id: int = 0
    cam_from_start: Array = field(default_factory=lambda: np.eye(4))
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    turning_error: TurningError = TurningError()
    unsteadiness: Unsteadiness | None = None
    background_hidden: bool = False
    ambiguity: AmbiguityMemory = field(default_factory=AmbiguityMemory)
    start: StartCheck = field(default_factory=StartCheck)
    pictures: Suspicions = field(default_factory=Suspicions)
    rows_waiting: Array | None = None
    pair: PairCheck = field(default_factory=lambda: PairCheck.of(PairRules()))
    map: MapState = field(default_factory=MapState)

    @property
    def turn_root(self) -> Array:
        """A root (3, e), rad, of the covariance of the right camera's turns from frame to frame."""
        return np.zeros((3, 0)) if self.turn_watch is None else self.turn_watch.usual.root

    @property
    def unusual_rad(self) -> Array:
        """The turn (3,) of the right camera in the latest frame if it is unusual, else zero."""
        return np.zeros(3) if self.turn_watch is None else self.turn_watch.unusual_rad

    def with_turn(self, z_px: Array, cov_px: Array) -> Array:
        """Return covariances (n, 4, 4) of views (n, 4) as depth measurements, with that of the turn of their frame."""
        return core.with_turn(self.rows.projection, z_px, cov_px, self.turn_root)

    @property
    def rows_with_delay(self) -> Rows:
        """The row differences updated with the delay that an estimator has found."""
        return self.rows.with_delay(float(self.timing.mean[0]), float(self.timing.cov[0, 0]))

    def right_sides(self, twist: Array) -> RightSides:
        """Return where right sides of points with a twist (6,) are sought."""
        return RightSides(self.rows_with_delay, self.turn_rad + self.unusual_rad, twist)

    def followed_from(self, images: PreparedImages, stamp_ns: int) -> "FrontEndState":
        """Return the state after a frame from whose images the next one is followed."""
        return changed(self, previous=images.shrunk(), previous_ns=stamp_ns)

    def lost(self) -> "FrontEndState":
        """Return the state without tracks, velocity, and what depends on these."""
        return changed(
            self,
            tracks=Tracks.none(),
            velocity=np.zeros(6),
            timing=changed(self.timing, twist=None),
            ambiguity=AmbiguityMemory.none(self.start.rules),
            start=StartCheck.of(self.start.rules),
            pictures=self.pictures.interrupted(),
            background_hidden=False,
            turn_watch=None if self.turn_watch is None else self.turn_watch.calm(),
        )

    def may_wait(self, stamp_ns: int, max_gap_s: float) -> bool:
        """Whether the tracks of the last frame that was followed may still be found after a given stamp."""
        return len(self.tracks) > 0 and stamp_ns - self.previous_ns < max_gap_s * 1e9
