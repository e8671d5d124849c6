"""Every k-th frame is estimated as if there were no others, and those between are placed with what is known."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.errors import ConfigError
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.every_kth import EveryKth
from stream_sfm.geometry import se3
from stream_sfm.methods import METHODS
from stream_sfm.rig_model.model import RigModel
from stream_sfm.simulation.scenes import Scene
from stream_sfm.types import LastingErrors, RigView, Status
from tests.helpers.estimators import nees, run, without_views

K = 3
THINNED = Config(estimate_every=K)


@pytest.mark.parametrize("method", list(METHODS))
def test_the_method_sees_every_kth_frame_alone(method, arc):
    """Its estimates are to the byte those of a run over every k-th frame."""
    thinned = run(method, arc.projection, arc.observations, THINNED)
    seen, newest = [], -1
    for o in arc.observations[::K]:
        seen.append(replace(o, n_new=int((o.track_ids > newest).sum()), cam_from_previous=None))
        newest = o.track_ids[-1]
    alone = run(method, arc.projection, seen)
    for a, b in zip(thinned[::K], alone, strict=True):
        assert a.world_from_cam.tobytes() == b.world_from_cam.tobytes()
        assert a.cov_points.tobytes() == b.cov_points.tobytes()


@pytest.mark.parametrize("method", ["cross-frame", "ekf"])
def test_frames_between_are_placed(method, arc):
    for o, s in zip(arc.observations, run(method, arc.projection, arc.observations, THINNED), strict=True):
        assert s.status in (Status.OK, Status.INITIALISING) and s.window_frame_indices[-1] == o.frame_index
        assert np.isin(s.track_ids, o.track_ids).all() and (np.diff(s.track_ids) > 0).all()
        carried = se3.transform(s.world_from_cam, s.points_in_cam)
        assert carried == pytest.approx(s.points_in_world, abs=1e-9)
        assert (np.linalg.eigvalsh(s.cov_points) > 0).all()
        xi = se3.log(se3.inverse(arc.world_from_cam[o.frame_index]) @ s.world_from_cam)
        assert np.abs(xi[:3]).max() < 0.05 and np.abs(xi[3:]).max() < 0.02  # m and rad, as of every method


@pytest.mark.slow
def test_covariances_of_frames_between_hold():
    """20 scenes: NEES of the pose, 6 expected, in frames after an estimate as well as in estimates."""
    values: list[list[float]] = [[], []]
    for seed in range(20):
        s = Scene(track_length=16, frames=22).sequence(np.random.SeedSequence(seed))
        for n, found in enumerate(run("cross-frame", s.projection, s.observations, THINNED)):
            if n > 1:
                values[n % K != 0].append(nees(found.world_from_cam, found.cov_pose, s.world_from_cam[n]))
    at, between = map(np.mean, values)
    # the mean of 20 scenes scatters by √(12/20) = 0.8; frames of one scene are not independent
    assert abs(at - 6) < 2.4 and between < 8.4
    assert between > 3


def test_a_frame_that_cannot_be_placed_goes_to_the_method(arc):
    """An empty frame between is lost; the next frame is estimated at once."""
    observations = list(arc.observations)
    observations[4] = without_views(observations[4])
    s = run("cross-frame", arc.projection, observations, THINNED)
    assert s[4].status is Status.LOST and np.trace(s[4].cov_pose) > np.trace(s[3].cov_pose)
    assert s[5].status is Status.OK and len(s[5].window_frame_indices) > 1


def test_drift_and_motion_add_up(arc):
    """What the method is told of the time since its last frame: drift in quadrature, motions one after the other."""
    told, inner = [], make_estimator("cross-frame", arc.projection, Config())
    take = inner.step

    def recorded(observations):
        told.append(observations)
        return take(observations)

    inner.step = recorded
    estimator = EveryKth(inner, arc.projection, THINNED)
    poses = arc.world_from_cam
    for n, o in enumerate(arc.observations[: K + 1]):
        motion = None if n == 0 else se3.inverse(poses[n]) @ poses[n - 1]
        drift = np.full(len(o.track_ids), 0.1)
        estimator.step(replace(o, cam_from_previous=motion, lasting=LastingErrors(drift, std_turn_rad=1e-4)))
    (first, last) = told
    both = np.isin(last.track_ids, first.track_ids)
    assert last.lasting.std_drift_px[both] == pytest.approx(np.sqrt(K) * 0.1)
    assert last.lasting.std_turn_rad == pytest.approx(np.sqrt(K) * 1e-4)
    motion = se3.inverse(poses[K]) @ poses[0]
    # the motion that was found between, of noisy views
    assert se3.log(se3.inverse(motion) @ last.cam_from_previous) == pytest.approx(np.zeros(6), abs=0.02)
    assert last.n_new == (last.track_ids > first.track_ids[-1]).sum()


def test_one_camera_estimates_every_frame():
    with pytest.raises(ConfigError, match="estimate_every needs two cameras"):
        Config(mono=True, estimate_every=2)


def test_frames_between_are_placed_by_views_without_what_timing_does(arc):
    """Views that timing has moved, as the front-end says, place frames where they do without it."""
    model, still, moved = RigModel.of(arc.projection, Config().rig), [], []
    for o in arc.observations:
        timing_px = np.broadcast_to([6.0, 0.0, 6.0, 0.0], o.z_px.shape)
        still.append(replace(o, rig=RigView(model)))
        moved.append(replace(o, rig=RigView(model, timing_px=timing_px), z_px=o.z_px + timing_px))
    estimator = make_estimator("cross-frame", arc.projection, THINNED)
    for n in range(2 * K):
        other = copy.deepcopy(estimator)
        found = estimator.step(still[n])
        if n > K:  # a map's first frame still has it
            placed = other.step(moved[n])
            assert placed.status is found.status
            # m and rad; 6 px are 10 mrad, and errors at rest are those of where views were seen
            apart = se3.log(se3.inverse(found.world_from_cam) @ placed.world_from_cam)
            assert np.abs(apart).max() < 1e-3
