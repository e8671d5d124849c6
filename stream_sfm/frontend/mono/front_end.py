"""One camera: what takes the place of the right image.

A map begins when the motion since an opening frame shows depths (`two_view`); from then on they are learnt from
parallax (`parallax`). Estimators meet a point in its second view, as a stereo view whose right side says what the
parallax has shown so far, and hardly counts; all its later views have no right side.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...geometry import se3
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ...types import MapStart, Observations
from ..disparity_bias import SharedErrors
from ..front_end import FrontEnd, _note
from ..prepared import Image, PreparedImages
from ..tracks import Tracks
from .parallax import MonoTracks
from .two_view import two_view_motion

_LEAST_TRACKS = 30  # since the opening frame, and at least this share of its points
_LEAST_SHARE = 0.5
_KNOWN = 3.0  # inverse depth over its σ
STD_SCENE = 3.0  # σ of an unknown inverse depth, in units of the scene's median
# The estimator gets the views, too, from which depths were learnt here: those enter with so many times their σ.
INFLATED = 2.0
_NOTHING_PX2 = 1e8  # variance of a coordinate that says nothing
_LOST = "the motion was lost; a new map needs parallax"

_Found = tuple[Array | None, Array, Array]  # cam_from_previous, views (n, 4), covariances (n, 4, 4)


def _nothing() -> _Found:
    return None, np.empty((0, 4)), np.empty((0, 4, 4))


def pretended(p: StereoProjection, z: Array, cov: Array, rho: Array, var_rho: Array) -> tuple[Array, Array]:
    """Left sides of views z (n, 4), cov (n, 4, 4) with right sides of inverse depths (n,) and variances, eq. (66)."""
    cov = cov.copy()
    cov[:, 2:] = cov[:, :, 2:] = 0
    cov[:, 2, 2], cov[:, 3, 3] = (p.f_px * p.baseline_m) ** 2 * var_rho, _NOTHING_PX2
    return np.stack([z[:, 0], z[:, 1], z[:, 0] - p.f_px * p.baseline_m * rho, z[:, 1]], axis=1), cov


class MonoFrontEnd(FrontEnd):
    """Follows points through the rectified images of one camera; `projection` pretends a right one."""

    tracks: MonoTracks

    def __init__(self, projection: StereoProjection, config: Config, valid: NDArray[np.bool_]) -> None:
        super().__init__(projection, config, valid)
        self.tracks = MonoTracks.none()
        self.shared_errors = SharedErrors(least_px=0.0)  # there is no other patch
        self.mapped = False
        self.opened_with = 0  # points of the opening frame
        self.waiting = ""  # for what, before a map
        self.first_unseen_id = 0  # ids from here on have not been handed out
        self.rho_scene = 0.0  # median inverse depth of what was last in view; 0 before the first map
        self.cov_start = np.zeros((6, 6))

    def prepare(self, left: Image, right: Image | None = None, frame_index: int | None = None) -> PreparedImages:
        """As `FrontEnd.prepare`; corners are rarely wanted, and computed in `step`."""
        return PreparedImages.of(left, left, self.config.smoothing_px)

    def step(self, frame_index: int, stamp_ns: int, pair: PreparedImages) -> Observations:
        """Observations of the next frame as `FrontEnd.step`; none while depths are not observable."""
        if self.mapped:
            motion, z, cov = self._in_front(*self._follow(pair, (stamp_ns - self.stamp_ns) / 1e9))
            if motion is None:
                self._reopen(_LOST)
        else:
            motion, z, cov = self._begin(pair)
        self.mapped = motion is not None
        start, n_new, drift = None, 0, np.zeros(0)
        ids = self.tracks.ids if self.mapped else np.empty(0, np.int64)
        if motion is not None:
            drift = self.noise.drift(self.tracks.points, motion)
            n_new, z, cov, start = self._with_right_sides(z, cov)
        self._renew_left(pair)
        note = _note(pair, self.previous, len(self.tracks), len(self.tracks))
        self.previous, self.stamp_ns = pair, stamp_ns
        return Observations(
            frame_index=frame_index,
            stamp_ns=stamp_ns,
            track_ids=ids,
            z_px=z,
            cov_px=cov,
            cam_from_previous=motion,
            note=note or ("" if self.mapped else self.waiting),
            n_new=n_new,
            std_drift_px=drift,
            start=start,
        )

    # -- before a map -----------------------------------------------------------------------------------------

    def _reopen(self, why: str) -> None:
        """This frame becomes the opening one."""
        self.tracks, self.cam_from_start = MonoTracks.none(), np.eye(4)
        self.waiting = why

    def _begin(self, pair: PreparedImages) -> _Found:
        """Views, and the motion since the opening frame (not the previous one), as soon as they show depths."""
        if not len(self.tracks):
            self._reopen("depths need a second view")
            return _nothing()
        cov = self._follow_directions(pair)
        if len(self.tracks) < max(_LEAST_TRACKS, _LEAST_SHARE * self.opened_with):
            self._reopen(
                f"{len(self.tracks)} of {self.opened_with} points could be followed since the opening frame"
            )
            return _nothing()
        p, tracks = self.projection, self.tracks
        std_px = np.sqrt(np.median(np.trace(cov[:, :2, :2], axis1=1, axis2=2)) / 2)
        found = two_view_motion(tracks.anchor_rays, tracks.points[:, :2], float(std_px) / p.f_px)
        self.waiting = found.problem if found else "no rigid motion explains the points"
        if found is None or self.waiting:
            if found is not None:  # its direction may mean nothing yet, its rotation turns the templates
                self.cam_from_start = se3.from_rotation_translation(found.now_from_first[:3, :3], np.zeros(3))
            return _nothing()
        tracks, rho, var_rho = tracks.keep(found.agree), found.rho[found.agree], found.var_rho[found.agree]
        # after a loss the best guess of the unit is that the scene is as far away as it was
        self.rho_scene = self.rho_scene or float(np.median(rho))
        unit = float(np.median(rho)) / self.rho_scene
        self.cam_from_start = found.now_from_first.copy()
        self.cam_from_start[:3, 3] *= unit
        self.cov_start, self.velocity = found.cov_first_from_now, np.zeros(6)
        points = np.concatenate([tracks.anchor_rays, np.ones((len(rho), 1)), rho[:, None] / unit], axis=1)
        self.tracks = replace(tracks, points=points, var_rho=var_rho / unit**2).moved(self.cam_from_start)
        self.first_unseen_id = self.next_id
        z = np.concatenate([tracks.left_px, np.full((len(rho), 2), np.nan)], axis=1)
        return self.cam_from_start, z, cov[found.agree]

    def _follow_directions(self, pair: PreparedImages) -> Array:
        """Follow the tracks, all taken for infinitely far; covariances (n, 4, 4) of what is left of them."""
        assert self.previous is not None
        at, found = self._flow(self.previous.half_exposed_as(pair)[0], pair, self.tracks)
        warps = self.tracks.anchor_from_now(self.cam_from_start, self.projection.baseline_m)[0]
        found &= self.atlas.fits(warps)
        tracks, at, warps = self.tracks.keep(found), at[found], warps[found]
        patches = self.atlas.warped(tracks.slots, warps)
        left, error, good = self._align_left(pair, patches, at)
        self.tracks = tracks.keep(good).placed(left[good], self.projection)
        return self._cov_left(patches.gradients[good], error[good])

    # -- in a map ---------------------------------------------------------------------------------------------

    def _in_front(self, motion: Array | None, z: Array, cov: Array) -> _Found:
        """Without the tracks that such a motion puts behind the camera; it is wrong where they are the majority."""
        if motion is None:
            return _nothing()
        front = self.tracks.points[:, 3] > -_KNOWN * np.sqrt(self.tracks.var_rho)
        if front.mean() < 0.5:
            return _nothing()
        self.tracks = self.tracks.keep(front)
        return motion, z[front], cov[front]

    def _align(
        self, pair: PreparedImages, tracks: Tracks, start: Array, warps: tuple[Array, Array], start_right_u: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        patches = self.atlas.warped(tracks.slots, warps[0])
        left, error, good = self._align_left(pair, patches, start)
        z = np.concatenate([left, np.full_like(left, np.nan)], axis=1)
        return z, self._cov_left(patches.gradients, error), good

    def _cov_left(self, gradients: Array, error: Array) -> Array:
        return self.noise.covariance(gradients, error, np.full(len(error), np.nan))

    def _measured(self, tracks: Tracks, z: Array, cov: Array) -> Tracks:
        assert isinstance(tracks, MonoTracks)
        return tracks.with_depths(z, cov, self.cam_from_start, self.projection)

    def _with_right_sides(self, z: Array, cov: Array) -> tuple[int, Array, Array, MapStart]:
        """The views with right sides where a track is handed out for the first time; their number; and the views with
        all their right sides."""
        rho, var_rho = self.tracks.points[:, 3], self.tracks.var_rho
        known = rho > _KNOWN * np.sqrt(var_rho)
        if known.sum() >= _LEAST_TRACKS:
            self.rho_scene = float(np.median(rho[known]))
        var_known = INFLATED**2 * var_rho
        all_sides = pretended(self.projection, z, cov, rho, var_known)
        start = MapStart(*all_sides, se3.inverse(self.cam_from_start), self.cov_start)
        new = self.tracks.ids >= self.first_unseen_id
        self.first_unseen_id = self.next_id
        z_new, cov_new = pretended(self.projection, z, cov, rho, var_known + (STD_SCENE * self.rho_scene) ** 2)
        z, cov = np.where(new[:, None], z_new, z), np.where(new[:, None, None], cov_new, cov)
        return int(new.sum()), z, cov, start

    # -- new points -------------------------------------------------------------------------------------------

    def _renew_left(self, pair: PreparedImages) -> None:
        """New tracks where they are missing, at the depth of the scene; before a map in the opening frame only."""
        cfg = self.config
        wanted = cfg.max_tracks - len(self.tracks)
        if wanted < cfg.max_tracks * cfg.renew_share or (len(self.tracks) and not self.mapped):
            return
        corners = self._corners(pair, wanted) * round(1 / pair.scale)
        n = len(corners)
        if not n:
            return
        slots = np.setdiff1d(np.arange(2 * cfg.max_tracks), self.tracks.slots)[:n]
        self.atlas.store(pair.left_grey, corners, slots)
        left = corners.astype(float)
        rays = self.projection.rays(left)
        rho = np.full(n, self.rho_scene if self.mapped else 0.0)
        new = MonoTracks(
            ids=self.next_id + np.arange(n, dtype=np.int64),
            slots=slots,
            left_px=left,
            points=np.concatenate([rays, np.ones((n, 1)), rho[:, None]], axis=1),
            var_rho=(STD_SCENE * rho) ** 2,
            anchor_from_start=np.broadcast_to(self.cam_from_start, (n, 4, 4)),
            slopes=np.zeros((n, 2)),
            anchor_rays=rays,
        )
        self.next_id += n
        self.tracks = self.tracks.joined(new)
        self.opened_with = n if not self.mapped else 0
