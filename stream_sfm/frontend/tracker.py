"""The tracker: where the points of the previous frame are in this one, and the motion that they agree on.

Track by flow, find the robust motion, align with the templates, resect all views jointly and gate them, learn the
noise. Depths come from a `DepthSource`: the right image, or the parallax of one camera.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..geometry import se3
from ..geometry.resection import Resection, SecondMotion, resect
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from .alignment import AlignedViews, Candidates, TemplateAligners
from .contest import Contest
from .corners import detect
from .depth_source import DepthSource
from .flow import Flow
from .pair_check import Found
from .prepared import PreparedImages
from .right_turn import Turn, TurnWatch
from .rough_motion import RoughMotion, RoughMotionFinder
from .timing import Timing
from .tracks import Tracks
from .warps import anchor_from_now

# Fraction of the tracks that should be in view and agree with the final motion; fewer agree by chance: after a
# sudden blur of 5 px 14 of 196 did, with a motion that was off by 7 cm.
_MIN_AGREEMENT = 0.15
# Where a smaller share of the views agrees, those that do not live on as suspects. Calm frames have a few outliers,
# which are better forgotten.
_CONTESTED = 0.6
# The background is hidden where fewer tracks agree that have ever agreed before than this and than half of them, while
# as many suspects are more than a share of what is found, or as many new tracks agree on a motion that has jumped, or
# that came while it was hidden already: what agrees then moves by itself. Twice the views that a motion needs at least.
_MANY = 12
_MAX_SUSPECTS = 0.5
_JUMP = 4.0  # standard deviations of what the assumed acceleration does to a motion between two frames
# How long a motion is searched for from the last frame that had one. Views that come back come back within a second;
# later too much has changed for flow.
_MAX_GAP_S = 1.0


@dataclass(frozen=True, slots=True)
class Followed:
    """What following gave: the motion `cam_from_previous` (4, 4), and views `z_px` (n, 4) with covariances `cov_px`
    (n, 4, 4) of the tracks that live on, in the order of the tracker's table; `found`: all that were found; `rival`:
    another motion that may be right as well."""

    cam_from_previous: Array
    z_px: Array
    cov_px: Array
    found: Found | None = None
    rival: SecondMotion | None = None

    def with_right_turned_back(self, views: AlignedViews, turn: Turn) -> "Followed":
        """With right sides in `found` where they fit a turn of the right camera: such a pair is whole."""
        assert self.found is not None
        z_px = np.where(turn.agree[:, None], views.any_row_px[views.found], self.found.z_px)
        return replace(self, found=replace(self.found, z_px=z_px))

    def keep(self, rows: NDArray[np.bool_]) -> "Followed":
        """The given rows."""
        return replace(self, z_px=self.z_px[rows], cov_px=self.cov_px[rows])


@dataclass(frozen=True, slots=True)
class _Known:
    """Of the tracks (n) that were found in a frame, how they were `before`, with covariances `cov_points` (n, 4, 4) of
    their points; `weight`: of all tracks that should have been found; `unknown_px` (n, 4, j): as `Timing.unknowns`."""

    before: Tracks
    cov_points: Array
    weight: float
    unknown_px: Array | None = None


class Tracker:
    """Follows points through the images of a run; `tracks` is the table of those alive.

    Its own chain of motions, `cam_from_start`, predicts how patches look; it is not an estimate.
    """

    def __init__(
        self,
        projection: StereoProjection,
        config: Config,
        aligners: TemplateAligners,
        depth: DepthSource,
        timing: Timing,
        turn_watch: TurnWatch | None = None,
    ) -> None:
        """`turn_watch`: of the right camera, where it may turn against the left one."""
        self.timing = timing
        self.projection = projection
        self.config = config.frontend
        self.aligners = aligners
        self.depth = depth
        self.turn_watch = turn_watch
        self.flow = Flow(config.frontend, aligners)
        self.rough_motion = RoughMotionFinder(
            projection, config.frontend, self.flow, config.robust.gate_probability
        )
        self.contest = Contest()
        self.tracks = Tracks.none()
        self.next_id = 0
        self.cam_from_start = np.eye(4)
        self.velocity = np.zeros(6)  # ξ of cam_from_previous per second
        self.previous: PreparedImages | None = None
        self.stamp_ns = 0
        self.background_hidden = False  # and has been since the last frame that was followed
        self._gate_probability = config.robust.gate_probability
        self._std_acceleration = np.array(
            [config.motion.std_acceleration_m_s2, config.motion.std_angular_acceleration_rad_s2]
        )

    # -- following --------------------------------------------------------------------------------------------

    def follow(self, images: PreparedImages, stamp_ns: int) -> Followed | None:
        """Follow all tracks from the last remembered frame into this one; None, with nothing changed, where no motion
        is found."""
        dt_s = (stamp_ns - self.stamp_ns) / 1e9
        rough = self._find_rough_motion(images, dt_s)
        if rough is None:
            return None
        twist = self._twist_now(rough.cam_from_previous, dt_s)
        candidates = self._predict_patches(rough, twist)
        taken_px = self.timing.taken_out(candidates.now.points, twist)
        views = self.depth.align(images, candidates).without(taken_px)
        known = self._known_of(candidates, views, rough.cam_from_previous)
        known = replace(known, unknown_px=self._unknown_of(candidates, views, twist, dt_s))
        motion = self._resect_jointly(known, views, rough.cam_from_previous, dt_s)
        start = rough.cam_from_previous if motion is None else motion.cam_from_ref
        turn = self._judge_turn(known, views, start, twist)
        if turn is not None:
            views = views.left_only()
            motion = self._resect_jointly(known, views, rough.cam_from_previous, dt_s)
        if motion is None:
            return None
        seen = views.found
        self.aligners.learn(motion, candidates.now.scale[seen], views.z_px[seen])
        self.timing = self.timing.moved(twist)
        followed = self._advance(candidates, views, taken_px, motion, dt_s)
        return followed if turn is None else followed.with_right_turned_back(views, turn)

    def learn(self, mean: Array, cov: Array) -> None:
        """Take in that delay and readout are N(`mean` (2,), `cov` (2, 2)), seconds, and place the tracks anew by it."""
        before, self.timing = self.timing, self.timing.told(mean, cov)
        twist = self.timing.twist
        if twist is not None and (before.mean != self.timing.mean).any():
            points = self.tracks.points
            change_px = self.timing.taken_out(points, twist) - before.taken_out(points, twist)
            self.tracks = self.tracks.shifted(self.projection, change_px)

    def remember(self, images: PreparedImages, stamp_ns: int) -> None:
        """End the frame: the next one is followed from these images."""
        images.shrink()
        self.previous, self.stamp_ns = images, stamp_ns

    def lose(self) -> None:
        """Forget all tracks and the velocity."""
        self.tracks, self.velocity = Tracks.none(), np.zeros(6)
        self.contest = Contest()
        self.background_hidden = False
        if self.turn_watch is not None:
            self.turn_watch.forget()

    def may_wait(self, stamp_ns: int) -> bool:
        """Whether the tracks of the last remembered frame may still be found later than in the frame of that stamp."""
        return len(self.tracks) > 0 and stamp_ns - self.stamp_ns < _MAX_GAP_S * 1e9

    def _find_rough_motion(self, images: PreparedImages, dt_s: float) -> RoughMotion | None:
        """The motion since the previous frame by flow, started where the last velocity leads."""
        if self.previous is None or not len(self.tracks):
            return None
        predicted, known = se3.exp(self.velocity * dt_s), bool(self.velocity.any())
        return self.rough_motion.find(self.previous, images, self.tracks, predicted, known)

    def _twist_now(self, cam_from_previous: Array, dt_s: float) -> Array:
        """How the points move at the end of the interval from the previous frame, per second."""
        if dt_s <= 0:
            return np.zeros(6)
        between = se3.log(cam_from_previous) / dt_s
        return between + 0.5 * (between - self.velocity) if self.velocity.any() else between

    def _unknown_of(self, candidates: Candidates, views: AlignedViews, twist: Array, dt_s: float) -> Array | None:
        """What is not known of the timing of the views found: (n, 4, j) px."""
        before, now = candidates.before.points[views.found], candidates.now.points[views.found]
        return self.timing.unknowns(before, now, twist, np.repeat(self._std_acceleration, 3) * dt_s)

    def _predict_patches(self, rough: RoughMotion, twist: Array) -> Candidates:
        """Where the rough motion puts the tracks, and how their patches look there; without those out of view."""
        now = self.tracks.moved(rough.cam_from_previous)
        expected = self.projection.project_homogeneous(now.points)
        left_px = np.where(
            rough.agree[:, None], rough.left_px, expected[:, :2]
        )  # what flow lost, the motion may find
        right_u_px = left_px[:, 0] - expected[:, 0] + expected[:, 2]
        warps = anchor_from_now(now, rough.cam_from_previous @ self.cam_from_start, self.projection)
        return self.aligners.visible(Candidates(self.tracks, now, left_px, right_u_px, *warps, twist))

    def _known_of(self, candidates: Candidates, views: AlignedViews, motion: Array) -> _Known:
        """What is known of the tracks that were found, for a motion (4, 4) near the true one."""
        before, now = candidates.before.keep(views.found), candidates.now.keep(views.found)
        cov_points = before.cov_points(self.projection, self.aligners.drift(now, motion))
        return _Known(before, cov_points, float(candidates.before.weights.sum()))

    def _resect_jointly(self, known: _Known, views: AlignedViews, start: Array, dt_s: float) -> Resection | None:
        """The motion that the views found agree on; its gate says which tracks live on. None where too few agree."""
        before = known.before
        motion = resect(
            self.projection,
            before.points,
            known.cov_points,
            views.z_px[views.found],
            views.cov_px[views.found],
            start,
            self._gate_probability,
            before.weights,
            shared=known.unknown_px,
        )
        enough = _MIN_AGREEMENT * known.weight
        agree = motion.ok and before.weights[motion.accepted].sum() >= enough
        hidden = self._is_background_hidden(before, motion, dt_s)
        self.background_hidden = hidden or (self.background_hidden and not agree)
        return motion if agree and not hidden else None

    def _judge_turn(
        self, known: _Known, views: AlignedViews, cam_from_previous: Array, twist: Array
    ) -> Turn | None:
        """The turn of the right camera that the frame shows, if it is an unusual one."""
        if self.turn_watch is None:
            return None
        z_px, cov_px = views.any_row_px[views.found], views.cov_px[views.found]
        by_delay_rad = np.sqrt(self.timing.cov[0, 0]) * twist[3:]
        return self.turn_watch.judge(
            known.before.points, known.cov_points, z_px, cov_px, cam_from_previous, by_delay_rad
        )

    def _is_background_hidden(self, found: Tracks, motion: Resection, dt_s: float) -> bool:
        """Whether the tracks found (n,) are mostly of things that move by themselves, and so is their motion."""
        trusted, agree = found.agreed > 0, motion.accepted
        needed = min(_MANY, 0.5 * (self.tracks.agreed > 0).sum())
        if (agree & trusted).sum() >= needed:
            return False
        suspects = int((found.rejected > 0).sum())
        if suspects >= _MANY and suspects > _MAX_SUSPECTS * len(found):
            return True
        strange = self.background_hidden or self._jumps(motion.cam_from_ref, dt_s)
        return bool(strange and (agree & ~trusted).sum() >= _MANY)

    def _jumps(self, cam_from_previous: Array, dt_s: float) -> bool:
        """Whether a motion is not what the last velocity and any acceleration that is assumed would make of it."""
        apart = np.abs(se3.log(se3.exp(-self.velocity * dt_s) @ cam_from_previous)).reshape(2, 3).max(axis=1)
        return bool((apart > _JUMP * self._std_acceleration * dt_s**2).any())

    def _advance(
        self, candidates: Candidates, views: AlignedViews, taken_px: Array, motion: Resection, dt_s: float
    ) -> Followed:
        """Move on to this frame, each track put where it was seen: with the accepted ones, and with suspects.

        `taken_px` (n, 4): what was taken out of the views, which are handed out as they were seen.
        Where many disagree with the motion, they may be right another time, and in any case no new tracks are wanted
        beside them: they live on as suspects.
        """
        self.cam_from_start = se3.orthonormalise(motion.cam_from_ref @ self.cam_from_start)
        self.velocity = se3.log(motion.cam_from_ref) / dt_s if dt_s > 0 else np.zeros(6)
        kept = motion.accepted.copy()
        if motion.second is not None:
            kept |= motion.second.views
        if kept.mean() < _CONTESTED:
            kept[np.flatnonzero(~kept)[: self.config.max_tracks // 2]] = True
        rows = np.flatnonzero(views.found)[kept]
        # where most views fit badly, the frame is worse than the run's, not full of outliers: blurred, for instance
        z_px, cov_px = views.z_px[rows], motion.spread * views.cov_px[rows]
        now = candidates.before.keep(rows).moved(motion.cam_from_ref)
        now = self.depth.update(now, z_px, cov_px, self.cam_from_start)
        now = replace(now, left_px=z_px[:, :2] + taken_px[rows, :2])
        rival = self.contest.judge(motion)
        self.tracks = now.judged(motion.accepted[kept], contested=rival is not None)
        found = self._found(candidates, views, motion)
        return Followed(motion.cam_from_ref, z_px + taken_px[rows], cov_px, found, rival)

    def _found(self, candidates: Candidates, views: AlignedViews, motion: Resection) -> Found:
        """The tracks found, as they were before the frame."""
        seen = views.found
        before = candidates.before.keep(seen)
        covs = before.cov_points(self.projection)
        radius_px = before.scale * self.config.window_radius_px
        return Found(before.ids, before.points, covs, views.z_px[seen], views.cov_px[seen], radius_px, motion)

    # -- new tracks -------------------------------------------------------------------------------------------

    @property
    def missing(self) -> int:
        """How many tracks of ordinary templates more there should be; suspects do not count."""
        return self.config.max_tracks - int(((self.tracks.scale == 1) & (self.tracks.rejected == 0)).sum())

    def detect_corners(self, images: PreparedImages) -> NDArray[np.intp]:
        """As many corners (k, 2) as are missing at most, whole pixels of the coarse left image, away from tracks."""
        cfg, scale = self.config, images.scale
        return detect(
            images.corner_strength,
            self.tracks.left_px * scale,
            self.aligners.fine.area.coarse(round(1 / scale)),
            self.missing,
            cfg.min_corner_distance_px * scale,
            cfg.min_corner_response,
        )

    def add(
        self,
        slots: NDArray[np.intp],
        left_px: Array,
        cov_left_px: Array,
        rho: Array,
        var_rho: Array,
        slopes: Array,
        taken_px: Array,
        scale: int = 1,
    ) -> Tracks:
        """Begin tracks at left positions (n, 2) with covariances (n, 2, 2), templates in `slots` (n,), inverse depths
        (n,) with variances, and slopes (n, 2); `taken_px` (n, 2) is taken out of the positions to get the rays."""
        n = len(slots)
        rays = self.projection.rays(left_px - taken_px)
        new = Tracks(
            ids=self.next_id + np.arange(n, dtype=np.int64),
            slots=slots,
            left_px=left_px,
            cov_left_px=cov_left_px,
            points=np.concatenate([rays, np.ones((n, 1)), rho[:, None]], axis=1),
            var_rho=var_rho,
            anchor_from_start=np.broadcast_to(self.cam_from_start, (n, 4, 4)),
            anchor_rays=rays,
            slopes=slopes,
            scale=np.full(n, scale, np.int64),
            agreed=np.zeros(n, np.int64),
            rejected=np.zeros(n, np.int64),
        )
        self.next_id += n
        self.tracks = self.tracks.append(new)
        return new
