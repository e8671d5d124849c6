"""Decides whose motion it is: that of the scene, or that of a body or a picture in front of it.

Sets of tracks may move differently. `choose` seeks the motions that may be the scene's, and weighs the first against
the second by log-odds: votes with history, the order of depths, which of them is new, and inertial samples. The result
is one motion, two, or none if a body hides the scene.
"""

import numpy as np
from numpy.typing import NDArray

from ...config.rules import Rules
from ...geometry import Array, se3
from ...geometry.evidence import Evidence
from ...geometry.medians import median
from ...geometry.resection import (
    MANY_VIEWS,
    MIN_VIEWS,
    Resection,
    SecondMotion,
    combined,
    judged,
    refine,
    resect,
    residuals_of,
)
from ...record import changed
from ..rules import MotionRules
from ..seen import Seen
from ..state import FrontEndState
from ..step import Step
from ..tracks import Tracks
from .confirmation import Confirmation
from .depth_order import StartRules, depth_order, is_behind, is_deeper
from .start_check import StartCheck


def choose(step: Step, state: FrontEndState, seen: Seen, found: Resection) -> tuple[Resection, StartCheck]:
    """Return the motion that is probably the scene's, with the other one as its second one, and the start's check."""
    motion, start = _expected(step, state, seen, _as_one(step, seen, found)), state.start
    if motion.ok and not start.is_over and not start.followed_body:
        motion, start = _without_body(step, start, seen, motion)
    second = motion.second
    if not motion.ok or second is None or second.in_front:
        return motion, start
    motion = _decided(step, state, seen, motion, second)
    return motion, _of_body(step, start, seen) if _was_followed(seen, motion) else start


def _was_followed(seen: Seen, motion: Resection) -> bool:
    """Whether the second motion is that of a body in front, and most tracks that agreed before have it."""
    old, second = seen.before.agreed > 0, motion.second
    if second is None or not second.in_front:
        return False
    of_body = np.count_nonzero(second.views & old)
    return bool(of_body >= MANY_VIEWS and of_body > np.count_nonzero(motion.accepted & old))


def _as_one(step: Step, seen: Seen, motion: Resection) -> Resection:
    """Return one motion in place of two, if these do not differ, or if it explains the views of both.

    Few views, or views of one place, determine a motion poorly. The search may stop at a motion that the others alone
    have, and then these few seem to be a set of their own.
    """
    second, views, rules = motion.second, seen.point_views, step.setup.rules
    if second is None or not motion.ok:
        return motion
    if _distance2(motion, second) < views.settings.halves_apart:
        return changed(motion, second=None)  # the camera has moved alike by both
    start = combined(motion, second.cam_from_ref, second.cov_pose).cam_from_ref
    one = refine(views, seen.weights, start, motion.amplitudes)
    alone = refine(views, seen.weights, second.cam_from_ref, motion.amplitudes)
    both = motion.accepted | second.views
    if not one.ok or np.count_nonzero(one.accepted & both) < rules.of(MotionRules).as_many * np.count_nonzero(both):
        return motion
    squared = np.where(second.views, alone.squared_residuals, motion.squared_residuals)
    odds = log_odds(changed(motion, squared_residuals=squared), one, both, views.gate)
    return one if odds < rules.of(StartRules).body else motion


def _decided(step: Step, state: FrontEndState, seen: Seen, motion: Resection, second: SecondMotion) -> Resection:
    """Return two motions in their order, with the odds of the second one, eq. (23f)."""
    views, tracks, clear = seen.point_views, seen.before, -float(np.log(motion.ambiguous_share))
    other = refine(views, seen.weights, second.cam_from_ref, motion.amplitudes)
    only_first = motion.accepted & (other.squared_residuals > views.clear_gate)
    first, then = tracks.keep(only_first), tracks.keep(second.views)
    votes, order = -float(np.log(max(second.odds, 1e-9))), 0.0
    if motion.ambiguous is not None or not state.start.is_over or state.ambiguity.lasts:
        if not state.start.is_over and votes <= clear and other.ok and is_behind(step.setup, then, first):
            order = -2 * clear
        elif is_behind(step.setup, tracks.keep(motion.accepted), then):
            order = 2 * clear
    odds = votes + order
    if state.start.is_over:
        odds += 2 * clear * _is_newcomer(step, state, seen, motion, second)
        if _stands(step, motion, other) and is_deeper(step.setup, then, tracks.keep(motion.accepted)):
            odds = order = -2 * clear
    if other.ok:
        odds += _by_samples(step, motion, other)
    if odds < -clear and other.ok:
        of_first = motion.cam_from_ref, motion.cov_pose, only_first, float(np.exp(odds))
        return changed(other, second=SecondMotion(*of_first, in_front=order < 0))
    return changed(motion, second=changed(second, odds=float(np.exp(-odds)), in_front=order > 0))


def _is_newcomer(step: Step, state: FrontEndState, seen: Seen, motion: Resection, second: SecondMotion) -> bool:
    """Whether many old tracks go on as before, and hardly any agrees with a second motion only.

    The speed of the second motion is no evidence, because a body may pass slowly.
    """
    old = seen.before.agreed >= step.setup.rules.of(MotionRules).full_history
    if state.ambiguity.lasts or step.jumps(motion.cam_from_ref, step.std_change):
        return False
    return bool(
        np.count_nonzero(second.views & old) < MIN_VIEWS and np.count_nonzero(motion.accepted & old) >= MANY_VIEWS
    )


def _stands(step: Step, motion: Resection, other: Resection) -> bool:
    """Whether the camera stands by another motion, and not by the first."""
    near = step.setup.rules.of(MotionRules).expected_near
    at_rest = SecondMotion(np.eye(4), np.zeros((6, 6)), motion.accepted, 0.0)
    return other.ok and _distance2(other, at_rest) < near < _distance2(motion, at_rest)


def _by_samples(step: Step, motion: Resection, other: Resection) -> float:
    """Return the log-odds of a motion over another one by inertial samples, eq. (85), if they allow only one of them.

    An accelerometer cannot distinguish a body in uniform motion from one at rest until it or the camera turns, or the
    velocity is known. The velocity is not known if a body may have been followed until now.
    """
    if step.by_inertia is None:
        return 0.0
    apart = step.distance2(other, step.by_inertia.cov) - step.distance2(motion, step.by_inertia.cov)
    return 0.5 * apart if abs(apart) > step.setup.rules.of(MotionRules).inertial_apart else 0.0


def _expected(step: Step, state: FrontEndState, seen: Seen, found: Resection) -> Resection:
    """Return the motion near the predicted one in place of one far from it, if that is more probable, eq. (23e).

    A body that comes into view has its own motion, and far points agree with it, or with one in between, within their
    noise. If this were the camera's, the camera would have jumped, and the tracks with a history would agree as well.
    The motion found then becomes the second motion.
    """
    cov = step.cov_predicted(state.unsteadiness)
    distance2 = step.distance2(found, cov)
    if not found.ok or distance2 < step.setup.rules.of(MotionRules).expected_near:
        return found
    views, fewest, old = seen.point_views, seen.point_views.settings.second_views, _with_history(step, seen)
    near = _of_old(step, seen, old, cov)
    if not near.ok or np.count_nonzero(near.accepted & old) < fewest:
        return found
    fit = log_odds(near, found, old, views.clear_gate)
    change = 0.5 * (distance2 - step.distance2(near, cov))
    clear = -float(np.log(found.ambiguous_share))
    if fit + change < -clear:
        return found
    only_found = found.accepted & (near.squared_residuals > views.clear_gate)
    if np.count_nonzero(only_found) < fewest:  # few views distinguish the two
        return changed(near, second=found.second) if fit > clear else found
    of_change = change if step.agreed_samples is None else 0.0  # `_by_samples` counts what samples say
    odds = float(np.exp(-fit - of_change))
    return changed(near, second=SecondMotion(found.cam_from_ref, found.cov_pose, only_found, odds))


def _with_history(step: Step, seen: Seen) -> NDArray[np.bool_]:
    """Return the tracks (n,) with a full history if they are many, or else all that have agreed."""
    full = seen.before.agreed >= step.setup.rules.of(MotionRules).full_history
    return full if np.count_nonzero(full) >= MANY_VIEWS else seen.before.agreed > 0


def _of_old(step: Step, seen: Seen, old: NDArray[np.bool_], cov_predicted: Array) -> Resection:
    """Return the motion of `old` tracks (n,) near the predicted one, or of all views if the tracks have none.

    `cov_predicted` (6, 6): of the predicted motion.
    """
    views = seen.point_views
    alone = resect(views.select(old), step.predicted, seen.weights[old], find_second=False)
    # far tracks alone determine a motion poorly
    if alone.ok and step.distance2(alone, cov_predicted) < step.setup.rules.of(MotionRules).expected_near:
        return judged(combined(alone, step.predicted, cov_predicted), views, seen.weights)
    return refine(views, seen.weights, step.predicted, np.zeros(views.shared.shape[2]))


def _without_body(step: Step, start: StartCheck, seen: Seen, motion: Resection) -> tuple[Resection, StartCheck]:
    """Return the motion without a body that leads the others along, once the frames since the start say there is one.

    Far points agree with any translation that a rotation compensates. So while no track has a history, all far points
    may agree with the motion of a body in front of the camera, or of the robot's own body, which is at rest in the
    image. Only the points in between contradict it, and they are too few for a second motion, or each by too little.
    """
    rho, rules = seen.before.points[:, 3], step.setup.rules
    at_rest = residuals_of(seen.point_views, np.eye(4)) < seen.point_views.gate
    others = []
    if np.count_nonzero(motion.accepted & at_rest) < np.count_nonzero(motion.accepted & ~at_rest):
        others.append(_without(step, seen, motion, at_rest))
    if motion.second is None:
        others.append(_without(step, seen, motion, motion.accepted & (rho >= median(rho[motion.accepted]))))
    other, nats = max(filter(None, others), key=lambda found: found[1], default=(motion, 0.0))
    body = start.body or Evidence(rules.of(StartRules).body, rules.of(MotionRules).unsteady_frames)
    body = body.after(nats)
    if not body.is_there:
        return motion, changed(start, body=body)
    was_followed = bool((seen.before.agreed > 0).any())  # not in the first frame
    return other, _of_body(step, start, seen) if was_followed else start


def _of_body(step: Step, start: StartCheck, seen: Seen) -> StartCheck:
    """Return the check after it has been decided that the motion since the start was that of a body."""
    rules = step.setup.rules
    body = Evidence(rules.of(StartRules).body, rules.of(MotionRules).unsteady_frames, is_there=True)
    sought = Confirmation.sought(start.rules, int(seen.before.ids[-1]) + 1)
    return changed(start, body=body, confirmation=sought, later_id=0, gone=False)


def _without(step: Step, seen: Seen, motion: Resection, apart: NDArray[np.bool_]) -> tuple[Resection, float] | None:
    """Return the motion without points `apart` (n,), and the evidence that these are on a body, eq. (23g).

    None if they determine none, or that of other points than the rest, or if the body is not in front.
    """
    views, rest, rules = seen.point_views, ~apart, step.setup.rules
    agreed = motion.accepted & rest
    if np.count_nonzero(agreed) < MANY_VIEWS or not (motion.accepted & apart).any():
        return None
    alone = resect(views.select(rest), motion.cam_from_ref, seen.weights[rest], find_second=False, search=True)
    other = refine(views, seen.weights, alone.cam_from_ref, alone.amplitudes)
    if not alone.ok or not other.ok:
        return None
    if np.count_nonzero(other.accepted & agreed) < rules.of(MotionRules).as_many * np.count_nonzero(agreed):
        return None
    noise = other.chi2 / max(other.dof, 1) if other.spread == 1 else motion.spread
    nats = 0.5 * (_distance2(motion, other) / noise - views.settings.halves_apart)
    if nats <= 0:
        return motion, nats
    less = -2 * float(np.log(motion.ambiguous_share)) * noise
    body = motion.accepted & (other.squared_residuals > motion.squared_residuals + less)
    alone = refine(views.select(~body), seen.weights[~body], other.cam_from_ref, other.amplitudes)
    scene = judged(alone, views, seen.weights)
    tracks, counts = seen.before, motion.accepted & ~body
    if not alone.ok or not is_behind(step.setup, tracks.keep(scene.accepted & agreed), tracks.keep(body & apart), 1):
        return None
    others = scene.accepted & ~motion.accepted
    if is_behind(step.setup, tracks.keep(others), tracks.keep(body), fewest=1):
        counts |= others  # otherwise these may be on a body, and the first ones not
    fit = log_odds(scene, motion, counts, views.gate) - 0.5 * views.settings.halves_apart
    second = SecondMotion(motion.cam_from_ref, motion.cov_pose, body, 0.0, in_front=True)
    return changed(scene, accepted=scene.accepted & ~body, second=second), min(nats, fit)


def _distance2(motion: Resection, other: Resection | SecondMotion) -> float:
    """Return the squared distance of two motions by both covariances."""
    apart = se3.log(motion.cam_from_ref @ se3.inverse(other.cam_from_ref))
    return float(apart @ np.linalg.solve(motion.cov_pose + other.cov_pose, apart))


def log_odds(motion: Resection, other: Resection, rows: NDArray[np.bool_], limit: Array) -> float:
    """Return the log-odds of a motion over another one by the views `rows` (n,), eq. (23d).

    Residuals are measured in the noise that the views of the motion show. Squared ones count up to a `limit` (n,), so
    that views of neither motion say nothing.
    """
    noise = motion.chi2 / max(motion.dof, 1)
    first, then = (np.minimum(m.squared_residuals[rows] / noise, limit[rows]) for m in (motion, other))
    shared = other.amplitudes @ other.amplitudes - motion.amplitudes @ motion.amplitudes
    return 0.5 * float((then - first).sum() + shared)


def is_scene_hidden(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> bool:
    """Whether a body hides the scene, so that most of the tracks that were found are on moving objects.

    This is so if of the tracks that have agreed before, fewer than MANY_VIEWS and fewer than half agree now, and many
    new ones agree on a motion that has jumped, or the scene was hidden already. If they lie in front of the former
    ones, a motion jumps if it is unlike the usual motion of this camera.
    """
    old, trusted = state.tracks.agreed > 0, seen.before.agreed > 0
    if motion.second is not None and motion.second.in_front:
        return False  # these are on the body, and the scene is in view
    if np.count_nonzero(motion.accepted & trusted) >= min(MANY_VIEWS, 0.5 * np.count_nonzero(old)):
        return False
    new, rules = seen.before.keep(motion.accepted & ~trusted), step.setup.rules
    if len(new) < rules.of(MotionRules).hidden_views:
        return False
    rho, in_front = state.tracks.points[old, 3], False
    if len(rho):
        in_front = median(new.points[:, 3]) > rules.of(StartRules).deeper * median(rho)
    usual = step.usual_change(state.unsteadiness) if in_front else step.std_change
    return state.background_hidden or step.jumps(motion.cam_from_ref, usual)


def may_be_scene(rules: Rules, tracks: Tracks, accepted: NDArray[np.bool_], fills_view: bool) -> NDArray[np.bool_]:
    """Return which tracks (n) that a motion does not explain may belong to a scene hidden by those `accepted` (n,).

    A track in front of its accepted neighbours may be on a moving body and does not count. None counts if the accepted
    tracks have covered the view from the start (`fills_view`) and nearly all of them are as far away: then they hide
    nothing, and the others came into view later.
    """
    rest, followed = ~accepted, tracks.keep(accepted)
    if fills_view and rest.any():
        as_far = followed.points[:, 3] < rules.of(StartRules).deeper * median(tracks.points[rest, 3])
        if np.count_nonzero(as_far) >= rules.of(MotionRules).calm_start * len(followed):
            return np.zeros(len(tracks), bool)
    return rest & (depth_order(tracks, followed, rules.of(StartRules)) >= 0)
