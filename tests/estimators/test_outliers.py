"""The effect of wrong views: the default estimator loses less than half its accuracy, and no estimator stops."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config, WindowConfig
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.window.inverse_depth import WhitenedViews
from stream_sfm.estimators.window.outliers import Rejections
from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import Scene
from stream_sfm.types import Observations, Status
from tests.helpers.estimators import window_views


def spoiled(observations: Observations, share: float, rng: np.random.Generator, anywhere: bool = False) -> Observations:
    """Return the frame with a fraction of its views displaced, or `anywhere` in both images; first views too."""
    z = observations.z_px.copy()
    bad = rng.random(len(z)) < share
    low, high = (0, 500) if anywhere else (-40, 40)
    z[bad] = rng.uniform(low, high, size=(int(bad.sum()), 4)) + (0 if anywhere else z[bad])
    z[bad, 3] = z[bad, 1]  # both rows agree: the difference of rows does not reveal them
    return replace(observations, z_px=z)


@pytest.mark.parametrize("name", ["ekf", "ekf-cv", "frame-to-frame", "cross-frame"])
def test_wrong_matches_anywhere_stop_no_estimator(name: str) -> None:
    """They produce points far beyond the scene, which a trial motion moves next to the camera plane."""
    for trial in (6, 18):  # both move a point 50 m away next to the camera plane
        sequence = Scene(track_length=8, visible=60).sequence(np.random.SeedSequence(trial))
        estimator = make_estimator(name, sequence.projection, Config())
        rng = np.random.default_rng(trial)
        for n, observations in enumerate(sequence.observations):
            solution = estimator.step(spoiled(observations, 0.15, rng, anywhere=True))
            assert solution.status != Status.LOST
            assert np.linalg.eigvalsh(solution.cov_points).min(initial=1) > 0
            error = se3.log(se3.inverse(solution.world_from_cam) @ sequence.world_from_cam[n])
            assert np.linalg.norm(error[:3]) < 0.1  # m; the steps are 0.2 m, clean errors 0.02 m at the end


@pytest.mark.parametrize(("share", "lost"), [(0.05, 0.02), (0.15, 0.06)])
def test_good_views_are_kept_beside_wrong_ones(share: float, lost: float) -> None:
    """A wrong view costs its track two views, not all later ones; a restarted point is not reported from one view.

    Three scenes of 100 tracks: the share of lost views is known to a tenth of itself.
    """
    unused, good, errors = 0, 0, []
    for trial in range(3):
        sequence = Scene(track_length=16, visible=100).sequence(np.random.SeedSequence(trial))
        estimator = make_estimator("cross-frame", sequence.projection, Config())
        rng = np.random.default_rng(trial)
        for observations in sequence.observations:
            seen = spoiled(observations, share, rng)
            solution = estimator.step(seen)
            n_old = len(seen.track_ids) - seen.n_new
            wrong = (seen.z_px != observations.z_px).any(axis=1)
            if seen.frame_index >= 5:
                rejected = np.isin(seen.track_ids, solution.rejected_ids)
                unused, good = unused + int((rejected & ~wrong)[:n_old].sum()), good + int((~wrong)[:n_old].sum())
                ids = np.intersect1d(solution.track_ids, seen.track_ids[:n_old])
                rows = np.searchsorted(solution.track_ids, ids)
                camera = se3.inverse(sequence.world_from_cam[seen.frame_index])
                e = solution.points_in_cam[rows] - se3.transform(camera, sequence.points_in_world[ids])
                errors.append(np.einsum("ni,nij,nj->n", e, np.linalg.inv(solution.cov_points[rows]), e).mean())
    assert unused / good < lost
    assert np.mean(errors) < 3.5  # 3 is expected for consistent points


def right_columns(n: int, std_px: float) -> WhitenedViews:
    """Views (n) with this σ, and a rig whose only error shifts the right sides by 1 px along their rows."""
    terms = np.zeros((n, 4, 1))
    terms[:, 2] = 1.0
    root = np.tile(np.eye(4) / std_px, (n, 1, 1))
    return window_views(np.zeros(n, np.intp), np.arange(n), np.zeros((n, 4)), root, terms)


def test_tracks_rejected_with_another_rig_are_tried_again() -> None:
    """They are once the estimate of the rig moves views by their error, in one frame or in many."""
    views, bad = right_columns(20, std_px=0.1), np.arange(5)
    rejections = Rejections(WindowConfig(), np.zeros(1))
    for step in range(1, 10):
        rejections = rejections.with_more(bad).asked_again(views, np.array([0.02 * step]))
    assert rejections.excluded(views.ids).sum() == len(bad)  # 0.18 px do not count as another rig
    rejections = rejections.asked_again(views, np.array([0.21]))
    assert not rejections.excluded(views.ids).any()
    for _ in range(6):  # tracks that still contradict the motion are excluded again
        rejections = rejections.with_more(bad[:2]).asked_again(views, np.array([0.25]))
    assert rejections.excluded(views.ids).nonzero()[0].tolist() == [0, 1]
