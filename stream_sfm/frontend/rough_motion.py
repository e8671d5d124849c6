"""The rough motion since the previous image: optical flow that most tracks agree with, searched for ever more widely.

First as far as motions between frames usually go. Where that explains too little, or nothing is known of the motion
yet, through a deeper pyramid, from the predicted motion, from none, and from motions forward and backward that change
the size of patches.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.medians import median
from ..geometry.resection import MIN_VIEWS, resect
from ..geometry.se3 import Array
from .alignment import Aligners, split
from .flow import as_exposed, track, track_wide
from .prepared import Image, PreparedImages
from .state import Setup
from .tracks import Tracks

_STD_FLOW_PX = 0.5  # of a position by flow: a guess on the large side, for the gate of the rough motion only
# Share of the tracks that were found, by weight, which a motion explains: above, it is taken; below, the next attempt
# is made, and the best of all is taken if it explains the smaller share of all tracks.
_ENOUGH = 0.4
_LEAST = 0.2
_LEAST_VIEWS = 2 * MIN_VIEWS  # fewer agree by chance
# Halvings more than the configured ones: windows of 15 px then cover an eighth as many image widths, and a motion of a
# third of the image is reached. OpenCV leaves out levels that are smaller than the window.
_MORE_LEVELS = 3
# Changes of size that are tried. Flow alone follows a patch that grows or shrinks by a quarter; with these, 0.55 to
# 1.8.
_ZOOMS = (1.4, 1 / 1.4)


@dataclass(frozen=True, slots=True)
class RoughMotion:
    """`cam_from_previous` (4, 4) from flow alone; the tracks' positions `left_px` (n, 2) by flow, which of them `agree`
    (n,) with it, and the `share` of the found ones that do."""

    cam_from_previous: Array
    left_px: Array
    agree: NDArray[np.bool_]
    share: float


@dataclass(frozen=True, slots=True)
class _Attempt:
    """Flow from a `start` (4, 4) through so many pyramid `levels`, with the previous image enlarged by `zoom`."""

    start: Array
    levels: int
    zoom: float = 1.0


@dataclass(frozen=True, slots=True)
class _FlowInput:
    """What flow is computed from: `before_half`, the `previous` left image at half the size with today's exposure."""

    setup: Setup
    aligners: Aligners
    before_half: Image
    previous: PreparedImages
    images: PreparedImages
    tracks: Tracks


def find_rough_motion(
    setup: Setup,
    aligners: Aligners,
    previous: PreparedImages,
    images: PreparedImages,
    tracks: Tracks,
    predicted: Array,
    motion_known: bool,
) -> RoughMotion | None:
    """The motion that the flow of `tracks` shows, or None; `motion_known`: whether `predicted` (4, 4) says much."""
    best: RoughMotion | None = None
    flow = _FlowInput(setup, aligners, as_exposed(previous, images), previous, images, tracks)
    for attempt in _attempts(setup.config.frontend.pyramid_levels, tracks, predicted, motion_known):
        found = _run(flow, attempt)
        if found is not None and (best is None or found.agree.sum() > best.agree.sum()):
            best = found
        if best is not None and best.share > _ENOUGH:
            return best
    if best is None or best.agree.sum() < max(_LEAST_VIEWS, _LEAST * len(tracks)):
        return None
    return best


def _attempts(near: int, tracks: Tracks, predicted: Array, motion_known: bool) -> Iterator[_Attempt]:
    """What to try, in order; `near`: pyramid levels for a motion that is predicted well."""
    deep = near + _MORE_LEVELS
    if motion_known:
        yield _Attempt(predicted, near)
    yield _Attempt(predicted, deep)
    if motion_known:
        yield _Attempt(np.eye(4), deep)
    rho = median(tracks.points[:, 3])
    if rho > 0:
        for zoom in _ZOOMS:
            forward = np.eye(4)
            forward[2, 3] = -(1 - 1 / zoom) / rho  # points at the median depth grow by just this
            yield _Attempt(forward, deep, zoom)


def _run(flow: _FlowInput, attempt: _Attempt) -> RoughMotion | None:
    """One run of flow, and the rigid motion that most of it agrees on."""
    (projection, config), tracks = flow.setup, flow.tracks
    at_px, found = _track(flow, attempt)
    z_px = np.full((int(found.sum()), 4), np.nan)
    z_px[:, :2] = at_px[found]
    motion = resect(
        projection,
        tracks.points[found],
        tracks.cov_points(projection)[found],
        z_px,
        (_STD_FLOW_PX * tracks.scale[found, None, None]) ** 2 * np.eye(4),
        attempt.start,
        config.robust.gate_probability,
        tracks.weights[found],
        find_second=False,
    )
    if not motion.ok:
        return None
    agree = np.zeros(len(tracks), bool)
    agree[found] = motion.accepted
    return RoughMotion(motion.cam_from_ref, at_px, agree, motion.share)


def _track(flow: _FlowInput, attempt: _Attempt) -> tuple[Array, NDArray[np.bool_]]:
    """Positions (n, 2) of all tracks by flow, and which were found."""
    tracks = flow.tracks
    at_px = flow.setup.projection.project_homogeneous(tracks.moved(attempt.start).points)[:, :2]
    found = np.zeros(len(tracks), bool)
    for aligner, rows in split(flow.aligners, tracks.scale):
        before_px, start_px = tracks.left_px[rows], at_px[rows]
        if aligner.scale == 1:
            at_px[rows], found[rows] = track(
                aligner, flow.before_half, flow.images, before_px, start_px, attempt.levels, attempt.zoom
            )
        else:
            at_px[rows], found[rows] = track_wide(aligner, flow.previous, flow.images, before_px, start_px)
    return at_px, found
