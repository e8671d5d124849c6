"""The lasting errors of templates: their statistics, the consistency of estimates with them, and depth edges."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.core import view_inflation
from stream_sfm.estimators import make_estimator
from stream_sfm.frontend.learnt.template_errors import TemplateErrors
from stream_sfm.frontend.rules import ErrorRules
from stream_sfm.simulation.scenes import Scene, Sequence
from stream_sfm.types import LastingErrors, StereoFrame
from tests.helpers.estimators import nees
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.wall import Wall, rig

STD_PX, FRAMES = 0.2, 60
DECAY = 0.92


def lasting(rng: np.random.Generator, shape: tuple[int, ...], variance: float, decay: float = DECAY) -> np.ndarray:
    """A Gauss-Markov process along the first axis."""
    values = rng.normal(size=shape)
    for n in range(1, shape[0]):
        values[n] = decay * values[n - 1] + np.sqrt(1 - decay**2) * values[n]
    return np.sqrt(variance) * values


@pytest.mark.parametrize("ratio", [0.0, 0.3, 4.0])
def test_information_adds_up_to_that_about_a_constant(ratio: float) -> None:
    """The reference is the dense covariance of the views of a track."""
    n = np.arange(60)
    cov = np.eye(60) + ratio * DECAY ** np.abs(n[:, None] - n)
    total = [np.ones(k) @ np.linalg.solve(cov[:k, :k], np.ones(k)) for k in n + 1]
    for side, ratios in ((0, (ratio, 0.0)), (1, (0.0, ratio))):
        found = view_inflation(n, *ratios, DECAY, ErrorRules())[:, side]
        assert np.cumsum(1 / found) == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize(("white", "ratio", "decay"), [(1.0, 0.0, DECAY), (1.0, 0.7, DECAY), (0.3, 1.0, 0.8)])
def test_parts_and_decay_are_learnt_from_rows(white: float, ratio: float, decay: float) -> None:
    """The white noise and the lasting part have variances in units of the assumed one."""
    rng = np.random.default_rng(3)
    tracks, frames = 150, 4 * FRAMES
    errors, ids = TemplateErrors(), np.arange(tracks)
    # the variance of left and right together
    slow = lasting(rng, (frames, tracks), (1 + ErrorRules().left_fraction) * ratio * STD_PX**2, decay)
    cov = np.broadcast_to(STD_PX**2 * np.eye(4), (tracks, 4, 4))
    for n in range(frames):
        z = np.sqrt(white) * rng.normal(size=(tracks, 4)) * STD_PX
        z[:, 1] += slow[n] + 0.3  # a row offset of the whole frame is not an error of tracks
        errors = errors.after(ids, z, cov)
    found_white, found_ratio = errors.parts
    # products are correlated over 1/(1 - decay) frames; the limit of three deviations costs a few per cent
    standard_error = np.sqrt(2 / (tracks * frames * (1 - decay))) * (white + ratio) + 0.02 * (white + ratio)
    assert abs(found_ratio - ratio) < 3 * standard_error
    assert abs(found_white - white) < 3 * standard_error
    if ratio:
        assert abs(errors.decay - decay) < 0.02
    assert (errors.inflation[:, 1] >= errors.inflation[:, 0]).all()


def with_lasting_errors(sequence: Sequence, ratio: float, rng: np.random.Generator) -> list:
    """Observations with a lasting part on top of their white noise."""
    slow = lasting(rng, (len(sequence.observations), len(sequence.points_in_world), 4), ratio * STD_PX**2)
    slow[..., :2] *= np.sqrt(ErrorRules().left_fraction)
    return [replace(o, z_px=o.z_px + slow[o.frame_index, o.track_ids]) for o in sequence.observations]


def nees_of_short_motions(observations: list, sequence: Sequence, learnt: bool) -> float:
    """Mean NEES of the newest pose relative to the first one."""
    estimator, errors = make_estimator("cross-frame", sequence.projection, Config()), TemplateErrors()
    values = []
    for o in observations:
        errors = errors.after(o.track_ids, o.z_px, o.cov_px)
        solution = estimator.step(replace(o, lasting=LastingErrors(None, errors.inflation if learnt else None)))
        if o.frame_index >= 8:
            values.append(nees(solution.world_from_cam, solution.cov_pose, sequence.world_from_cam[o.frame_index]))
    return float(np.mean(values))


def test_covariances_hold_with_lasting_errors() -> None:
    """With white noise the NEES of the pose is wrong by more than a factor of two; with the learnt errors it is 6."""
    scene = Scene(frames=24, track_length=16, visible=80, std_px=STD_PX, round_off=False)
    white, learnt = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        sequence = scene.sequence(np.random.SeedSequence(seed))
        observations = with_lasting_errors(sequence, 2.0, rng)
        white.append(nees_of_short_motions(observations, sequence, learnt=False))
        learnt.append(nees_of_short_motions(observations, sequence, learnt=True))
    error = np.std(learnt) / np.sqrt(len(learnt))

    assert np.mean(white) > 12
    assert 3 < np.mean(learnt) < 6 + 3 * error


def test_points_across_a_depth_edge_have_larger_errors() -> None:
    """The wall is nearer by 6 px of disparity in the right half of the left image."""
    stereo = rig()
    left, right = Wall(7).frame(stereo, np.eye(4), 0).images
    edge = left.shape[1] // 2
    nearer = np.roll(right, -6, axis=1)
    split = right.copy()
    split[:, edge - 30 :] = nearer[:, edge - 30 :]  # the edge is about there in the right image
    std_px = {}
    for name, image in (("wall", right), ("edge", split)):
        front = SteppedFrontEnd(stereo)
        seen = front.step(StereoFrame(0, left, image))
        near_edge = np.abs(seen.z_px[:, 2] - (edge - 30)) < 9
        std_px[name] = np.median(front.state.errors.std_disparity_px(seen.track_ids)[near_edge])
    assert std_px["edge"] > 1.5 * std_px["wall"]


def test_unknown_points_have_the_least_error_and_memory_is_bounded() -> None:
    errors = TemplateErrors()
    assert (errors.std_disparity_px(np.arange(3)) == ErrorRules().std_shared_px).all()
    assert errors.std_disparity_px(np.empty(0, np.int64)).shape == (0,)
    for start in range(0, 50_000, 1000):
        ids = np.arange(start, start + 1000)
        errors = errors.with_new(ids, np.full(1000, 0.3))
        assert errors.std_disparity_px(ids) == pytest.approx(np.hypot(ErrorRules().std_shared_px, 0.3))
    assert len(errors.begun) == len(errors.stds_px) < 30_000  # the latest ones
    assert errors.std_disparity_px(errors.begun[:1])[0] > 0.3
    assert errors.std_disparity_px(errors.begun[:1] - 1)[0] == ErrorRules().std_shared_px
