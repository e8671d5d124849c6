"""The contract of every method: shapes, covariances, ids, determinism, loss and recovery, empty frames."""

import dataclasses

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators import make_estimator
from stream_sfm.geometry import se3
from stream_sfm.methods import METHODS
from stream_sfm.simulation.scenes import Scene
from stream_sfm.types import Status
from tests.helpers.estimators import nees, nees_of_points, run, without_views

methods = pytest.mark.parametrize("method", list(METHODS))


def assert_covariances(cov, what):
    assert cov == pytest.approx(np.swapaxes(cov, -1, -2), rel=1e-9, abs=1e-15), what
    scale = np.sqrt(np.maximum(np.diagonal(cov, axis1=-2, axis2=-1), 1e-30))
    eigenvalues = np.linalg.eigvalsh(cov / (scale[..., :, None] * scale[..., None, :]))
    assert (eigenvalues > -1e-9).all(), what


@pytest.fixture(scope="module", params=list(METHODS))
def solved(request, arc):
    """A method, and its solutions of the whole sequence."""
    return request.param, run(request.param, arc.projection, arc.observations)


def test_shapes_covariances_and_ids(solved, arc):
    ended = set()
    for o, s in zip(arc.observations, solved[1], strict=True):
        n = len(s.track_ids)
        assert s.world_from_cam.shape == (4, 4)
        r = s.world_from_cam[:3, :3]
        assert r @ r.T == pytest.approx(np.eye(3), abs=1e-12)
        assert s.cov_pose.shape == (6, 6)
        assert s.points_in_cam.shape == s.points_in_world.shape == (n, 3)
        assert s.cov_points.shape == s.cov_points_in_world.shape == (n, 3, 3)
        assert (np.diff(s.track_ids) > 0).all()
        assert np.isin(s.track_ids, o.track_ids).all()
        assert np.isin(s.rejected_ids, o.track_ids).all()
        assert len(s.window_frame_indices) == len(s.window_world_from_cam) >= 1
        assert s.window_frame_indices[-1] == o.frame_index
        assert s.window_world_from_cam[-1] == pytest.approx(s.world_from_cam, abs=1e-9)
        assert_covariances(s.cov_pose, "pose")
        assert_covariances(s.cov_points, "points in the camera")
        assert_covariances(s.cov_points_in_world, "points in the world")
        carried = se3.transform(s.world_from_cam, s.points_in_cam)
        assert carried == pytest.approx(s.points_in_world, abs=1e-9)
        k = len(s.ended_ids)
        assert s.ended_points_in_world.shape == (k, 3)
        assert s.ended_cov_points_in_world.shape == (k, 3, 3)
        assert not ended & set(s.ended_ids.tolist()), "a point ends once"
        assert not np.isin(s.ended_ids, s.track_ids).any()
        ended |= set(s.ended_ids.tolist())
    assert len(ended) > 5  # of hundreds: the path turns away from most


def test_accuracy(solved, arc):
    """Loose bounds for all methods: the world is the first camera, and errors of the path are centimetres."""
    _, solutions = solved
    assert solutions[0].status is Status.INITIALISING
    assert all(s.status is Status.OK for s in solutions[1:])
    assert solutions[0].world_from_cam == pytest.approx(np.eye(4), abs=1e-9)
    xi = se3.log(se3.inverse(arc.world_from_cam[-1]) @ solutions[-1].world_from_cam)
    assert np.abs(xi[:3]).max() < 0.05  # m, at the end of a path of some metres
    assert np.abs(xi[3:]).max() < 0.02  # rad
    s = solutions[-1]
    in_cam = se3.transform(se3.inverse(arc.world_from_cam[-1]), arc.points_in_world[s.track_ids])
    assert np.sqrt(((s.points_in_cam - in_cam) ** 2).sum(axis=1).mean()) < 0.03  # m, at distances of some metres


def test_deterministic_and_inputs_untouched(solved, arc):
    method, first = solved
    before = [o.z_px.copy() for o in arc.observations]
    for a, b in zip(first, run(method, arc.projection, arc.observations), strict=True):
        assert a.world_from_cam.tobytes() == b.world_from_cam.tobytes()
        assert a.cov_points.tobytes() == b.cov_points.tobytes()
    assert all((o.z_px == z).all() for o, z in zip(arc.observations, before, strict=True))


@methods
def test_lost_and_resume(method, arc):
    """Frame 6 is empty: lost, with a predicted pose that is less certain; then a new map, then ok again."""
    observations = [
        *arc.observations[:6],
        without_views(arc.observations[6]),
        *(dataclasses.replace(o, track_ids=o.track_ids + 1000, n_new=len(o.track_ids)) for o in arc.observations[7:]),
    ]
    s = run(method, arc.projection, observations)
    assert s[5].status is Status.OK
    assert s[6].status is Status.LOST
    assert s[6].reason
    assert len(s[6].track_ids) == 0
    assert np.trace(s[6].cov_pose) > np.trace(s[5].cov_pose)
    assert s[7].status is Status.INITIALISING
    assert np.trace(s[7].cov_pose) > np.trace(s[6].cov_pose)
    assert all(x.status is Status.OK for x in s[8:])
    assert_covariances(s[-1].cov_pose, "pose after resuming")
    if method != "ekf-cv":  # badly linearised, it treats the uncertainty of the lost frames as information
        assert nees(s[-1].world_from_cam, s[-1].cov_pose, arc.world_from_cam[-1]) < 30
    ended = np.concatenate([x.ended_ids for x in s[:8]])
    assert np.isin(s[5].track_ids, ended).all(), "a lost map is handed over"


@methods
def test_empty_from_the_first_frame_on(method, arc):
    observations = [without_views(o) for o in arc.observations[:2]] + list(arc.observations[2:5])
    s = run(method, arc.projection, observations)
    assert [x.status for x in s[:2]] == [Status.LOST, Status.LOST]
    assert s[2].status is Status.INITIALISING
    assert s[4].status is Status.OK


@methods
def test_few_views_are_reported(method, arc):
    """With ten points a frame is estimated, and degraded."""
    ten = arc.observations[0].track_ids[::4][:10]
    seen = [(o, np.isin(o.track_ids, ten)) for o in arc.observations[:4]]
    observations = [
        dataclasses.replace(o, track_ids=o.track_ids[keep], z_px=o.z_px[keep], cov_px=o.cov_px[keep])
        for o, keep in seen
    ]
    s = run(method, arc.projection, observations)
    assert s[1].status is Status.DEGRADED
    assert "views" in s[1].reason


def with_gross_errors(observations):
    """A tenth of the views of every frame has an error of 40 px."""
    rng = np.random.default_rng(1)
    for o in observations:
        z, bad = o.z_px.copy(), rng.random(len(o.z_px)) < 0.1
        z[bad] += rng.choice([-40.0, 40.0], size=(bad.sum(), 4))
        yield dataclasses.replace(o, z_px=z)


def without_right_sides(observations):
    """A third of the tracks loses its right side after the first view."""
    known = np.empty(0, np.int64)
    for o in observations:
        z = o.z_px.copy()
        z[np.isin(o.track_ids, known) & (o.track_ids % 3 == 0), 2:] = np.nan
        known = o.track_ids
        yield dataclasses.replace(o, z_px=z)


@methods
@pytest.mark.parametrize("spoilt", [with_gross_errors, without_right_sides])
def test_views_that_are_wrong_or_missing_cost_centimetres_at_most(method, spoilt, arc):
    s = run(method, arc.projection, spoilt(arc.observations))
    assert all(x.status in (Status.OK, Status.DEGRADED) for x in s[1:])
    xi = se3.log(se3.inverse(arc.world_from_cam[-1]) @ s[-1].world_from_cam)
    assert np.abs(xi[:3]).max() < 0.06  # m: a little more than without wrong or missing views
    assert np.abs(xi[3:]).max() < 0.03  # rad
    assert np.isfinite(s[-1].cov_points).all()


def assert_consistent(method, scene, seed, trials):
    """NEES of the last pose and its points: within three standard errors of the expected value."""
    pose, points = [], []
    for trial in range(trials):
        s = scene.sequence(np.random.SeedSequence([seed, trial]))
        found = run(method, s.projection, s.observations)[-1]
        pose.append(nees(found.world_from_cam, found.cov_pose, s.world_from_cam[-1]))
        points.append(nees_of_points(found, s))
    assert abs(np.mean(pose) - 6) < 3 * np.sqrt(12 / trials)
    assert abs(np.mean(points) - 3) < 3 * np.sqrt(6 / trials)  # the points of a scene share the error of its pose


@pytest.mark.parametrize("method", [m for m in METHODS if m not in ("ekf-cv", "depth-filter")])
def test_covariances_of_poses_and_points_are_those_of_their_errors(method):
    """Monte Carlo over 24 scenes of six frames, in which the first tracks have ended: NEES is 6 and 3.

    Two methods are left out: cameras do not move at constant velocity, and a depth filter treats points of other frames
    as independent.
    """
    assert_consistent(method, Scene(track_length=4, frames=6, visible=60, std_px=0.2, round_off=False), 3, 24)


@pytest.mark.slow
def test_concatenated_motions_are_consistent():
    """30 scenes, after 20 pairs; neighbouring pairs share the noise of a frame. If this is ignored, NEES is 2 to 4."""
    assert_consistent("frame-to-frame", Scene(track_length=8, frames=21), 11, 30)


@methods
def test_a_frame_without_a_solution_is_lost_and_the_next_one_begins_a_map(method, arc, monkeypatch):
    estimator = make_estimator(method, arc.projection, Config())
    followed = [estimator.step(o) for o in arc.observations[:4]][-1]

    def fail(*_, **__):
        raise np.linalg.LinAlgError("not definite")

    with monkeypatch.context() as patched:
        for module in ("baselines.baseline", "window.cross_frame"):
            patched.setattr(f"stream_sfm.estimators.{module}.initial_motion", fail)
        lost = estimator.step(arc.observations[4])
    assert lost.status is Status.LOST and "do not determine the motion" in lost.reason
    assert np.isin(followed.track_ids, lost.ended_ids).all()
    assert_covariances(lost.cov_pose, "predicted pose")
    assert estimator.step(arc.observations[5]).status is Status.INITIALISING
