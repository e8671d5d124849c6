"""Chooses between two motions at the start of a map: the background is the set of points behind the other.

While no track has a history, most tracks may lie on the robot's own arm, on a bonnet or on a body that fills the view.
It stands still in the image, so flow finds it at once, and only it. The motion of the other tracks is then sought as
well. Along the border of the two sets, the one behind is the background.
"""

import numpy as np
from numpy.typing import NDArray

from ..config.rules import Rules, StartRules
from ..geometry.medians import median
from ..geometry.resection import MANY_VIEWS, MIN_VIEWS, Resection, SecondMotion, refine, resect
from ..record import changed
from .rough_motion import RoughMotion, find_rough_motion
from .seen import Seen
from .state import FrontEndState, Setup
from .step import Step
from .tracks import Tracks


def of_background(step: Step, state: FrontEndState, rough: RoughMotion) -> RoughMotion:
    """Return the rough motion, or that of the tracks that do not agree with it if these lie behind the others."""
    rules, tracks, rest = step.setup.rules, state.tracks, np.flatnonzero(~rough.agree)
    if state.start.is_over or len(rest) < max(MANY_VIEWS, rules.start.unexplained * len(tracks)):
        return rough
    other = find_rough_motion(changed(step, is_predicted=False), state.aligners, tracks.keep(rest))
    if other is None:
        return rough
    left_px = step.setup.projection.project_homogeneous(tracks.points @ other.cam_from_previous.T)[:, :2]
    # far points fit both motions, within six σ of a position by flow
    apart_px = np.linalg.norm(left_px - rough.left_px, axis=1)
    others = tracks.keep(rough.agree & (apart_px > 6 * rules.flow.std_px * tracks.scale))
    if not is_behind(step.setup, tracks.keep(rest[other.agree]), others):
        return rough
    left_px[rest[other.agree]] = other.left_px[other.agree]
    agree = np.zeros(len(tracks), bool)
    agree[rest[other.agree]] = True
    return RoughMotion(other.cam_from_previous, left_px, agree, other.share)


def decided(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> Resection:
    """Return the one of two motions whose points lie behind the other's, if the depth order is clear.

    Once the start is over, tracks have a history. The depth order then shows only that points in front of those of the
    motion followed are on a body. It does not show that points behind them are the scene.
    """
    second, at_start = motion.second, not state.start.is_over
    asked = motion.ambiguous is not None or at_start or state.ambiguity.frames_left > 0
    if not motion.ok or second is None or not asked:
        return motion
    tracks, views = seen.before, seen.point_views
    other = refine(views, seen.weights, second.cam_from_ref, motion.amplitudes)
    only_second = tracks.keep(second.views)
    only_first = tracks.keep(motion.accepted & (other.squared_residuals > views.clear_gate))
    if at_start and motion.ambiguous and other.ok and is_behind(step.setup, only_second, only_first):
        return other
    if is_behind(step.setup, only_first, only_second):
        return changed(motion, second=changed(second, odds=0.0, in_front=True))
    return motion


def uncovered(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> Resection:
    """Return the motion, ambiguous if the points of one motion lie behind all of the other's, however few they are.

    Points that come into view in front of a scene are on a body. Points that come into view behind everything followed
    so far may be the scene, and what was followed may be a body that has hidden it. (Until a start is over, its check
    reports this.)
    """
    second, tracks, setup = motion.second, seen.before, step.setup
    if not motion.ok or second is None or not state.start.is_over:
        return motion
    only_second, followed = tracks.keep(second.views), tracks.keep(motion.accepted)
    if _is_deeper(setup, only_second, followed):
        # the motion of these views alone: the one found may be a compromise with near points
        alone = resect(seen.point_views.select(second.views), second.cam_from_ref, find_second=False)
        known = alone if alone.ok else second
        second = SecondMotion(known.cam_from_ref, known.cov_pose, second.views, 1.0, _history(followed))
        return changed(motion, second=second)
    lasted = _history(only_second)
    if lasted < setup.rules.motion.full_history or not _is_deeper(setup, followed, only_second):
        return motion
    return changed(motion, second=changed(second, odds=max(second.odds, 1.0), lasted=lasted))


def _is_deeper(setup: Setup, some: Tracks, others: Tracks) -> bool:
    """Whether some points lie behind their neighbours among the others, and hardly any of the others is as far away."""
    if len(some) < MIN_VIEWS:
        return False
    as_far = np.count_nonzero(others.points[:, 3] < setup.rules.start.deeper * median(some.points[:, 3]))
    return bool(as_far < MANY_VIEWS) and is_behind(setup, some, others)


def _history(tracks: Tracks) -> int:
    """Return for how many frames enough tracks for a motion have agreed."""
    return int(np.sort(tracks.agreed)[-MIN_VIEWS]) if len(tracks) >= MIN_VIEWS else 0


def may_be_scene(rules: Rules, tracks: Tracks, accepted: NDArray[np.bool_], fills_view: bool) -> NDArray[np.bool_]:
    """Return which tracks (n) that a motion does not explain may belong to a scene hidden by those `accepted` (n,).

    A track in front of its accepted neighbours may be on a moving body and does not count. None counts if the accepted
    tracks have covered the view from the start (`fills_view`) and nearly all of them are as far away: then they hide
    nothing, and the others came into view later.
    """
    rest, followed = ~accepted, tracks.keep(accepted)
    if fills_view and rest.any():
        as_far = followed.points[:, 3] < rules.start.deeper * median(tracks.points[rest, 3])
        if np.count_nonzero(as_far) >= rules.motion.calm_start * len(followed):
            return np.zeros(len(tracks), bool)
    return rest & (depth_order(tracks, followed, rules.start) >= 0)


def is_behind(setup: Setup, some: Tracks, others: Tracks, fewest: int | None = None) -> bool:
    """Whether some points lie behind the others: where depths differ, most of the others are nearer than neighbours.

    At least `fewest` of them must be. Each of the others is compared with its own neighbour, because the scene
    surrounds a body. (The floor in front of a camera is nearer than a body as well, but far from it in the image.)
    """
    rules, order = setup.rules.start, depth_order(others, some, setup.rules.start)
    before, behind = ((order == k).sum() for k in (-1, 1))
    fewest = setup.rules.robust.second_views if fewest is None else fewest
    return bool(before >= fewest and before > rules.behind * (before + behind))


def depth_order(some: Tracks, others: Tracks, rules: StartRules) -> NDArray[np.int64]:
    """Return whether points (n,) lie behind (1) or in front of (−1) their nearest neighbours among the others, or 0."""
    if not len(others):
        return np.zeros(len(some), np.int64)
    nearest = np.argmin(((some.left_px[:, None] - others.left_px) ** 2).sum(axis=2), axis=1)
    ratio = others.points[nearest, 3] / np.maximum(some.points[:, 3], 1e-9)
    return (ratio > rules.deeper).astype(np.int64) - (ratio < 1 / rules.deeper)
