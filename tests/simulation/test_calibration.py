"""The study of wrong calibrations: its noise, its bound, and its results with few trials."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.camera.refinement import LENS_TERMS
from stream_sfm.estimators.baselines.bundle_adjustment import residuals_and_jacobians
from stream_sfm.estimators.baselines.full_batch import cramer_rao_bound, gather_views
from stream_sfm.simulation import calibration
from stream_sfm.simulation.calibration import seen_by_wrong_rig
from stream_sfm.simulation.scenes import Scene, Sequence
from stream_sfm.simulation.studies import Job, Study

RHO = 0.75
SMALL = Scene(frames=5, track_length=4, visible=12, std_px=0.2, round_off=False)


def test_noise_has_its_variance_and_is_autocorrelated_along_tracks() -> None:
    scene = Scene(frames=40, track_length=20, visible=300, std_px=0.2, round_off=False, autocorrelation=RHO)
    exact = replace(scene, std_px=1e-9, autocorrelation=0.0)
    noisy, clean = (s.sequence(np.random.SeedSequence(1)) for s in (scene, exact))
    errors = np.full((len(noisy.points_in_world), scene.frames, 4), np.nan)
    for o, true in zip(noisy.observations, clean.observations, strict=True):
        std = np.sqrt(np.diagonal(o.cov_px, axis1=1, axis2=2))
        errors[o.track_ids, o.frame_index] = (o.z_px - true.z_px) / std
    tolerance = 4 * np.sqrt(2 / (len(errors) * 20 * 4 * (1 - RHO**2) / (1 + RHO**2)))  # of what is independent
    assert np.nanmean(errors**2) == pytest.approx(1, abs=tolerance)
    for lag in (1, 3):
        assert np.nanmean(errors[:, lag:] * errors[:, :-lag]) == pytest.approx(RHO**lag, abs=tolerance)


def dense_bound(sequence: Sequence, effects: np.ndarray) -> np.ndarray:
    """The joint covariance of all poses but the first, and of the rig, from one matrix over all views."""
    ids, views = gather_views(sequence.observations)
    _, j_pose, j_point = residuals_and_jacobians(
        sequence.projection, sequence.world_from_cam, sequence.points_in_world[ids], views
    )
    frames, k = len(sequence.world_from_cam), len(views.frame)
    j = np.zeros((k, 4, 6 * frames + effects.shape[2] + 3 * len(ids)))
    rig = slice(6 * frames, 6 * frames + effects.shape[2])
    for row, (n, i) in enumerate(zip(views.frame, views.point, strict=True)):
        j[row, :, 6 * n : 6 * n + 6] = j_pose[row]
        j[row, :, rig] = effects[row]
        j[row, :, rig.stop + 3 * i : rig.stop + 3 * i + 3] = j_point[row]
    roots = np.linalg.inv(np.swapaxes(np.linalg.cholesky(views.information), 1, 2))
    same = views.point[:, None] == views.point
    correlation = same * RHO ** np.abs(views.frame[:, None] - views.frame)
    cov = np.einsum("kab,kl,lcb->kalc", roots, correlation, roots).reshape(4 * k, 4 * k)
    j = j.reshape(4 * k, -1)[:, 6:]
    information = j.T @ np.linalg.solve(cov, j)
    information[rig.start - 6 : rig.stop - 6, rig.start - 6 : rig.stop - 6] += np.eye(effects.shape[2])
    return np.asarray(np.linalg.inv(information))


def test_the_bound_is_that_of_all_views_with_their_correlations() -> None:
    sequence = SMALL.sequence(np.random.SeedSequence(2))
    observations = seen_by_wrong_rig(sequence, np.zeros(len(LENS_TERMS)))
    by_track = np.concatenate([o.rig.model.effects(o.z_px) for o in observations if o.rig is not None])[
        ..., : len(LENS_TERMS)
    ]
    order = np.argsort(np.concatenate([o.track_ids for o in observations]), kind="stable")
    last = SMALL.frames - 1
    found = cramer_rao_bound(
        sequence.projection, observations, sequence.world_from_cam, sequence.points_in_world, last, RHO
    )
    expected = dense_bound(sequence, by_track[order])[6 * last - 6 : 6 * last, 6 * last - 6 : 6 * last]
    scale = np.sqrt(np.diag(expected))
    off = (found.cov_poses[last] - expected) / np.outer(scale, scale)
    assert np.abs(off).max() < 1e-5  # of σ: the information has a condition number of 1e10


@pytest.mark.slow
def test_what_is_learnt_keeps_the_pose_consistent_and_a_window_that_learns_nothing_is_far_off() -> None:
    """Of five trials at two frames the mean NEES has a deviation of about 1.3."""
    scene = Scene(frames=21, track_length=8, std_px=0.15, round_off=False, autocorrelation=RHO)
    job = Job(lambda seed: calibration.measure(seed, scene, True, (15, 20)))
    trials = Study(lambda: {"": job}, lambda measured: measured[""]).run(5, seed=1).report
    found = {label: np.mean(of["nees_pose"]) for label, of in trials.items() if label != "bound"}
    assert 2 < found["cross-frame"] < 9  # 3.5 over 100 trials
    assert found["errors as white"] > found["cross-frame"]
    assert found["rig as exact, errors as white"] > 100 and found["rig as exact"] > 100  # 5500 and 2000
