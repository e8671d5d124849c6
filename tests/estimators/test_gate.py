"""The gate at the joint minimum: a view's covariance contains the slides of its patch, eq. (26a)."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.estimators.window.inverse_depth import State, WhitenedViews
from stream_sfm.geometry.gates import chi2_gate
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.estimators import window_views

PROJECTION = StereoProjection(
    f_px=400.0, cx_left_px=319.5, cx_right_px=319.5, cy_px=239.5, baseline_m=0.12, width=640, height=480
)
FRAMES, POINTS, STD_PX, SLIDE_PX, GATED = 9, 3000, 0.05, 0.04, 0.01


def sliding(rng: np.random.Generator, weight: float = 1.0) -> tuple[State, WhitenedViews]:
    """A camera at rest and the middle of each track; views have noise, and patches slide in all four coordinates."""
    q = np.column_stack([rng.uniform(-0.5, 0.5, (POINTS, 2)), rng.uniform(0.1, 0.5, POINTS)])
    still = np.tile(np.eye(4), (FRAMES, 1, 1))
    state = State(still, np.arange(POINTS), np.tile(np.eye(4), (POINTS, 1, 1)), q, np.zeros(0), np.zeros((FRAMES, 0)))
    walk = np.cumsum(rng.normal(0, SLIDE_PX, (FRAMES, POINTS, 4)), axis=0)
    seen = PROJECTION.project(np.column_stack([q[:, :2], np.ones(POINTS)]) / q[:, 2:])
    z = seen + walk - walk[FRAMES // 2] + rng.normal(0, STD_PX, walk.shape)
    n = FRAMES * POINTS
    root, frame = np.tile(weight * np.eye(4) / STD_PX, (n, 1, 1)), np.repeat(np.arange(FRAMES), POINTS)
    views = window_views(frame, np.tile(np.arange(POINTS), FRAMES), z.reshape(n, 4), root, np.zeros((n, 4, 0)))
    along = np.full((n, 3), (SLIDE_PX / PROJECTION.f_px) ** 2)
    return state, replace(views, weight=np.full((n, 4), weight), var_drift=along)


@pytest.mark.parametrize("weight", [1.0, 0.4])
def test_good_views_are_gated_as_often_as_the_gate_says(weight: float) -> None:
    """In every frame of the window, whatever the views count; without slides, far more in the first and last ones."""
    state, views = sliding(np.random.default_rng(3), weight)
    gates = chi2_gate(2, 1 - GATED), chi2_gate(4, 1 - GATED)
    drift = views.var_drift
    gated = [
        1 - core.views_within_gates(PROJECTION, state, views, var, *gates).reshape(FRAMES, POINTS).mean(axis=1)
        for var in (drift, np.zeros_like(drift))
    ]
    error = np.sqrt(GATED * (1 - GATED) / POINTS)
    assert (np.abs(gated[0] - GATED) < 4 * error).all()
    assert gated[1][FRAMES // 2] == gated[0][FRAMES // 2]  # the middle of the track has no slide
    assert gated[1][[0, -1]].min() > 10 * GATED


def test_slides_add_up_from_the_middle_of_each_track() -> None:
    """Of views in any order of frames: a track of five views and one of two, with a slide of its own in each frame."""
    _, views = sliding(np.random.default_rng(0))
    rows = np.array([0, POINTS, POINTS + 1, 2 * POINTS, 2 * POINTS + 1, 3 * POINTS, 4 * POINTS])
    var = np.array([9.0, 1.0, 7.0, 2.0, 5.0, 3.0, 4.0])
    few = views[rows]
    few.var_drift[:, 0] = var / PROJECTION.f_px**2
    found = core._core._slides_of_views(np.arange(POINTS), few.ids, few.var_drift, PROJECTION.f_px)
    assert found == pytest.approx([1 + 2, 2, 5, 0, 0, 3, 3 + 4])  # each slide is since the frame before
