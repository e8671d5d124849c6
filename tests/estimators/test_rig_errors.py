"""A calibration that is wrong, or exact: what the window finds about it, and what its covariances are worth then."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.camera.refinement import TERMS
from stream_sfm.config import Config, RigConfig
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.cross_frame import rig_knowledge
from stream_sfm.estimators.cross_frame.rig_knowledge import RigKnowledge, followed_by_most
from stream_sfm.frontend.rig_effects import RigEffects
from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import Scene, Sequence
from stream_sfm.types import Observations, RigEstimate, Solution

STD_PX = 0.15
TRIALS = 12
SCENE = Scene(frames=26, track_length=13, visible=90, std_px=STD_PX, round_off=False)


M = len(TERMS)
# σ; errors of the lenses of several pixels are not linear in what is seen
TYPICAL = np.array([1.0] * 6 + [0.15] * (M - 7) + [1.0])


def with_errors(sequence: Sequence, errors: np.ndarray) -> list[Observations]:
    """Observations that a rig with such errors (m,), in units of their σ, makes of the scene."""
    model = RigEffects(sequence.projection, RigConfig(), None)
    return [replace(o, z_px=o.z_px + model.of(o.z_px) @ errors) for o in sequence.observations]


def run(sequence: Sequence, observations: list[Observations], exact: bool = False) -> Solution:
    """The last solution."""
    model = RigEffects(sequence.projection, RigConfig(exact=exact), None)
    estimator = make_estimator("cross-frame", sequence.projection, Config())
    for o in observations:
        solution = estimator.step(replace(o, rig_effects=model.of(o.z_px), rig_effects_at=model.of))
    return solution


def nees(solution: Solution, sequence: Sequence) -> float:
    error = se3.log(se3.inverse(solution.world_from_cam) @ sequence.world_from_cam[-1])
    return float(error @ np.linalg.solve(solution.cov_pose, error))


def trials(errors: bool) -> list[tuple[Sequence, list[Observations], np.ndarray]]:
    result = []
    for seed in range(TRIALS):
        sequence = SCENE.sequence(np.random.SeedSequence(seed))
        true = TYPICAL * np.random.default_rng(seed).normal(size=M) if errors else np.zeros(M)
        result.append((sequence, with_errors(sequence, true), true))
    return result


def test_a_wrong_calibration_is_found_as_well_as_claimed_and_the_pose_stays_consistent() -> None:
    """σ of the errors found and of the last pose is right to a factor of 1.4; a window that takes the calibration for
    exact claims 4 to 50 times too much."""
    of_rig, of_pose, blind = [], [], []
    for sequence, observations, true in trials(errors=True):
        solution = run(sequence, observations)
        assert isinstance(solution.rig, RigEstimate) and solution.rig.applied
        away = solution.rig.mean - true
        of_rig.append(away @ np.linalg.solve(solution.rig.cov, away))
        of_pose.append(nees(solution, sequence))
        blind.append(nees(run(sequence, observations, exact=True), sequence))
    assert 0.7 < np.sqrt(np.mean(of_rig) / M) < 1.4
    assert 0.7 < np.sqrt(np.mean(of_pose) / 6) < 1.4
    assert np.sqrt(np.min(blind) / 6) > 4


def judged(*frames: tuple[float, float]) -> RigKnowledge:
    """What is known after frames with a χ² at so many standard deviations, and most tracks following so far."""
    rig = RigKnowledge.unknown(M)
    for significance, followed in frames:
        length = np.sqrt(M * (1 - 2 / (9 * M) + significance * np.sqrt(2 / (9 * M))) ** 3)
        offset = np.full(M, length / np.sqrt(M))
        assert rig.significance(offset) == pytest.approx(significance)
        rig = rig.judge(offset, lambda followed=followed: followed)
    return rig


def test_errors_are_estimated_where_two_frames_in_a_row_find_them_significant() -> None:
    """The views of one frame alone may all be wrong; the next one takes those out that contradict the rest."""
    assert not judged((9, 1)).estimated
    assert not judged((9, 1), (1, 1), (9, 1)).estimated
    assert judged((9, 1), (9, 1)).estimated and judged((9, 1), (9, 1), (1, 1)).estimated


def test_errors_that_most_tracks_do_not_follow_are_disputed_unless_there_is_no_doubt() -> None:
    assert not judged((9, 1), (9, 0.4)).estimated and not judged((9, 0.4), (9, 1)).estimated
    assert judged((20, 0), (20, 0)).estimated
    assert rig_knowledge.disputed(judged((9, 0.4), (9, 0.4)))
    for frames in [((9, 0.4),), ((9, 0.4), (1, 1), (9, 0.4)), ((9, 0.4), (9, 0.4), (9, 1))]:
        assert not rig_knowledge.disputed(judged(*frames))  # in one frame alone it may be noise


def test_a_chi2_is_counted_in_standard_deviations() -> None:
    rng = np.random.default_rng(0)
    values = [RigKnowledge.unknown(M).significance(x) for x in rng.normal(size=(4000, M))]
    assert np.mean(values) == pytest.approx(0, abs=4 / np.sqrt(4000))
    assert np.std(values) == pytest.approx(1, abs=4 / np.sqrt(8000))


def test_how_far_most_tracks_go_does_not_depend_on_how_far_the_others_do() -> None:
    """Views with unit noise, of which two fifths go the other way. A median's σ is 1.25 of a mean's."""
    rng, tracks, each = np.random.default_rng(0), 400, 5
    track = np.repeat(np.arange(tracks), each)
    change = rng.normal(size=(len(track), 4)) * rng.uniform(0, 1, tracks)[track, None]
    noise = rng.normal(size=change.shape)
    most = track >= 0.4 * tracks
    alone = followed_by_most(track[most], 0.8 * change[most] + noise[most], change[most])
    assert abs(alone - 0.8) < 4 * 1.25 / np.sqrt((change[most] ** 2).sum())
    together = [
        followed_by_most(track, np.where(most, 0.8, others)[:, None] * change + noise, change)
        for others in (-5, -500)
    ]
    assert together[0] == together[1]
    assert 0 < together[0] < alone  # the lowest sixth of what the majority does
    assert followed_by_most(track, change, np.zeros_like(change)) == 0


def with_body(sequence: Sequence, velocity: list[float]) -> list[Observations]:
    """Observations of a scene of which a quarter of the points, side by side, move together (3,) m a frame."""
    p, points, result = sequence.projection, sequence.points_in_world, []
    body = points[:, 0] < np.quantile(points[:, 0], 0.25)
    for n, o in enumerate(sequence.observations):
        cam_from_world, here = se3.inverse(sequence.world_from_cam[n]), points[o.track_ids]
        moved = here + n * np.array(velocity) * body[o.track_ids, None]
        views = [p.project(se3.transform(cam_from_world, x)) for x in (moved, here)]
        result.append(replace(o, z_px=o.z_px + views[0] - views[1]))
    return result


def test_a_body_that_moves_is_not_taken_for_an_error_of_the_rig(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slowly enough to pass every gate, from the first frame on. Without a majority's say it is taken for one."""
    scene = Scene(frames=14, track_length=30, visible=120, std_px=0.05, round_off=False)
    for seed in range(3):
        sequence = scene.sequence(np.random.SeedSequence(seed))
        observations = with_body(sequence, [0, 0, -0.002])
        taken = run(sequence, observations).rig
        assert taken is not None and not taken.applied
        with monkeypatch.context() as patch:
            patch.setattr(rig_knowledge, "_FOLLOWED", -np.inf)
            taken = run(sequence, observations).rig
        assert taken is not None and taken.applied


@pytest.mark.slow
def test_noise_of_the_views_is_not_taken_for_an_error_of_the_rig() -> None:
    """Effects are those at fitted positions: at measured ones noise adds up, to 1.1 σ of what hardly shows here."""
    scene, count = Scene(frames=26, track_length=8, std_px=STD_PX, round_off=False), 25
    away = []
    for seed in range(count):
        sequence = scene.sequence(np.random.SeedSequence(seed))
        true = TYPICAL * np.random.default_rng(seed).normal(size=M)
        rig = run(sequence, with_errors(sequence, true)).rig
        assert rig is not None
        away.append((rig.mean - true) / np.sqrt(np.diag(rig.cov)))
    terms = [TERMS.index("1"), TERMS.index("xx"), TERMS.index("radial 5")]
    assert (np.abs(np.mean(away, axis=0)[terms]) < 3 / np.sqrt(count)).all()


def test_an_exact_calibration_is_not_harmed() -> None:
    """Errors that are only considered move no estimate, and their σ counts in the covariance."""
    for sequence, observations, _ in trials(errors=False)[:4]:
        considered, exact = run(sequence, observations), run(sequence, observations, exact=True)
        assert considered.rig is not None and not considered.rig.applied
        assert exact.rig is None
        difference = se3.log(se3.inverse(exact.world_from_cam) @ considered.world_from_cam)
        # the robust start knows how uncertain points are, and gates a view more or less by that
        assert (np.abs(difference) < 0.1 * np.sqrt(np.diag(exact.cov_pose))).all()
        std = np.sqrt(np.diag(considered.cov_pose) / np.diag(exact.cov_pose))
        assert (std > 1).all()


@pytest.mark.parametrize("exact", [True, False])
def test_effects_of_the_errors_are_pixels_per_sigma(exact: bool) -> None:
    projection = SCENE.sequence(np.random.SeedSequence(0)).projection
    model = RigEffects(projection, RigConfig(exact=exact), None)
    p = projection
    u, v = p.width - 1.0, p.height - 1.0
    effects = model.of(np.array([[u, v, u - p.cx_left_px + p.cx_right_px, v]]))
    if exact:
        assert effects.shape == (1, 4, 0)
        return
    assert effects[0, 2, :6] == pytest.approx(RigConfig().std_disparity_px)  # in the corner every term is one
    assert (effects[0, [0, 1, 3], :6] == 0).all()
    assert (effects[0, 3] == effects[0, 1]).all()  # rows are measured, and the right one is corrected by that
    far = np.array([0.0, 0.0, 0.0, 0.0])
    corners = np.array([[0, 0], [u, 0], [0, v], [u, v]]) - (p.cx_left_px, p.cy_px)
    far[:2] = corners[np.linalg.norm(corners, axis=1).argmax()] + (p.cx_left_px, p.cy_px)
    radial = np.linalg.norm(model.of(far[None])[0, :2, 6])
    assert radial == pytest.approx(RigConfig().std_lens_px, rel=0.02)


def test_an_error_of_both_principal_points_is_axes_that_are_turned_and_the_term_for_the_rest() -> None:
    """Principal points that are off by δ make the views of a camera that is turned by δ/f, plus δ times the term."""
    p = SCENE.sequence(np.random.SeedSequence(0)).projection
    config, delta = RigConfig(), 0.01
    per_px = RigEffects(p, config, None)
    rng = np.random.default_rng(3)
    points = np.stack([rng.uniform(-1, 1, 50), rng.uniform(-0.7, 0.7, 50), rng.uniform(2, 6, 50)], axis=1)
    for axis, term in ((1, "centre x"), (0, "centre y")):
        shift = delta * np.array([axis == 1, axis == 0] * 2, float)
        turn = np.zeros(6)
        turn[3 + axis] = (delta if axis == 1 else -delta) / p.f_px
        turned = p.project(se3.transform(se3.exp(turn), points))
        effects = per_px.of(p.project(points))[:, :, TERMS.index(term)] / config.std_lens_px
        left = p.project(points) + shift - turned - delta * effects
        assert np.abs(left[:, :3]).max() < 1e-2 * np.abs(delta * effects).max()


def test_the_error_of_the_disparity_over_the_image_has_the_sigma_of_its_terms() -> None:
    p = SCENE.sequence(np.random.SeedSequence(0)).projection
    model = RigEffects(p, RigConfig(), None)
    corner = np.array([[p.width - 1.0, p.height - 1.0]])
    mean, cov = np.zeros(M), np.zeros((M, M))
    mean[:2], cov[0, 0], cov[1, 1], cov[0, 1], cov[1, 0] = (0.2, 0.3), 0.04, 0.09, 0.02, 0.02
    error_px, std_px = model.disparity(RigEstimate(mean, cov, True), np.repeat(corner, 2, axis=0) * [[1], [0]])
    assert error_px == pytest.approx([-0.5, 0.1])  # right views further right: less disparity
    assert std_px == pytest.approx(np.sqrt([0.17, 0.09]))
