"""Frames enter the window: the first one begins a map, and each later one brings its views and starts points."""

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...config import WindowConfig
from ...geometry import Array, se3
from ...geometry.resection import Resection
from ...geometry.stereo import StereoProjection
from ...geometry.view_stages import CorrectedViews
from ...record import changed
from ...types import Solution
from .inverse_depth import State, WhitenedViews, at_rest, expected, held, points_alone, q_of_views
from .map_points import MapPoints
from .minimise import gauss_newton_step
from .outliers import Rejections
from .prior import Prior
from .rig_state import RigState
from .state import WindowState
from .unknowns.exposures import Exposures
from .unknowns.focus_watch import FocusWatch
from .window_frame import WindowFrame


def begun(
    projection: StereoProjection,
    frame: WindowFrame,
    views: WhitenedViews,
    corrected_px: CorrectedViews,
    first: Solution,
    rig: RigState,
    rules: WindowConfig,
) -> WindowState:
    """Begin a map in the camera of `frame`, which becomes the reference.

    `first` contains the ids of those `views` that start points; `corrected_px` (V, 4): the views without the rig's
    errors; `rig`: the knowledge of these errors.
    """
    ids, e = first.track_ids, views.own.shape[2]
    views = changed(views, used=core.among(views.ids, ids))
    points = MapPoints.of_reference(ids, q_of_views(projection, CorrectedViews(corrected_px[views.used])))
    at = State(np.eye(4)[None], ids, points.ref_from_anchor, points.q, rig.mean, np.zeros((1, e)))
    q, cov, by_own, by_rig = points_alone(projection, views, at, np.zeros(len(rig)))
    prior = Prior.from_first_frame(ids, q, cov, by_own, by_rig, first.world_from_cam, first.cov_pose, rig)
    current, _ = gauss_newton_step(
        WindowState(
            projection=projection,
            rules=rules,
            reference=frame,
            exposures=Exposures.of_reference(),
            own=np.empty((0, e)),
            views=views[:0],
            first_views=views,
            places=(views.ids, views.expected_px),
            points=changed(points, q=q),
            rejections=Rejections(rules),
            prior=prior,
            amplitudes=np.zeros(prior.modes.shape[2]),
            focus=FocusWatch.begun(rig.rules),
        )
    )
    return changed(current, read=current.newest_marginals())


def entered(
    current: WindowState,
    frame: WindowFrame,
    cam_from_ref: Array,
    views: WhitenedViews,
    corrected_px: CorrectedViews,
    rejected: NDArray[np.int64],
    own: Array,
) -> WindowState:
    """Add the newest frame to the window, without the views of `rejected` tracks.

    Points that are not in the map yet start at their stereo view; `corrected_px` (V, 4): the views without the rig's
    errors. `own` (1, e): initial amplitudes of the errors that the views share.
    """
    wanted = ~(current.rejections.excluded(views.ids) | core.among(views.ids, rejected))
    known = core.among(views.ids, current.points.ids)
    new = ~known & views.stereo & wanted
    again = core.among(current.dropped, views.ids[new])
    q = q_of_views(current.projection, CorrectedViews(corrected_px[new]))
    inertia = current.inertia
    if inertia is not None and frame.interval is not None:  # which has slides as unknowns
        inertia = inertia.with_newest(frame.interval, frame.velocity, frame.std_turn_rad)
        frame = changed(frame, std_turn_rad=0.0)
    current = changed(
        current,
        restarted=current.dropped[again],
        dropped=current.dropped[~again],
        points=current.points.with_new(views.ids[new], q, se3.inverse(cam_from_ref)),
        frames=(*current.frames, frame),
        cams_from_ref=np.concatenate([current.cams_from_ref, cam_from_ref[None]]),
        own=np.concatenate([current.own, own]),
        inertia=inertia,
        ambiguous_motions=current.ambiguous_motions.with_slide(cam_from_ref, frame.std_turn_rad),
    )
    views = changed(views, frame=np.full(len(views), len(current.frames) - 1), used=(known | new) & wanted)
    if frame.rig is not None:
        views = held(expected(current.state, views, frame.rig), *current.places, current.rules.rests_px)
        views = at_rest(views, frame.rig, current.prior.rig.age_s(frame.stamp_ns))
        current = changed(current, places=(views.ids, views.expected_px))
    # unused views are never used again: of these, only the drift of points in the map is needed
    kept = np.flatnonzero(current.views.used | core.among(current.views.ids, current.points.ids))
    return changed(current, views=current.views.with_newest(kept, views))


def with_rejected(current: WindowState, rejected: NDArray[np.int64]) -> WindowState:
    """Count the tracks that disagree with the motion to the next frame.

    If a track has only one view in the map, that view may be the wrong one instead of the rejected one: the point is
    dropped, and starts again with the track's next view.
    """
    views, points = current.views, current.points
    seen = core.times_among(rejected, views.ids, views.used)
    young = rejected[(seen <= 1) & ~core.among(rejected, current.prior.ids)]
    current = changed(current, rejections=current.rejections.with_more(rejected))
    if not len(young):
        return current
    return changed(
        current,
        views=changed(views, used=views.used & ~core.among(views.ids, young)),
        points=points.keep(~core.among(points.ids, young)),
        dropped=core.union_of(np.concatenate([current.dropped, young])),
    )


def with_second(current: WindowState, motion: Resection, std_moved: Array) -> WindowState:
    """Add the uncertainty from the second of two plausible motions, which may be the true one."""
    seen = current.newest_cam_from_ref, current.agreeing(fewest=1 if motion.ambiguous is None else 2)
    motions, ambiguity = current.ambiguous_motions.with_second(motion, std_moved, *seen)
    current = changed(current, ambiguous_motions=motions)
    if motion.ambiguous is None or ambiguity is None:
        return current
    return changed(current, frames=(*current.frames[:-1], changed(current.newest_frame, ambiguity=ambiguity)))


def settled(current: WindowState) -> WindowState:
    """Drop the uncertainty about second motions as far back as tracks confirm the motions that were followed."""
    n, ambiguous = len(current.ambiguous_motions.motions), [f.ambiguity.shape[1] > 0 for f in current.frames]
    motions, confirmed = current.ambiguous_motions.settled(current.agreeing(fewest=1))
    first = 0 if confirmed == n else max(sum(ambiguous) - confirmed, 0)
    of_ambiguous = np.cumsum(ambiguous) - 1
    frames = [
        changed(f, ambiguity=np.zeros((6, 0))) if was and k >= first else f
        for f, was, k in zip(current.frames, ambiguous, of_ambiguous, strict=True)
    ]
    return changed(current, ambiguous_motions=motions, frames=tuple(frames))
