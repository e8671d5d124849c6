"""The front-end's page: rectified images in, observations out.

Each frame: follow the points with Lucas-Kanade from the last image, find the motion, align every point in both
images against the template of its first frame, reject what does not fit one rigid motion, fill up with new corners.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..geometry import se3
from ..geometry.resection import resect
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..types import Observations
from .corners import detect
from .disparity_bias import SharedErrors
from .noise import ViewNoise
from .prepared import Image, PreparedImages
from .slant import disparity_slopes
from .stereo_matching import search_rows
from .templates import Patches, TemplateAtlas
from .tracks import Tracks
from .vertical_disparity import RowAlignment

_FULL_SEARCH = 4  # frames
_RENEWAL = 2  # frames; and in every frame while more than this share of the tracks is missing
_URGENT_SHARE = 0.6
_SEARCH_MARGIN_PX = 16.0
_HALF_PATCH_PX = 0.5  # between the matches of a whole patch and of its inner half
_LEAST_SHARE = 0.15  # of the tracks that should be in view; fewer agree by chance
_FEW = 8  # with fewer points something is wrong with the images


class FrontEnd:
    """Follows points through rectified pairs. `valid` (h, w): pixels of the left image that hold picture."""

    def __init__(self, projection: StereoProjection, config: Config, valid: NDArray[np.bool_]) -> None:
        self.projection = projection
        self.config = config.frontend
        self.gate_probability = config.robust.gate_probability
        r = self.config.window_radius_px
        edge = np.zeros_like(valid)
        edge[r:-r, r:-r] = True
        self.valid = cv2.erode(valid.astype(np.uint8), np.ones((2 * r + 1, 2 * r + 1))).astype(bool) & edge
        self.atlas = TemplateAtlas(2 * self.config.max_tracks, r)
        self.noise = ViewNoise(self.config.smoothing_px, r)
        self.rows = RowAlignment(projection)
        self.shared_errors = SharedErrors()
        self.tracks = Tracks.none()
        self.next_id = 0
        self.previous: PreparedImages | None = None
        self.velocity = np.zeros(6)  # ξ of cam_from_previous a second
        self.cam_from_start = np.eye(4)
        self.stamp_ns = 0

    def prepare(self, left: Image, right: Image, frame_index: int | None = None) -> PreparedImages:
        """Compute from rectified images (h, w) uint8 the forms that `step` needs.

        Pure: any thread may call it at any time, in any order, also for frames that are never stepped. With the
        `frame_index` that the frame is going to have, its corners are computed here too and not in `step`; the
        observations are the same.
        """
        images = PreparedImages.of(left, right, self.config.smoothing_px)
        if frame_index is not None and _renews(frame_index):
            _ = images.corner_strength  # computed now, kept for `step`
        return images

    def step(self, frame_index: int, stamp_ns: int, pair: PreparedImages) -> Observations:
        """Observations of the next frame; indices count the frames from 0, stamps ascend."""
        motion, z, cov = None, np.empty((0, 4)), np.empty((0, 4, 4))
        dt = (stamp_ns - self.stamp_ns) / 1e9
        if len(self.tracks):
            motion, z, cov = self._follow(pair, dt)
        kept = len(self.tracks)
        drift = np.zeros(0) if motion is None else self.noise.drift(self.tracks.points, motion)
        z_new, cov_new = self._renew(pair, frame_index)
        z = np.concatenate([z, z_new])
        note = _note(pair, self.previous, len(self.tracks), int(np.isfinite(z).all(axis=1).sum()))
        self.previous, self.stamp_ns = pair, stamp_ns
        return Observations(
            frame_index=frame_index,
            stamp_ns=stamp_ns,
            track_ids=self.tracks.ids,
            z_px=z,
            cov_px=np.concatenate([cov, cov_new]),
            cam_from_previous=motion,
            note=note,
            n_new=len(self.tracks) - kept,
            std_drift_px=np.concatenate([drift, np.zeros(len(z_new))]),
        )

    # -- old points -------------------------------------------------------------------------------------------

    def _follow(self, pair: PreparedImages, dt: float) -> tuple[Array | None, Array, Array]:
        """Motion since the last frame (None: not found), views (n, 4) and covariances of the tracks that live on."""
        predicted = se3.exp(self.velocity * dt)
        assert self.previous is not None
        for before_half in self.previous.half_exposed_as(pair):
            at, found = self._flow(before_half, pair, self.tracks.moved(predicted))
            z = np.full((len(self.tracks), 4), np.nan)
            z[found, :2] = at[found]
            motion = self._motion(z, predicted, std_px=0.5)
            if motion is not None:
                break
        if motion is None:
            self.tracks, self.velocity = Tracks.none(), np.zeros(6)
            return None, np.empty((0, 4)), np.empty((0, 4, 4))
        cam_from_previous, agree = motion
        before, tracks = self.tracks, self.tracks.moved(cam_from_previous)
        expected = self.projection.project_homogeneous(tracks.points)
        start = np.where(agree[:, None], at, expected[:, :2])  # what flow lost, the motion may find
        warps = tracks.anchor_from_now(cam_from_previous @ self.cam_from_start, self.projection.baseline_m)
        usable = self.atlas.fits(warps[0]) & self.atlas.fits(warps[1]) & self._inside(start)
        before, tracks = before.keep(usable), tracks.keep(usable)
        start, expected, warps = start[usable], expected[usable], (warps[0][usable], warps[1][usable])
        z, cov, good = self._align(pair, tracks, start, warps, start[:, 0] - expected[:, 0] + expected[:, 2])
        sought = len(before)
        before, z, cov = before.keep(good), z[good], cov[good]
        cov_points = before.cov_points(self.noise.var_ray(self.projection))
        final = resect(self.projection, before.points, cov_points, z, cov, cam_from_previous, self.gate_probability)
        if not final.ok or final.accepted.sum() < _LEAST_SHARE * sought:
            self.tracks, self.velocity = Tracks.none(), np.zeros(6)
            return None, np.empty((0, 4)), np.empty((0, 4, 4))
        self.noise.learn(final.chi2, final.dof)
        cam_from_previous = final.cam_from_ref
        self.cam_from_start = se3.orthonormalise(cam_from_previous @ self.cam_from_start)
        self.velocity = se3.log(cam_from_previous) / dt if dt > 0 else np.zeros(6)
        good = final.accepted
        # a frame in which most views fit badly is worse than the run's, and not full of outliers: blurred, for instance
        z, cov = z[good], final.spread * cov[good]
        self.tracks = self._measured(before.moved(cam_from_previous).keep(good), z, cov)
        return cam_from_previous, z, cov

    def _measured(self, tracks: Tracks, z: Array, cov: Array) -> Tracks:
        """Tracks in the new camera, put where they were seen in it."""
        return tracks.measured(z, cov, self.projection)

    def _flow(self, before_half: Image, pair: PreparedImages, moved: Tracks) -> tuple[Array, NDArray[np.bool_]]:
        """Pyramidal Lucas-Kanade from the left image before, started where the predicted motion puts the points; at
        half the size, for it is a start only."""
        start = np.ascontiguousarray(self.projection.project_homogeneous(moved.points)[:, :2], np.float32)
        radius = 3 * self.config.window_radius_px // 4
        at, status, _ = cv2.calcOpticalFlowPyrLK(
            before_half,
            pair.left_half,
            np.ascontiguousarray(self.tracks.left_px / 2, np.float32).reshape(-1, 1, 2),
            start.reshape(-1, 1, 2) / 2,
            winSize=(2 * radius + 1, 2 * radius + 1),
            maxLevel=max(self.config.pyramid_levels - 1, 0),
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.03),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            minEigThreshold=1e-5,
        )
        followed = status[:, 0] > 0  # the rest of what comes back is not initialised
        positions: Array = np.where(followed[:, None], 2 * np.asarray(at)[:, 0], start).astype(np.float64)
        return positions, followed & self._inside(positions)

    def _motion(self, z: Array, start: Array, std_px: float) -> tuple[Array, NDArray[np.bool_]] | None:
        """Motion since the last frame from left views alone, and the tracks that agree with it."""
        seen = np.isfinite(z[:, 0])
        cov = np.broadcast_to(std_px**2 * np.eye(4), (int(seen.sum()), 4, 4))
        cov_points = self.tracks.cov_points(self.noise.var_ray(self.projection))[seen]
        found = None
        for guess in (start, np.eye(4)):
            found = resect(
                self.projection, self.tracks.points[seen], cov_points, z[seen], cov, guess, self.gate_probability
            )
            if found.ok and found.accepted.mean() > 0.4:
                agree = np.zeros(len(z), bool)
                agree[seen] = found.accepted
                return found.cam_from_ref, agree
        return None

    def _on_row(self, left: Array, right: Array) -> NDArray[np.bool_]:
        """Whether left and right positions (n, 2), already aligned by rows, agree as well as this run's matches do."""
        gate = min(self.rows.gate_px, self.config.max_row_difference_px)
        return np.asarray(np.abs(right[:, 1] - left[:, 1]) < gate)

    def _inside(self, at: Array) -> NDArray[np.bool_]:
        h, w = self.valid.shape
        u, v = np.rint(at.clip(-1, max(h, w))).astype(int).T
        inside = (u >= 0) & (u < w) & (v >= 0) & (v < h)
        return inside & self.valid[v.clip(0, h - 1), u.clip(0, w - 1)]

    def _align(
        self, pair: PreparedImages, tracks: Tracks, start: Array, warps: tuple[Array, Array], start_right_u: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Views (n, 4) against the anchored templates, their covariances, and which are good at least on the left."""
        cfg = self.config
        shape = pair.left.shape
        patches = self.atlas.warped(tracks.slots, warps[0])
        left, error_l, good = self._align_left(pair, patches, start)
        rows = self.rows.difference(left)
        start_r = np.stack([start_right_u + left[:, 0] - start[:, 0], left[:, 1] - rows], axis=1)
        slanted = np.asarray(tracks.slopes.any(axis=1))  # of the others left and right patch are the same
        in_right = patches.replaced(slanted, self.atlas.warped(tracks.slots[slanted], warps[1][slanted]))
        right, ok_r, error_r = in_right.align(pair.right_grey, start_r)
        right[:, 1] += rows
        seen = ok_r & (error_r < cfg.max_grey_error) & self._on_row(left, right)
        r = cfg.window_radius_px
        seen &= (right[:, 0] > r) & (right[:, 0] < shape[1] - 1 - r)
        z = np.concatenate([left, np.where(seen[:, None], right, np.nan)], axis=1)
        return z, self.noise.covariance(patches.gradients, error_l, error_r), good

    def _align_left(
        self, pair: PreparedImages, patches: Patches, start: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Positions (n, 2) in the left image, deviations of grey differences, and which are good."""
        cfg = self.config
        left, ok, error = patches.align(pair.left_grey, start)
        near = np.linalg.norm(left - start, axis=1) < cfg.max_realignment_px
        return left, error, ok & near & (error < cfg.max_grey_error) & self._inside(left)

    # -- new points -------------------------------------------------------------------------------------------

    def _renew(self, pair: PreparedImages, frame_index: int) -> tuple[Array, Array]:
        """New tracks where they are missing: corners, unique on their row, aligned in the right image."""
        cfg, p = self.config, self.projection
        none = np.empty((0, 4)), np.empty((0, 4, 4))
        wanted = cfg.max_tracks - len(self.tracks)
        enough = cfg.renew_share if _renews(frame_index) else _URGENT_SHARE
        if wanted < cfg.max_tracks * enough:
            return none
        corners, start, tolerance_px = self._matches(pair, wanted, frame_index)
        if not len(corners):
            return none
        free = np.setdiff1d(np.arange(2 * cfg.max_tracks), self.tracks.slots)[: len(corners)]
        self.atlas.store(pair.left_grey, corners, free)
        facing = np.broadcast_to(np.eye(2), (len(free), 2, 2))
        patches = self.atlas.warped(free, facing)
        right, ok, error = patches.align(pair.right_grey, start)
        ok &= np.linalg.norm(right - start, axis=1) < tolerance_px
        corners, free, gradients = corners[ok], free[ok], patches.gradients[ok]
        right, error, facing = right[ok], error[ok], facing[ok]
        left = corners.astype(float)
        slopes = disparity_slopes(pair.left_grey, pair.right_grey, corners, right, cfg.window_radius_px, 4.0)
        slanted = slopes.any(axis=1)
        warps = np.asarray(np.linalg.inv(facing - np.stack([slopes, np.zeros_like(slopes)], axis=1)))[slanted]
        patches = self.atlas.warped(free[slanted], warps)
        right[slanted], aligned, error[slanted] = patches.align(pair.right_grey, right[slanted])
        ok = error < cfg.max_grey_error
        ok[slanted] &= aligned
        inner, found, _ = self.atlas.inner(free).align(pair.right_grey, right)
        apart_px = np.linalg.norm(inner - right, axis=1)
        ok &= found & (apart_px < _HALF_PATCH_PX)
        self.rows.learn(left[ok], (left - right)[ok, 1])
        right[:, 1] += self.rows.difference(left)
        ok &= self._on_row(left, right)
        cov = self.noise.covariance(gradients, error, error)
        z = np.concatenate([left, right], axis=1)
        rho = p.inverse_depth(z)
        var_rho = (cov[:, 0, 0] + cov[:, 2, 2]) / (p.f_px * p.baseline_m) ** 2
        ok &= rho > -2 * np.sqrt(var_rho)
        n = int(ok.sum())
        rays = np.stack([(left[:, 0] - p.cx_left_px) / p.f_px, (left[:, 1] - p.cy_px) / p.f_px], axis=1)
        points = np.concatenate([rays, np.ones((len(rays), 1)), rho[:, None]], axis=1)
        new = Tracks(
            ids=self.next_id + np.arange(n, dtype=np.int64),
            slots=free[ok],
            left_px=left[ok],
            points=points[ok],
            var_rho=var_rho[ok],
            anchor_from_start=np.broadcast_to(self.cam_from_start, (n, 4, 4)),
            slopes=slopes[ok] / p.baseline_m,
        )
        self.next_id += n
        self.tracks = self.tracks.joined(new)
        self.shared_errors.learn(new.ids, apart_px[ok])
        return z[ok], cov[ok]

    def _matches(
        self, pair: PreparedImages, wanted: int, frame_index: int
    ) -> tuple[NDArray[np.intp], Array, float]:
        """New corners (k, 2) in whole pixels, where they are in the right image (k, 2), and how well that is known."""
        scale, corners = pair.scale, self._corners(pair, wanted)
        disparity, unique = search_rows(
            pair.coarse_left(), pair.coarse_right(), corners, self._disparity_range(scale, frame_index)
        )
        corners = corners[unique] * round(1 / scale)
        rows = self.rows.difference(corners.astype(float))
        start = np.stack([corners[:, 0] - disparity[unique] / scale, corners[:, 1] - rows], axis=1)
        return corners, start, min(2.0 / scale, 2 * self.config.max_row_difference_px)

    def _corners(self, pair: PreparedImages, wanted: int) -> NDArray[np.intp]:
        """Whole pixels (k, 2) of the coarse left image, away from the tracks."""
        cfg, step = self.config, round(1 / pair.scale)
        distance_px = cfg.min_corner_distance_px * pair.scale
        taken, allowed = self.tracks.left_px * pair.scale, self.valid[::step, ::step]
        return detect(pair.corner_strength, taken, allowed, wanted, distance_px, cfg.min_corner_response)

    def _disparity_range(self, scale: float, frame_index: int) -> tuple[int, int]:
        """First and last disparity to search, px of the scaled image: up to half as much again as any track has, and
        every few frames, or where little is tracked, all that the configuration allows."""
        p = self.projection
        far = p.cx_left_px - p.cx_right_px
        near = far + self.config.max_disparity_share * p.width
        if frame_index % _FULL_SEARCH and len(self.tracks) > self.config.max_tracks // 4:
            largest = p.f_px * p.baseline_m * float(self.tracks.points[:, 3].max())
            near = min(near, far + 1.5 * largest + _SEARCH_MARGIN_PX)
        return int(np.floor(far * scale)) - 1, int(np.ceil(near * scale))


def _renews(frame_index: int) -> bool:
    """Whether new points are added in this frame where few are missing; in the others only where most are."""
    return frame_index % _RENEWAL == 0


def _note(pair: PreparedImages, previous: PreparedImages | None, tracked: int, in_both: int) -> str:
    """What is wrong with the images: nothing can be matched in them, or they are the last ones again; else empty."""
    if in_both < _FEW:
        for name, image in (("left", pair.left), ("right", pair.right)):
            if image.max() < 8:
                return f"the {name} image is black"
            if image.min() > 247:
                return f"the {name} image is white"
    if previous is not None and pair.equals(previous):
        return "the images are those of the frame before, to the bit: are the cameras frozen?"
    if in_both >= _FEW:
        return ""
    if tracked < _FEW:
        return f"{tracked} points can be matched in the images: too little texture, or blurred"
    return (
        f"only {in_both} points are found in both images: is one camera covered, are left and right exchanged, or "
        "the images not of one moment?"
    )
