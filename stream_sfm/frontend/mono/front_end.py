"""The front-end of one camera, with virtual right sides in place of the right image.

A map begins when depths are observable from the motion since an opening frame (`map_start.py`). From then on depths are
learnt from parallax (`parallax.py`) and passed to the estimator as virtual right sides, the views of a right camera
that does not exist. Estimators first get a point in its second view, whose right side holds its depth and variance.
Later views have no right side.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...config import Config, RigConfig
from ...geometry import Array, se3
from ...geometry.robust_rules import RobustRules
from ...geometry.stereo import KNOWN_DEPTH_SIGMAS, StereoProjection
from ...pictures.content import image_note
from ...pictures.prepared import PreparedImages
from ...pictures.rules import ImageRules
from ...pictures.torn import copied, torn
from ...rig_model.estimate import RigEstimate
from ...types import ExpectedMotion, LastingErrors, MapStart, Observations
from ..advance import Followed
from ..alignment import TemplateAligner
from ..learnt.rows import Rows
from ..learnt.template_errors import TemplateErrors, turn_of_slides
from ..learnt.timing import Timing
from ..new_points import begin_tracks, detect_missing
from ..rules import ErrorRules, MotionRules
from ..second_motions.ambiguity import AmbiguityMemory
from ..second_motions.start_check import StartCheck
from ..state import FrontEndState, Setup
from ..tracker import follow
from .map_start import begin_map, open_map
from .two_view import MonoRules

_LOST = "the motion was lost; a new map needs parallax"


class MonoFrontEnd:
    """Follows points through the rectified images of one camera; the object never changes (see `StereoFrontEnd`).

    `projection` has a virtual right camera.
    """

    def __init__(self, projection: StereoProjection, config: Config, valid: NDArray[np.bool_]) -> None:
        import scipy.optimize  # noqa: F401 - for the start of the map; here, so that its BLAS loads before any frame

        self.setup, rules = Setup(projection, config), config.rules
        self.start = FrontEndState(
            aligners={1: TemplateAligner.empty(config, valid)},
            timing=Timing.unknown(projection, RigConfig(exact=True), None),  # one camera has no delay
            rows=Rows.unknown(projection, config),
            turn_watch=None,
            errors=replace(TemplateErrors.begun_by(rules.of(ErrorRules)), least_px=0.0),  # there is no other patch
            ambiguity=AmbiguityMemory.none(rules.of(MotionRules)),
            start=StartCheck.of(rules.of(MotionRules)),
        )

    def prepare(self, images: PreparedImages, frame_index: int) -> None:
        """Do nothing, unlike `StereoFrontEnd.prepare`: corners are rarely needed, and `step` computes them."""

    def step(
        self,
        state: FrontEndState,
        images: PreparedImages,
        stamp_ns: int,
        expected: ExpectedMotion | None = None,
    ) -> tuple[FrontEndState, Observations]:
        """Do the same as `StereoFrontEnd.step`, without views before depths are observable; `expected` is not used."""
        if state.map.mapped:
            state, followed = self._follow(state, images, stamp_ns)
        else:
            state, followed = begin_map(self.setup, state, images)
        none = np.empty(0, np.int64), np.empty((0, 4)), np.empty((0, 4, 4))
        observed = Observations(state.frame_index, stamp_ns, *none)
        if followed is not None:
            state, observed = self._with_right_sides(state, observed, followed)
        state = self._add_points(state, images)
        n = len(state.tracks)
        enough, rules = self.setup.rules.of(RobustRules).min_inliers, self.setup.rules.of(ImageRules)
        rows = copied(images, state.previous, rules.slope_grey)
        note = torn(rows, state.copied) or image_note(images, state.previous, n, n, enough, rules)
        note = note or ("" if state.map.mapped else state.map.waiting)
        state = replace(state, frame_index=state.frame_index + 1, stamp_ns=stamp_ns, copied=rows)
        return state.followed_from(images, stamp_ns), replace(observed, note=note)

    def learn(self, state: FrontEndState, estimate: RigEstimate) -> FrontEndState:
        """Return the state unchanged: one camera has no rig errors to learn."""
        return state

    def rig_in_px(self, turn_rad: Array, estimate: RigEstimate | None) -> RigEstimate | None:
        """Return None, because a single camera has no rig."""
        return None

    def _follow(
        self, state: FrontEndState, images: PreparedImages, stamp_ns: int
    ) -> tuple[FrontEndState, Followed | None]:
        """Follow the map's points, and drop those that the motion puts behind the camera."""
        state, followed = follow(self.setup, state, images, stamp_ns)
        if followed is None:
            return open_map(state.lost(), _LOST), None
        tracks = state.tracks
        front = tracks.points[:, 3] > -KNOWN_DEPTH_SIGMAS * np.sqrt(tracks.var_rho)
        if front.mean() < self.setup.rules.of(MonoRules).min_in_front:
            return open_map(state, _LOST), None
        return replace(state, tracks=tracks.keep(front)), followed.keep(front)

    def _with_right_sides(
        self, state: FrontEndState, observed: Observations, followed: Followed
    ) -> tuple[FrontEndState, Observations]:
        """Return the views, with virtual right sides for tracks that are handed out for the first time.

        In case a map begins, all of them with right sides are in `start`.
        """
        rules = self.setup.rules.of(MonoRules)
        p, tracks, rho_scene = self.setup.projection, state.tracks, state.map.rho_scene
        rho = tracks.points[:, 3]
        known = rho > KNOWN_DEPTH_SIGMAS * np.sqrt(tracks.var_rho)
        if known.sum() >= rules.min_tracks:
            rho_scene = float(np.median(rho[known]))
        var_known = rules.depth_std_factor**2 * tracks.var_rho
        var_new = var_known + (rules.unknown_depth * rho_scene) ** 2
        z_new, cov_new = with_virtual_right(p, followed.z_px, followed.cov_px, rho, var_new)
        new = tracks.ids >= state.map.first_unseen_id
        state = replace(state, map=replace(state.map, rho_scene=rho_scene, first_unseen_id=state.next_id))
        drift_px = tracks.drift_px(followed.cam_from_previous, self.setup.slide_px, followed.blurred_px)
        std_turn_rad = turn_of_slides(drift_px, p.f_px, self.setup.rules.of(ErrorRules).alike)
        z_all, cov_all = with_virtual_right(p, followed.z_px, followed.cov_px, rho, var_known)
        return state, replace(
            observed,
            track_ids=tracks.ids,
            z_px=np.where(new[:, None], z_new, followed.z_px),
            cov_px=np.where(new[:, None, None], cov_new, followed.cov_px),
            cam_from_previous=followed.cam_from_previous,
            n_new=int(new.sum()),
            lasting=LastingErrors(drift_px, std_turn_rad=std_turn_rad),
            start=MapStart(z_all, cov_all, se3.inverse(state.cam_from_start), state.map.cov_start),
        )

    def _add_points(self, state: FrontEndState, images: PreparedImages) -> FrontEndState:
        """Begin tracks where they are missing, at the depth of the scene; before a map, only in the opening frame."""
        cfg, mapped = self.setup.config.frontend, state.map.mapped
        opened = len(state.tracks) > 0 and not mapped
        if opened or state.tracks.missing(cfg.max_tracks) < cfg.max_tracks * cfg.renew_fraction:
            return state
        corners_px = detect_missing(self.setup, state, images) * round(1 / images.scale)
        n = len(corners_px)
        if not n:
            return state
        aligner, slots = state.aligners[1].cut(images, corners_px, state.tracks.slots)
        rho, left_px = np.full(n, state.map.rho_scene if mapped else 0.0), corners_px.astype(float)
        points = np.column_stack([self.setup.projection.rays(left_px), np.ones(n), rho])
        cov_px, var_rho = aligner.noise.typical_cov(n), (self.setup.rules.of(MonoRules).unknown_depth * rho) ** 2
        state = replace(state, aligners={1: aligner}, map=state.map if mapped else replace(state.map, n_opened=n))
        return begin_tracks(state, slots, left_px, cov_px, points, var_rho, np.zeros((n, 2)))


def with_virtual_right(
    p: StereoProjection, z_px: Array, cov_px: Array, rho: Array, var_rho: Array
) -> tuple[Array, Array]:
    """Return views (n, 4), cov (n, 4, 4), with right sides from inverse depths (n,) and their variances, eq. (66)."""
    cov = cov_px.copy()
    cov[:, 2:] = cov[:, :, 2:] = 0
    cov[:, 2, 2] = (p.f_px * p.baseline_m) ** 2 * var_rho
    cov[:, 3, 3] = 1e4**2  # a row with a σ of 10 000 px is no information
    u_right = z_px[:, 0] - p.f_px * p.baseline_m * rho
    return np.stack([z_px[:, 0], z_px[:, 1], u_right, z_px[:, 1]], axis=1), cov
