"""Relative motions: their covariance against the scatter of many trials, over every span of the window."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.config import Config
from stream_sfm.estimators.window.reported.rules import ReportedRules
from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import Scene
from tests.helpers.estimators import nees, run

SCENE = Scene(frames=20, track_length=8, visible=60, std_px=0.2, round_off=False)
TRIALS = 24


def test_covariances_of_relative_motions_are_those_of_their_errors() -> None:
    """NEES over each span is 6, within three standard errors of a mean of χ²₆, as trials are independent."""
    by_span: dict[int, list[float]] = {}
    for seed in range(TRIALS):
        sequence = SCENE.sequence(np.random.SeedSequence(seed))
        solution = run("cross-frame", sequence.projection, sequence.observations)[-1]
        relative, newest = solution.relative, len(sequence.observations) - 1
        assert relative is not None
        assert relative.frame_indices.tolist() == list(range(newest - 8, newest))
        world_from_newest = sequence.world_from_cam[newest]
        for index, pose, cov in zip(relative.frame_indices, relative.frame_from_newest, relative.cov, strict=True):
            true = se3.inverse(sequence.world_from_cam[index]) @ world_from_newest
            by_span.setdefault(newest - int(index), []).append(nees(pose, cov, true))
        window = dict(zip(solution.window_frame_indices.tolist(), solution.window_world_from_cam, strict=True))
        again = se3.inverse(window[newest - 3]) @ window[newest]
        assert np.abs(again - relative.frame_from_newest[-3]).max() < 1e-9
    for span, values in by_span.items():
        assert abs(np.mean(values) - 6) < 3 * np.sqrt(12 / TRIALS), span


def test_apparent_rotations_by_patches_add_up_in_the_pose_and_not_in_relative_motions() -> None:
    """Eqs. (17a), (17b): estimates do not change; a rotation in frame k moves all later cameras about its position."""
    sequence, std_rad = SCENE.sequence(np.random.SeedSequence(3)), 1e-3
    told = [replace(o, lasting=replace(o.lasting, std_turn_rad=std_rad)) for o in sequence.observations]
    before = run("cross-frame", sequence.projection, sequence.observations)[-1]
    after = run("cross-frame", sequence.projection, told)[-1]
    assert before.relative is not None and after.relative is not None
    assert after.relative.frame_from_newest == pytest.approx(before.relative.frame_from_newest, abs=1e-6)
    lag = se3.log(se3.inverse(before.world_from_cam) @ after.world_from_cam)  # by more where σ is larger
    assert lag @ np.linalg.solve(before.cov_pose, lag) < Config().rules.of(ReportedRules).most_followed ** 2
    # the first camera is the world: the turns of all frames after it
    cams_from_newest = se3.inverse(sequence.world_from_cam[1:]) @ sequence.world_from_cam[-1]
    turned = std_rad * se3.adjoint(se3.inverse(cams_from_newest))[:, :, 3:]
    each = turned @ np.swapaxes(turned, 1, 2)
    added = after.cov_pose - before.cov_pose
    assert np.abs(added - each.sum(axis=0)).max() < 0.02 * np.abs(added).max()  # estimated poses are off by that
    for r, index in enumerate(after.relative.frame_indices.tolist()):
        since = after.relative.cov[r] - before.relative.cov[r]
        share = Config().rules.of(ReportedRules).apparent_turns
        assert np.abs(since - share * each[index:].mean(axis=0)).max() < 0.02 * np.abs(since).max()


def test_motions_of_a_window_are_those_of_the_plain_formulas() -> None:
    """Eqs. (17b) and (74) with NumPy: motions, their covariances by span, and by the rig's errors."""
    rng, frames, n, m = np.random.default_rng(8), 4, 30, 3
    cams, trues = se3.exp(0.3 * rng.normal(size=(2, frames, 6)))
    root, by_rig = rng.normal(size=(6 * frames, n)), rng.normal(size=(6 * frames, m))
    cov_rig, by_span, turns = (
        np.diag([0.5, 1.0, 2.0]),
        np.array([1.0, 1.5, 1.6, 2.0, 3.0]),
        np.array([0.1, 0.0, 0.2, 0.3]),
    )
    found = core.window_motions(cams, trues, root, by_rig, cov_rig, by_span, np.array([24, 28]), turns, 0.25)
    for r in range(frames):
        cam = np.eye(4) if r == 0 else trues[r - 1]
        motion = cam @ se3.inverse(trues[-1])
        assert found[0][r] == pytest.approx(motion, abs=1e-12)
        j = np.zeros((6, 6 * frames))
        if r:
            j[:, 6 * r - 6 : 6 * r] = se3.adjoint(se3.inverse(motion))
        j[:, -6:] -= np.eye(6)
        factor = by_span[frames - 1 - r]
        scaled = root * np.repeat([factor / by_span[-1], factor, 1.0], [24, 4, 2])
        expected = j @ (scaled @ scaled.T + by_rig @ cov_rig @ by_rig.T) @ j.T
        for k in range(r, frames):
            turned = turns[k] * se3.adjoint(cams[-1] @ se3.inverse(cams[k]))[:, 3:]
            expected += 0.25 / (frames - r) * turned @ turned.T
        assert found[1][r] == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert found[2][r] == pytest.approx(j @ by_rig, abs=1e-12)
