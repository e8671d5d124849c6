"""The start of a map with one camera: points are followed from an opening frame until their depths are observable."""

import numpy as np

from ...geometry import Array, se3
from ...geometry.view_stages import RawViews
from ...pictures.prepared import PreparedImages
from ...pictures.rules import FlowRules
from ...record import changed
from ..advance import Followed
from ..aligned_views import align
from ..flow import as_exposed, track
from ..rough_motion import RoughMotion
from ..state import FrontEndState, Setup
from ..tracks import Tracks
from .two_view import MonoRules, TwoView, two_view_motion


def open_map(state: FrontEndState, why: str) -> FrontEndState:
    """Return the state with this frame as the opening one; `why`: what the map waits for."""
    return changed(
        state, tracks=Tracks.none(), cam_from_start=np.eye(4), map=changed(state.map, mapped=False, waiting=why)
    )


def begin_map(setup: Setup, state: FrontEndState, images: PreparedImages) -> tuple[FrontEndState, Followed | None]:
    """Return the motion since the opening frame, not since the previous one, as soon as depths are observable.

    Its length is the unit of the first map. After a loss, the best guess is that the scene is as far away as before.
    """
    state = changed(state, map=changed(state.map, first_unseen_id=state.next_id))
    if not len(state.tracks):
        return open_map(state, "depths need a second view"), None
    rules = setup.rules.of(MonoRules)
    state, cov_px = _follow_directions(setup, state, images)
    n, n_opened = len(state.tracks), state.map.n_opened
    if n < max(rules.min_tracks, rules.min_followed * n_opened):
        return open_map(state, f"{n} of {n_opened} points could be followed since the opening frame"), None
    std_px = float(np.sqrt(np.median(np.trace(cov_px[:, :2, :2], axis1=1, axis2=2)) / 2))
    std_ray = std_px / setup.projection.f_px
    found = two_view_motion(state.tracks.anchor_rays, state.tracks.points[:, :2], std_ray, rules)
    waiting = found.problem if found else "no rigid motion explains the points"
    state = changed(state, map=changed(state.map, waiting=waiting))
    if found is None:
        return state, None
    if waiting:  # the direction of motion may be meaningless yet, but the rotation turns the templates
        rotation = found.now_from_first[:3, :3]
        return changed(state, cam_from_start=se3.from_rotation_translation(rotation, np.zeros(3))), None
    return _begin(state, found, cov_px)


def _follow_directions(setup: Setup, state: FrontEndState, images: PreparedImages) -> tuple[FrontEndState, Array]:
    """Follow the tracks as points at infinity, and return the covariances (n, 4, 4) of those that survive."""
    tracks, p, aligner = state.tracks, setup.projection, state.aligners[1]
    if state.previous is None:
        return state, np.empty((0, 4, 4))
    expected_px = p.project_homogeneous(tracks.points)[:, :2]
    before_half = as_exposed(state.previous, images, setup.rules.of(FlowRules))
    levels = setup.config.frontend.pyramid_levels
    at_px, found = track(aligner, setup.rules.of(FlowRules), before_half, images, tracks.left_px, expected_px, levels)
    state = changed(state, tracks=tracks.keep(found))
    n = len(state.tracks)
    by_flow = RoughMotion(np.eye(4), at_px[found], np.ones(n, bool), share=1.0)
    views = align(setup, state, images, by_flow, np.zeros(6))
    tracks, left_px, cov_px = state.tracks.keep(views.rows), views.z_px[:, :2], views.cov_px
    tracks = tracks.placed(p.rays(left_px), left_px, cov_px[:, :2, :2], tracks.points[:, 3], tracks.var_rho)
    return changed(state, tracks=changed(tracks, exposures=views.exposures, contrast=views.contrast)), cov_px


def _begin(state: FrontEndState, found: TwoView, cov_px: Array) -> tuple[FrontEndState, Followed]:
    """Set the depths of the points that agree with the motion, in the unit of the map."""
    tracks, rho, var_rho = state.tracks.keep(found.agree), found.rho[found.agree], found.var_rho[found.agree]
    rho_scene = state.map.rho_scene or float(np.median(rho))
    unit = float(np.median(rho)) / rho_scene
    cam_from_start = found.now_from_first.copy()
    cam_from_start[:3, 3] *= unit
    points = np.concatenate([tracks.anchor_rays, np.ones((len(rho), 1)), rho[:, None] / unit], axis=1)
    state = changed(
        state,
        tracks=changed(tracks, points=points, var_rho=var_rho / unit**2).moved(cam_from_start),
        cam_from_start=cam_from_start,
        velocity=np.zeros(6),
        map=changed(state.map, mapped=True, rho_scene=rho_scene, cov_start=found.cov_first_from_now),
    )
    z_px = np.concatenate([tracks.left_px, np.full((len(rho), 2), np.nan)], axis=1)
    return state, Followed(cam_from_start, RawViews(z_px), cov_px[found.agree], np.zeros(len(z_px)))
