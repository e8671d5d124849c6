"""A chain of motions is complete or says where it is not: losses, restarts, knocked cameras, and requested frames."""

import functools
import itertools
import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.motion import UNSEEN
from stream_sfm.types import CommonErrors, FrameEstimate, RelativeMotions, Status
from tests import test_knock
from tests.helpers.wall import camera_path
from tests.results.test_estimates import estimate

STEP = se3.exp([0.02, 0.0, 0.1, 0.0, 0.05, 0.01])
COV = np.diag(np.repeat([1e-6, 1e-8], 3))
WINDOW = 8


def frames(n: int, lost: Sequence[int] = (), restarts: Sequence[int] = (), **fields: object) -> list[FrameEstimate]:
    """Estimates of a steady motion whose windows reach over lost frames, but not over the beginning of a new map."""
    found, window = list[FrameEstimate](), list[int]()
    for k in range(n):
        pose, cov = np.linalg.matrix_power(STEP, k), COV * (1 + k) + (10.0 * k * COV if k in restarts else 0)
        one = replace(estimate(k), world_from_cam=pose, cov_pose=cov, **fields)
        if k in lost:
            found.append(replace(one, status=Status.LOST))
            continue
        if k in restarts or not window:
            window = []
            one = replace(one, status=Status.INITIALISING)
        else:
            motions = np.stack([np.linalg.matrix_power(STEP, k - i) for i in window])
            spans = np.array([k - i for i in window])[:, None, None]
            one = replace(one, relative=RelativeMotions(np.array(window), motions, spans * COV))
        found.append(one)
        window = [*window, k][-WINDOW:]
    return found


def ends(motions: list[sfm.Motion]) -> list[tuple[int | None, int | None]]:
    return [(motion.earlier, motion.newest) for motion in motions]


def test_motions_with_a_gap_between_them_are_not_added_up() -> None:
    estimates = frames(30, lost=range(10, 14))
    first, second = sfm.Motion.of(estimates[9], 8), sfm.Motion.of(estimates[22], 8)
    assert first is not None and second is not None and ends([first, second]) == [(1, 9), (14, 22)]
    with pytest.raises(sfm.ConfigError, match=r"ends at frame 9, and the next one begins at frame 14: .* sfm\.chain"):
        first.then(second)
    over = sfm.Motion.of(estimates[14], 5)
    assert over is not None
    whole = first.then(over).then(second)
    assert ends([whole, whole.back()]) == [(1, 22), (22, 1)]
    assert np.allclose(whole.earlier_from_newest, np.linalg.matrix_power(STEP, 21), atol=1e-12)


def test_a_chain_crosses_a_loss_where_the_window_does_and_ends_where_it_is_asked_to(
    caplog: pytest.LogCaptureFixture,
) -> None:
    estimates, wanted = frames(60, lost=range(20, 30)), [5, 25, 41, 42, 77]
    motions = sfm.chain(estimates, to=wanted)
    at = [motion.newest for motion in motions]
    assert motions[0].earlier == 0 and at[-1] == 59
    assert all(one.newest == next_one.earlier for one, next_one in itertools.pairwise(motions))
    assert {5, 41, 42} <= set(at) and not any(motion.predicted for motion in motions)  # 25 is lost, 77 is not there
    assert all(one.newest - one.earlier <= WINDOW for one in motions if not one.earlier < 20 < one.newest)
    assert len(sfm.chain(estimates)) == 7  # 10 lost frames are crossed in one step, the others by eights
    whole = functools.reduce(sfm.Motion.then, sfm.chain(estimates))
    assert np.allclose(whole.earlier_from_newest, estimates[-1].world_from_cam, atol=1e-12)
    assert not caplog.records


def test_a_gap_that_no_view_bridges_is_predicted_and_reported(caplog: pytest.LogCaptureFixture) -> None:
    """The covariance is what the engine's own has grown by, whose growth from each frame to the next is known here."""
    estimates = frames(50, lost=range(20, 40), restarts=[40])
    with caplog.at_level(logging.WARNING, "stream_sfm"):
        motions = sfm.chain(estimates)
    (jump,) = [motion for motion in motions if motion.predicted]
    assert ends([jump]) == [(19, 40)]
    assert "no view connects frame 19 with frame 40 or a later one" in caplog.text
    ad = se3.adjoint(se3.inverse(jump.earlier_from_newest))
    grown = estimates[40].cov_pose - ad @ estimates[19].cov_pose @ ad.T
    values = np.linalg.eigvalsh(jump.cov)
    assert (values > -1e-15).all() and np.linalg.eigvalsh(jump.cov - grown).min() > -1e-15
    seen = [motion for motion in motions if not motion.predicted]
    with pytest.raises(sfm.ConfigError, match="ends at frame 19, and the next one begins at frame 40"):
        functools.reduce(sfm.Motion.then, seen)
    assert functools.reduce(sfm.Motion.then, motions).predicted
    assert ends(sfm.chain(frames(30, lost=range(25, 30))))[-1] == (24, 29)  # lost at the end


def test_estimates_without_motions_or_scale_are_refused() -> None:
    for estimates in (frames(9, lost=range(1, 9)), frames(9, unscaled=True)):
        with pytest.raises(sfm.ConfigError, match="none of 9 estimates has a motion"):
            sfm.chain(estimates)
    assert sfm.chain(frames(1)) == [] == sfm.chain([])


def test_where_the_rig_changes_its_errors_are_others_and_lengths_stay_as_wrong() -> None:
    """Monte Carlo: two motions before a knock and two after it."""
    rng, trials, m = np.random.default_rng(2), 20_000, UNSEEN + 4
    jacobians = 1e-3 * rng.normal(size=(6, m)) + 1e-4 * rng.normal(size=(4, 6, m))
    unseen = rng.normal(size=(trials, UNSEEN))
    rigs = [np.concatenate([unseen, rng.normal(size=(trials, m - UNSEEN))], axis=1) for _ in range(2)]
    errors, motions = np.zeros((trials, 6)), []
    for k, j in enumerate(jacobians):
        own = rng.multivariate_normal(np.zeros(6), COV, trials)
        errors = errors @ se3.adjoint(se3.inverse(STEP)).T + rigs[k // 2] @ j.T + own
        since = 2 * (k // 2)
        common = CommonErrors(np.zeros(m), np.eye(m), np.zeros((6, m)), since)
        relative = RelativeMotions(np.array([k]), STEP[None], (COV + j @ j.T)[None], j[None])
        motion = sfm.Motion.to_frame(k, relative, common, newest=k + 1)
        assert motion is not None and motion.common_since == since
        motions.append(motion)
    cov = functools.reduce(sfm.Motion.then, motions).cov
    scale = np.sqrt(np.diag(cov))
    assert np.abs((errors.T @ errors / trials - cov) / np.outer(scale, scale)).max() < 5 * np.sqrt(2 / trials)
    one_rig = functools.reduce(sfm.Motion.then, [replace(motion, common_since=0) for motion in motions]).cov
    assert np.trace(one_rig) > 1.2 * np.trace(cov)  # so the test above can fail


def test_a_chain_over_a_knock_is_as_right_as_the_engine() -> None:
    estimates = test_knock.estimated("yaw")
    motions, truth = sfm.chain(estimates), camera_path(len(estimates))
    assert {motion.common_since for motion in motions} == {0, test_knock.KNOCK + 3}
    whole = functools.reduce(sfm.Motion.then, motions)
    error = se3.log(se3.inverse(whole.earlier_from_newest) @ se3.inverse(truth[0]) @ truth[-1])
    assert error @ np.linalg.solve(whole.cov, error) < 22.5  # χ² of 6: 99.9 %
    assert np.trace(whole.cov[:3, :3]) < 2 * np.trace(estimates[-1].cov_pose[:3, :3])
