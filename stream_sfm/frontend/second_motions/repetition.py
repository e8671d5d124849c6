"""Checks whether the scene is repetitive, so that a second motion explains the images as well as the one from flow.

In front of a grid or a wall of tiles, each patch looks like others nearby. While the velocity is unknown, flow may have
followed every patch to a neighbour of its true place, all by the same step. The motion is then off by a tile per frame,
in perfect agreement with the images. This requires that everything in view is repetitive. A post in front of the grid
or the ground below it looks different where the wrong motion puts it, and decides between the two.
"""

from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from ...config.section import Section, expert
from ...geometry import Array, se3
from ...geometry.evidence import Evidence
from ...geometry.point_views import PointViews
from ...geometry.resection import MANY_VIEWS, MIN_VIEWS, SecondMotion, resect
from ...geometry.robust_rules import RobustRules
from ...geometry.view_stages import CorrectedViews
from ...pictures.prepared import Image
from ...record import changed
from ..rough_motion import RoughMotion, find_rough_motion
from ..rules import MotionRules
from ..state import FrontEndState
from ..step import Step
from ..tracks import Tracks


class RepetitionRules(Section, frozen=True, kw_only=True):
    """Whether the scene is repetitive, so that another motion explains the images equally well."""

    # Each costs most of a millisecond.
    samples: Annotated[int, expert("number of tracks that are examined for look-alikes", 1, 1000)] = 24
    # This is as for points of the coarse image.
    half_px: Annotated[int, expert("half width of the correlated patch, px of the half-size image", 2, 50)] = 6
    # This is as far as optical flow reaches.
    reach: Annotated[int, expert("search range of look-alikes is the width over this", 1, 100_000)] = 3
    # This is as along the row (`points.match_lead`): a patch with a smaller lead is a look-alike.
    lead: Annotated[float, expert("lead in correlation over a patch that is not a look-alike", 0, 1)] = 0.06
    # This is a whole pixel of the half-size image.
    std_px: Annotated[float, expert("σ of the position of a look-alike, px", 0.1, 100)] = 2.0
    # With fewer, a motion may be chance.
    share: Annotated[float, expert("share of the look-alikes, by weight, that must move as one", 0, 1)] = 0.5
    # Along a facade of equal windows, 8 or more of 96 look different at the other place; along a tiled wall hardly
    # any do.
    compared: Annotated[int, expert("tracks whose patches are compared at both places", 1, 2000)] = 96
    # The correlation of a patch with itself, a frame later, is higher.
    found: Annotated[float, expert("least correlation of a patch that is found again", 0, 1)] = 0.8
    # These are 5 σ, at a nat each. With 8, in two or three frames, 8 of 577 ok poses are wrong instead of 1 of 561.
    different: Annotated[
        float, expert("patches of all frames that exclude a motion if they look different", 1, 1e6)
    ] = 16.0
    # This is five times the lead.
    less: Annotated[float, expert("least drop of the correlation at a look-alike's place", 0, 2)] = 0.3


def smaller_of_alike(step: Step, state: FrontEndState, rough: RoughMotion) -> tuple[FrontEndState, RoughMotion]:
    """Return the motion with a second one for which the scene looks `alike`, if there is one, the smaller one first.

    It is sought while hardly any track has a history, and from then on as long as the scene is repetitive. Something
    unique ends that: it shows the velocity, so that flow no longer begins at a neighbour. What looks different counts
    over frames, and the state contains this evidence.
    """
    memory = state.ambiguity
    if memory.repeats:
        second = memory.second_beside(rough.cam_from_previous)
        unlike = _unlike(step, state, rough, second)
        repeats = not unlike.is_there and _repeats(step, _look_alikes(step, state.tracks, rough)[1])
        state = changed(state, ambiguity=changed(memory, unlike=unlike))
        return state, changed(rough, alike=second if repeats else None)
    known = np.count_nonzero(state.tracks.agreed) >= MANY_VIEWS
    second = None if known or memory.lasts else _second_motion(step, state.tracks, rough)
    if second is None:
        return state, rough
    unlike = _unlike(step, state, rough, second)
    if unlike.is_there:
        return state, rough
    return changed(state, ambiguity=changed(memory, unlike=unlike)), _smaller_first(step, state, rough, second)


def _smaller_first(step: Step, state: FrontEndState, rough: RoughMotion, second: SecondMotion) -> RoughMotion:
    """Return the smaller one of two motions, and the other one as `alike`."""
    size, second_size = (
        np.linalg.norm(se3.log(m) / step.setup.std_acceleration) for m in (rough.cam_from_previous, second.cam_from_ref)
    )
    if size > second_size:
        near = changed(step, predicted=second.cam_from_ref, is_predicted=True)
        smaller = find_rough_motion(near, state.aligners, state.tracks)
        if smaller is not None:
            return changed(smaller, alike=changed(second, cam_from_ref=rough.cam_from_previous))
    return changed(rough, alike=second)


def _second_motion(step: Step, tracks: Tracks, rough: RoughMotion) -> SecondMotion | None:
    """Return the second motion that the nearest look-alikes share, if nearly every track has one."""
    rows, alike_px = _look_alikes(step, tracks, rough)
    if not _repeats(step, alike_px):
        return None
    projection, rules = step.setup.projection, step.setup.rules.of(RepetitionRules)
    seen = np.isfinite(alike_px[:, 0])
    alike = tracks.keep(rows[seen])
    points = alike.points, alike.cov_points(projection)
    cov_px = np.broadcast_to(rules.std_px**2 * np.eye(4), (len(alike), 4, 4))
    views = PointViews(projection, *points, CorrectedViews(alike_px[seen]), cov_px, step.setup.rules.of(RobustRules))
    motion = resect(views, np.eye(4), find_second=False)
    if not motion.ok or motion.share < rules.share:
        return None
    return SecondMotion(motion.cam_from_ref, motion.cov_pose, views=np.zeros(len(tracks), bool), odds=1.0)


def _unlike(step: Step, state: FrontEndState, rough: RoughMotion, second: SecondMotion | None) -> Evidence:
    """Return the evidence so far that the scene looks different under a second motion, a nat for each patch that does.

    Patches share an object, so that each says less than it could.
    """
    rules = step.setup.rules
    known = state.ambiguity.unlike
    if known is None:
        known = Evidence(rules.of(RepetitionRules).different, rules.of(MotionRules).unsteady_frames)
    return known if second is None else known.after(_different(step, state.tracks, rough, second.cam_from_ref))


def _different(step: Step, tracks: Tracks, rough: RoughMotion, second_from_previous: Array) -> int:
    """Return how many patches that flow has found look different where a second motion puts them."""
    rules, before, now = step.setup.rules.of(RepetitionRules), step.previous.left_half, step.images.left_half
    rows = np.flatnonzero(rough.agree & (tracks.scale == 1))
    rows = rows[:: max(1, len(rows) // rules.compared)]
    other_px = step.setup.projection.project_homogeneous(tracks.points[rows] @ second_from_previous.T)[:, :2]
    apart = np.linalg.norm(other_px - rough.left_px[rows], axis=1) > 4 * rules.half_px  # by more than a patch
    different = 0
    for row, at_px in zip(rows[apart], other_px[apart], strict=True):
        patch = _window(before, tracks.left_px[row], rules.half_px)
        found = _likeness(patch, _window(now, rough.left_px[row], rules.half_px + 1))
        elsewhere = _likeness(patch, _window(now, at_px, 2 * rules.half_px))
        different += bool(found > rules.found and elsewhere < found - rules.less)
    return different


def _window(half: Image, at_px: Array, reach: int) -> Image | None:
    """Return the part of a half-size image around a position of the whole one, None if it is not all inside."""
    if not np.isfinite(at_px).all():
        return None
    u, v = np.rint(at_px / 2).astype(int)
    inside = reach <= u < half.shape[1] - reach and reach <= v < half.shape[0] - reach
    return half[v - reach : v + reach + 1, u - reach : u + reach + 1] if inside else None


def _likeness(patch: Image | None, window: Image | None) -> float:
    """Return the largest correlation of a patch in a window; NaN if one of them is not in its image."""
    if patch is None or window is None:
        return np.nan
    return float(cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED).max())


def _repeats(step: Step, alike_px: Array) -> bool:
    """Whether hardly any track lacks a look-alike (n, 4)."""
    unique = np.isnan(alike_px[:, 0])
    return bool(unique.sum() < step.setup.rules.of(RobustRules).second_views and (~unique).sum() >= MIN_VIEWS)


def _look_alikes(step: Step, tracks: Tracks, rough: RoughMotion) -> tuple[NDArray[np.intp], Array]:
    """Return a sample of agreeing tracks (k,) and their look-alikes as views (k, 4), nearest to the previous positions.

    Views are NaN for tracks without one, and for all further tracks once enough have none.
    """
    rules, before, now = step.setup.rules.of(RepetitionRules), step.previous.left_half, step.images.left_half
    rows = np.flatnonzero(rough.agree & (tracks.scale == 1))
    rows = rows[:: max(1, len(rows) // rules.samples)]
    alike_px = np.full((len(rows), 4), np.nan)
    for k, row in enumerate(rows):
        alike_px[k, :2] = _look_alike(rules, before, now, tracks.left_px[row], rough.left_px[row])
        if np.isnan(alike_px[: k + 1, 0]).sum() >= step.setup.rules.of(RobustRules).second_views:
            break  # further ones change nothing, and each costs nearly a millisecond
    return rows, alike_px


def _look_alike(rules: RepetitionRules, before: Image, now: Image, before_px: Array, at_px: Array) -> Array:
    """Return the other place (2,) in the new image where the patch may be, the nearest to its old one; NaN if none.

    Images have half the size; positions before and now are in pixels of the whole ones.
    """
    none, half = np.full(2, np.nan), rules.half_px
    from_px, to_px = np.rint(before_px / 2).astype(int), np.rint(at_px / 2).astype(int)
    reach = now.shape[1] // rules.reach + half
    first = np.maximum(to_px - reach, 0)
    window = now[first[1] : to_px[1] + reach, first[0] : to_px[0] + reach]
    inside = (from_px >= half).all() and (from_px + half < before.shape[::-1]).all()
    if not inside or min(window.shape) < 2 * half + 3:
        return none
    columns, rows = (slice(k - half, k + half + 1) for k in from_px)
    patch = before[rows, columns]
    alike = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
    u, v = to_px - first - half  # the position by flow
    near = tuple(slice(max(k - half // 2, 0), k + half // 2 + 1) for k in (v, u))  # no look-alikes
    if not alike[near].size:
        return none
    found = alike[near].max()
    peaks = (alike > found - rules.lead) & (alike == cv2.dilate(alike, np.ones((3, 3), np.uint8)))
    peaks[near] = False
    at = np.argwhere(peaks)[:, ::-1]
    if not len(at):
        return none
    places_px = 2.0 * (at + first + half)
    return np.asarray(places_px[np.argmin(np.linalg.norm(places_px - before_px, axis=1))])
