"""The tools that compare estimators: the causal bound is least squares over all views; draws of tracks are paired."""

import numpy as np
import pytest

from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from tools.bound import TrackViews, causal_errors
from tools.thinned import KEPT, compared, kept

PROJECTION = StereoProjection(
    f_px=400.0, cx_left_px=319.5, cx_right_px=319.5, cy_px=239.5, baseline_m=0.12, width=640, height=480
)
CONSTANT_PX = 0.04


def some_tracks(rng: np.random.Generator, frames: int) -> list[TrackViews]:
    """Tracks of two to five frames, with errors as they may be."""
    tracks = []
    for _ in range(40):
        first = int(rng.integers(0, frames - 1))
        track = TrackViews(rng.uniform((-1, -1, 2), (1, 1, 6)), 0.05)
        for k in range(int(rng.integers(2, min(5, frames - first) + 1))):
            track.frames.append(first + k)
            track.errors_px.append(rng.normal(0, 0.05, 4))
            track.var_slides_px2.append(0.0 if k == 0 else 0.03**2)
        tracks.append(track)
    return tracks


def dense(true: np.ndarray, tracks: list[TrackViews], last: int) -> np.ndarray:
    """The error of pose `last` by one system of all views so far, with their covariance as one matrix per track."""
    poses, unknowns = 6 * last, 6 * last + 3 * len(tracks)
    h, g = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    for i, track in enumerate(tracks):
        n = sum(f <= last for f in track.frames)
        if n < 2:
            h[poses + 3 * i : poses + 3 * i + 3, poses + 3 * i : poses + 3 * i + 3] = np.eye(3)
            continue
        rows = np.zeros((4 * n, unknowns))
        for k, frame in enumerate(track.frames[:n]):
            in_cam = se3.transform(se3.inverse(true[frame]), track.in_world[None])
            a = PROJECTION.jacobian(in_cam)[0]
            rows[4 * k : 4 * k + 4, poses + 3 * i : poses + 3 * i + 3] = a @ true[frame][:3, :3].T
            if frame:
                of_pose = np.hstack([-np.eye(3), se3.skew(in_cam[0])])
                rows[4 * k : 4 * k + 4, 6 * frame - 6 : 6 * frame] = a @ of_pose
        cov = np.zeros((4 * n, 4 * n))
        walked = np.cumsum(track.var_slides_px2)
        for k in range(4 * n):
            for m in range(4 * n):
                if k % 2 == m % 2:  # both along the rows, or both across them
                    cov[k, m] = walked[min(k // 4, m // 4)] + CONSTANT_PX**2 * (k % 4 > 1 and m % 4 > 1)
        cov += track.std_px**2 * np.eye(4 * n)
        information = np.linalg.inv(cov)
        h += rows.T @ information @ rows
        g += rows.T @ information @ np.concatenate(track.errors_px[:n])
    return np.linalg.solve(h, g)[poses - 6 : poses]


def test_the_bound_is_least_squares_over_all_views_so_far() -> None:
    rng, frames = np.random.default_rng(1), 7
    true = se3.exp(np.cumsum(rng.normal(0, 0.03, (frames, 6)), axis=0))
    true = se3.inverse(true[0]) @ true
    tracks = some_tracks(rng, frames)
    found = causal_errors(PROJECTION, true, tracks, CONSTANT_PX)
    for last in range(1, frames):
        assert found[last] == pytest.approx(dense(true, tracks, last), rel=1e-4, abs=1e-9)


def test_a_draw_keeps_the_same_tracks_wherever_it_is_made() -> None:
    """Four fifths of them, others in each draw, and all in draw 0."""
    ids = np.arange(20_000)
    draws = [kept(ids, draw) for draw in range(1, 7)]
    error = np.sqrt(KEPT * (1 - KEPT) / len(ids))
    for k, one in enumerate(draws):
        assert abs(one.mean() - KEPT) < 4 * error
        assert (kept(ids[100:200], k + 1) == one[100:200]).all()
        for other in draws[:k]:
            assert abs((one & other).mean() - KEPT**2) < 5 * error
    assert kept(ids, 0).all()


def test_ratios_of_draws_are_paired() -> None:
    """What both runs of a draw share is no error of their ratio."""
    common = np.random.default_rng(0).lognormal(0, 1, 8)
    before = {"a.mcap": {"NEES": list(common)}, "b.mcap": {"NEES": list(common)}}
    after = {"a.mcap": {"NEES": list(0.9 * common)}, "b.mcap,rig.exact=true": {"NEES": [1.0]}}
    table = compared(after, before)
    cells = [list(column.cells) for column in table.columns]
    assert cells[0] == ["a"] and cells[-1] == ["0.90 ± 0.00"]
