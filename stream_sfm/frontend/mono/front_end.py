"""The front-end of one camera: what takes the place of the right image.

A map begins when the motion since an opening frame shows depths (`map_start.py`); from then on they are learnt from
parallax (`parallax.py`) and handed to the estimator as virtual right sides (`virtual_views.py`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...config import Config, RigConfig
from ...geometry import se3
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ...rig_model.estimate import RigEstimate
from ...types import MapStart, Observations
from ..alignment import TemplateAligners
from ..image_checks import image_note
from ..prepared import Image, PreparedImages
from ..timing import Timing
from ..tracker import Followed, Tracker
from .map_start import MIN_TRACKS, MapStartFinder
from .parallax import ParallaxDepth
from .virtual_views import DEPTH_STD_FACTOR, UNKNOWN_DEPTH_STD, with_virtual_right

_KNOWN = 3.0  # inverse depth over its σ from which a depth counts as known, as in the estimator
_MIN_IN_FRONT = 0.5  # fraction of the tracks that a motion must leave in front of the camera; it is wrong otherwise
_LOST = "the motion was lost; a new map needs parallax"


class MonoFrontEnd:
    """Follows points through the rectified images of one camera; `projection` has a virtual right one."""

    def __init__(self, projection: StereoProjection, config: Config, valid: NDArray[np.bool_]) -> None:
        import scipy.optimize  # noqa: F401 - what starts the map: here, so that its BLAS is found before the first frame

        self.projection = projection
        self.config = config.frontend
        aligners = TemplateAligners(self.config, valid, scales=(1,))
        self.aligner = aligners.fine
        depth = ParallaxDepth(projection, self.aligner)
        timing = Timing.unknown(projection, RigConfig(exact=True), None)  # one camera has no right one that is late
        self.tracker = Tracker(projection, config, aligners, depth, timing)
        self.map_start = MapStartFinder(self.tracker, self.aligner)
        self.mapped = False
        self.first_unseen_id = 0  # ids from here on have not been handed out

    def prepare(self, left: Image, right: Image | None = None, frame_index: int | None = None) -> PreparedImages:
        """As `StereoFrontEnd.prepare`, of the left image; corners are rarely wanted, and computed in `step`."""
        return PreparedImages.of(left, left, self.config.smoothing_px)

    def step(self, frame_index: int, stamp_ns: int, images: PreparedImages) -> Observations:
        """Observations of the next frame as `StereoFrontEnd.step`; none while depths are not observable."""
        tracker = self.tracker
        followed = self._follow(images, stamp_ns) if self.mapped else self._begin_map(images)
        self.mapped = followed is not None
        observed = Observations(
            frame_index=frame_index,
            stamp_ns=stamp_ns,
            track_ids=np.empty(0, np.int64),
            z_px=np.empty((0, 4)),
            cov_px=np.empty((0, 4, 4)),
            std_drift_px=np.zeros(0),
        )
        if followed is not None:
            observed = self._with_right_sides(observed, followed)
        self._add_points(images)
        n = len(tracker.tracks)
        note = image_note(images, tracker.previous, n, n)
        tracker.remember(images, stamp_ns)
        return replace(observed, note=note or ("" if self.mapped else self.map_start.waiting))

    def learn(self, estimate: RigEstimate) -> None:
        """As `StereoFrontEnd.learn`; one camera has no rig that could err."""

    def std_bias_px(self, ids: NDArray[np.int64]) -> Array:
        """As `StereoFrontEnd.std_bias_px`: zero, because there is no other patch."""
        return np.zeros(len(ids))

    def rig_in_px(self, estimate: RigEstimate | None) -> RigEstimate | None:
        """As `StereoFrontEnd.rig_in_px`: None, because a single camera has no rig."""
        return None

    def _begin_map(self, images: PreparedImages) -> Followed | None:
        """Views of the frame in which a map begins; None before."""
        self.first_unseen_id = self.tracker.next_id
        return self.map_start.find(images)

    def _follow(self, images: PreparedImages, stamp_ns: int) -> Followed | None:
        """Follow the map's points, without those that the motion puts behind the camera."""
        followed = self.tracker.follow(images, stamp_ns)
        if followed is None:
            self.tracker.lose()
            self.map_start.open(_LOST)
            return None
        tracks = self.tracker.tracks
        front = tracks.points[:, 3] > -_KNOWN * np.sqrt(tracks.var_rho)
        if front.mean() < _MIN_IN_FRONT:
            self.map_start.open(_LOST)
            return None
        self.tracker.tracks = tracks.keep(front)
        return followed.keep(front)

    def _with_right_sides(self, observed: Observations, followed: Followed) -> Observations:
        """The views, with virtual right sides where a track is handed out for the first time; and, where a map could
        begin, all of them with right sides."""
        p, tracks, start = self.projection, self.tracker.tracks, self.map_start
        rho = tracks.points[:, 3]
        known = rho > _KNOWN * np.sqrt(tracks.var_rho)
        if known.sum() >= MIN_TRACKS:
            start.rho_scene = float(np.median(rho[known]))
        var_known = DEPTH_STD_FACTOR**2 * tracks.var_rho
        var_new = var_known + (UNKNOWN_DEPTH_STD * start.rho_scene) ** 2
        z_new, cov_new = with_virtual_right(p, followed.z_px, followed.cov_px, rho, var_new)
        new = tracks.ids >= self.first_unseen_id
        self.first_unseen_id = self.tracker.next_id
        z_all, cov_all = with_virtual_right(p, followed.z_px, followed.cov_px, rho, var_known)
        return replace(
            observed,
            track_ids=tracks.ids,
            z_px=np.where(new[:, None], z_new, followed.z_px),
            cov_px=np.where(new[:, None, None], cov_new, followed.cov_px),
            cam_from_previous=followed.cam_from_previous,
            n_new=int(new.sum()),
            std_drift_px=self.aligner.noise.drift(tracks.points, followed.cam_from_previous),
            start=MapStart(z_all, cov_all, se3.inverse(self.tracker.cam_from_start), start.cov_start),
        )

    def _add_points(self, images: PreparedImages) -> None:
        """Begin tracks where they are missing, at the depth of the scene; before a map in the opening frame only."""
        tracker, cfg = self.tracker, self.config
        opened = len(tracker.tracks) > 0 and not self.mapped
        if opened or tracker.missing < cfg.max_tracks * cfg.renew_fraction:
            return
        corners_px = tracker.detect_corners(images) * round(1 / images.scale)
        n = len(corners_px)
        if not n:
            return
        slots = self.aligner.cut(images, corners_px, tracker.tracks.slots)
        rho = np.full(n, self.map_start.rho_scene if self.mapped else 0.0)
        tracker.add(
            slots,
            corners_px.astype(float),
            self.aligner.noise.typical_cov(n),
            rho,
            (UNKNOWN_DEPTH_STD * rho) ** 2,
            np.zeros((n, 2)),
            np.zeros((n, 2)),
        )
        if not self.mapped:
            self.map_start.n_opened = n
