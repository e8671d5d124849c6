"""The simulated pair, its noise and its tracks."""

import numpy as np
import pytest

from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import (
    HEIGHT,
    MOTIONS,
    WIDTH,
    Scene,
    Sequence,
    physical_views,
    rectified_projection,
    rectified_views,
)

POINTS = np.random.default_rng(0).uniform([-0.8, -0.8, 2.0], [0.9, 0.8, 3.0], (50, 3))


def test_rectified_views_are_the_projection_and_their_covariance_that_of_monte_carlo():
    exact = physical_views(POINTS)
    z, cov = rectified_views(exact, 0.3)
    assert z == pytest.approx(rectified_projection().project(POINTS), abs=1e-9)
    noise = np.random.default_rng(1).normal(scale=0.3, size=(40_000, 2, 2))
    drawn, _ = rectified_views(exact[0] + noise, 0.3)
    assert np.cov(drawn.T) == pytest.approx(cov[0], abs=4 * np.sqrt(2 / 40_000) * 0.09)  # four standard errors


def views_of(sequence: Sequence) -> tuple[np.ndarray, np.ndarray]:
    """Return frame and track (k,) of all views, in order of time."""
    ids = [o.track_ids for o in sequence.observations]
    return np.repeat(np.arange(len(ids)), [len(of_frame) for of_frame in ids]), np.concatenate(ids)


@pytest.mark.parametrize("length", [2, 8, 31])
def test_controlled_tracks(length):
    """M points in every frame, each in L successive frames (fewer at the ends), all in view in mid-track."""
    s = Scene(motion=MOTIONS["slow"], track_length=length).sequence(np.random.SeedSequence(1))
    frame, track = views_of(s)
    assert (np.bincount(frame) == 48).all()
    seen = np.bincount(track)
    assert seen.max() == length
    first = np.array([frame[track == t][0] for t in range(len(seen))])
    last = np.array([frame[track == t][-1] for t in range(len(seen))])
    assert (last - first + 1 == seen).all()
    assert ((seen == length) | (first == 0) | (last == 30)).all()
    assert (np.diff(first) >= 0).all(), "ids ascend with time"


def test_natural_visibility():
    """About 60 points a frame, all of them inside both images; ids never come back."""
    s = Scene().sequence(np.random.SeedSequence(2))
    frame, track = views_of(s)
    count = np.bincount(frame)
    assert 40 < count.mean() < 80  # 60, with what one path sees more or less
    in_cam = se3.transform(se3.inverse(s.world_from_cam[10]), s.points_in_world[track[frame == 10]])
    pixels = physical_views(in_cam)
    assert ((pixels >= -0.5) & (pixels < [WIDTH - 0.5, HEIGHT - 0.5])).all()
    for t in np.unique(track):
        frames = frame[track == t]
        assert (np.diff(frames) == 1).all()


@pytest.mark.parametrize("round_off", [True, False])
def test_noise_has_its_nominal_deviation(round_off):
    s = Scene(track_length=8, round_off=round_off).sequence(np.random.SeedSequence(3))
    chi2 = []
    for o, pose in zip(s.observations, s.world_from_cam, strict=True):
        r = o.z_px - s.projection.project(se3.transform(se3.inverse(pose), s.points_in_world[o.track_ids]))
        chi2.append(np.einsum("ni,nij,nj->n", r, np.linalg.inv(o.cov_px), r))
    assert np.mean(chi2) == pytest.approx(4, abs=0.25)  # four standard errors: √(8/1488) each


def test_observations_keep_their_contract_and_depend_on_the_seed_alone():
    one, other = (Scene(motion=MOTIONS["arc"]).sequence(np.random.SeedSequence(4)) for _ in range(2))
    before = np.empty(0, int)
    for o, again in zip(one.observations, other.observations, strict=True):
        assert o.z_px.tobytes() == again.z_px.tobytes()
        assert (np.diff(o.track_ids) > 0).all()
        assert o.n_new == (~np.isin(o.track_ids, before)).sum()
        before = o.track_ids
