"""The spread of the noise between tracks: it is measured correctly, and motions are better with it."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.config import Config
from stream_sfm.config.rules import Rules
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.window.reported.rules import ReportedRules
from stream_sfm.estimators.window.reported.track_noise import TrackNoise
from stream_sfm.geometry import se3
from stream_sfm.record import changed
from stream_sfm.simulation.scenes import Scene
from stream_sfm.types import LastingErrors

RULES = ReportedRules()


def residuals(spread: float, tracks: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """λ (n,) of tracks, of mean 1 and a variance; sums and numbers of squared residuals; and which points are known."""
    factor = np.ones(tracks) if spread == 0 else 1 / rng.gamma(2 + 1 / spread, 1 / (1 + 1 / spread), tracks)
    values, known = 4.0 * rng.integers(2, 9, tracks), rng.random(tracks) < 0.5
    return factor, factor * rng.chisquare(values - np.where(known, 0, 3)), values, known


@pytest.mark.parametrize("spread", [0.0, 0.1, 0.3])
def test_the_spread_is_found(spread):
    """Within a fifth of the true one; 0.01 if there is none."""
    rng, noise = np.random.default_rng(3), TrackNoise.unknown(RULES)
    for _ in range(300):
        noise = noise.after(*residuals(spread, 150, rng)[1:])
    assert noise.spread == pytest.approx(spread, rel=0.2, abs=0.01)
    assert noise.mean == pytest.approx(1, abs=0.05)


def test_tracks_count_according_to_their_residuals():
    """The mean of the expected λ is the true one, and weights from it lose less information than equal ones."""
    rng, noise = np.random.default_rng(4), TrackNoise.unknown(RULES)
    for _ in range(300):
        noise = noise.after(*residuals(0.3, 150, rng)[1:])
    factor, *of_tracks = residuals(0.3, 100_000, rng)
    information, values = noise.information(*of_tracks), of_tracks[1]
    assert np.average(information, weights=values) == pytest.approx(1)
    for part in np.array_split(np.argsort(information), 5):  # by fifths, up to what normalises them
        ratio = (factor[part] * information[part]).mean() / (factor * information).mean()
        assert ratio == pytest.approx(1, abs=0.05)

    def variance(weights: np.ndarray) -> float:
        return float((weights**2 * values * factor).sum() / (weights * values).sum() ** 2)

    assert variance(information) < 0.9 * variance(np.ones(len(factor)))


def test_tracks_that_are_alike_count_alike():
    """This is exact before any track, and within a tenth after many tracks with the same noise."""
    rng, noise = np.random.default_rng(5), TrackNoise.unknown(RULES)
    _, *of_tracks = residuals(0.0, 200, rng)
    assert (noise.information(*of_tracks) == 1).all()
    for _ in range(300):
        noise = noise.after(*residuals(0.0, 150, rng)[1:])
    assert np.abs(noise.information(*of_tracks) - 1).max() < 0.1


def test_the_influence_of_one_track_is_limited():
    noise = TrackNoise.unknown(RULES)
    wild = noise.after(np.array([1e12]), np.array([16.0]), np.array([False]))
    most = noise.after(np.array([13 * RULES.tracks_most]), np.array([16.0]), np.array([False]))
    assert wild.sums == pytest.approx(most.sums)
    nothing = noise.after(np.array([0.0]), np.array([2.0]), np.array([False]))  # of a view from one side
    assert nothing.sums == pytest.approx(noise.sums)


def test_squares_are_those_of_expected_views():
    """Each is by its own covariance, whatever its weight, and only used views count."""
    scene = Scene(frames=12, track_length=8, visible=40, std_px=0.1, round_off=False)
    sequence = scene.sequence(np.random.SeedSequence(8))
    estimator = make_estimator("cross-frame", sequence.projection, Config())
    for o in sequence.observations:
        estimator.step(o)
    current = estimator.map
    views, state = current.views, current.state
    used = views.used & (np.arange(len(views)) % 5 > 0)
    own = changed(views, used=used, root=views.root * 0.5, weight=views.weight * 0.5)
    squares, values = core.squares_of_tracks(current.projection, state, own)
    expected = core.expected_views(current.projection, state, views, views.stereo, views.expected_px)
    whitened = np.einsum("vij,vj->vi", views.root / views.weight[:, None, :], views.z_px - expected)
    for point, square, n in zip(state.ids, squares, values, strict=True):
        of_it = used & (views.ids == point)
        assert square == pytest.approx((whitened[of_it] ** 2).sum())
        assert n == 4 * of_it.sum()


def errors_of_motions(learns: bool, seed: int) -> list[np.ndarray]:
    """Errors of motions over one frame, for tracks whose noise has a spread of 1, which is learnt or not."""
    scene = Scene(frames=60, track_length=8, visible=60, std_px=0.1, round_off=False)
    sequence, rng = scene.sequence(np.random.SeedSequence([9, seed])), np.random.default_rng(seed)
    rules = ReportedRules() if learns else ReportedRules(tracks_guess=1e9)
    estimator = make_estimator("cross-frame", sequence.projection, Config(rules=Rules((rules,))))
    factor = 1 / rng.gamma(3, 1 / 2, len(sequence.points_in_world))
    cams, found = sequence.world_from_cam, []
    for n, o in enumerate(sequence.observations):
        in_cam = se3.transform(se3.inverse(cams[n]), sequence.points_in_world[o.track_ids])
        exact = sequence.projection.project(in_cam)
        z = exact + (o.z_px - exact) * np.sqrt(factor[o.track_ids])[:, None]
        solution = estimator.step(replace(o, z_px=z, lasting=LastingErrors(None, np.ones((len(z), 2)))))
        if n > 20:
            true = se3.inverse(cams[n - 1]) @ cams[n]
            found.append(se3.log(se3.inverse(true) @ solution.relative.frame_from_newest[-1]))
    return found


def test_motions_are_better_if_tracks_differ():
    """In the same runs positions and rotations are better by at least 3 % with the weights of tracks."""
    learnt, alike = (np.concatenate([errors_of_motions(learns, seed) for seed in range(6)]) for learns in (True, False))
    for part in (slice(3), slice(3, 6)):
        assert np.sqrt((learnt[:, part] ** 2).mean() / (alike[:, part] ** 2).mean()) < 0.97
