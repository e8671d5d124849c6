"""Laws of the trajectory metrics, and evo as a second opinion."""

from types import SimpleNamespace

import numpy as np
import pytest

from stream_sfm.evaluation import trajectory as metrics
from stream_sfm.evaluation.association import matched
from stream_sfm.evaluation.summary import evaluate
from stream_sfm.geometry import se3
from stream_sfm.types import Trajectory


def winding_path(n: int = 120, step_m: float = 0.5, seed: int = 0) -> np.ndarray:
    """World-from-camera poses (n, 4, 4) of a drive with turns, starting anywhere."""
    rng = np.random.default_rng(seed)
    turns = np.zeros((n - 1, 6))
    turns[:, 2] = step_m
    turns[:, 3:] = 0.03 * np.sin(np.arange(n - 1)[:, None] / 15 + np.array([0.3, 1.0, 2.0]))
    poses = [se3.exp(rng.normal(size=6))]
    for xi in turns:
        poses.append(poses[-1] @ se3.exp(xi))
    return np.array(poses)


def disturbed(poses: np.ndarray, sigma: float, seed: int = 1) -> np.ndarray:
    return poses @ se3.exp(np.random.default_rng(seed).normal(scale=sigma, size=(len(poses), 6)))


def trajectory(poses: np.ndarray, cov: np.ndarray | None = None) -> Trajectory:
    return Trajectory(np.arange(len(poses), dtype=np.int64) * 100_000_000 + 17, poses, cov)


def test_a_perfect_trajectory_has_no_error_in_any_world():
    truth = winding_path()
    estimate = se3.inverse(truth[0]) @ truth
    cov = np.tile(np.eye(6) * 1e-4, (len(truth), 1, 1))
    cov[0] = 0
    figures = evaluate(trajectory(estimate, cov), trajectory(truth))
    assert max(figures.pop("ate_axes_m")) < 1e-9
    assert figures.pop("frames_compared") == len(truth) and figures.pop("segment_lengths_m")
    known = {key: value for key, value in figures.items() if "_structure_" not in key}
    assert max(map(abs, known.values())) < 1e-9  # rounding
    assert set(figures) - set(known) and not any(figures[key] for key in set(figures) - set(known))


def test_components_of_the_error_are_along_the_axes_of_the_first_camera():
    """Depth is the third; the sum of their squares is that of the whole error."""
    truth = winding_path()
    estimate = truth.copy()
    estimate[1:] = truth[0] @ se3.exp([0, 0, 0.3, 0, 0, 0]) @ se3.inverse(truth[0]) @ truth[1:]
    axes = metrics.ate_axes_m(estimate, truth)
    assert axes == pytest.approx([0, 0, 0.3 * np.sqrt(1 - 1 / len(truth))], abs=1e-12)
    moved = metrics.ate_axes_m(truth, winding_path(seed=3))
    assert np.linalg.norm(moved) == pytest.approx(metrics.ate_rmse_m(truth, winding_path(seed=3)))


def test_a_rigid_offset_vanishes_by_alignment_and_an_error_of_the_first_pose_does_not():
    truth = winding_path()
    moved = se3.exp([1.0, -2.0, 3.0, 0.4, 0.5, -0.6]) @ truth
    assert max(metrics.ate_rmse_aligned_m(moved, truth), metrics.ate_rmse_m(moved, truth)) < 1e-12
    estimate = truth.copy()
    estimate[0] = estimate[0] @ se3.exp([0, 0, 0, 0.05, 0, 0])
    assert metrics.ate_rmse_aligned_m(estimate, truth) < 1e-9
    assert metrics.ate_rmse_m(estimate, truth) > 0.1  # 0.05 rad at 60 m


@pytest.mark.parametrize("scale", [0.9, 1.04])
def test_a_known_scale_is_found_and_never_aligned_away(scale: float):
    truth = winding_path()
    estimate = truth.copy()
    estimate[:, :3, 3] *= scale
    assert metrics.scale_error_percent(estimate, truth) == pytest.approx(100 * (scale - 1), abs=1e-9)
    assert metrics.ate_rmse_aligned_m(estimate, truth) > 0.1  # a few per cent of a path of 60 m
    chord = np.linalg.norm(truth[-1, :3, 3] - truth[0, :3, 3]) / metrics.path_length_m(truth)
    assert metrics.final_drift_percent(estimate, truth) == pytest.approx(100 * abs(scale - 1) * chord)


def test_segments_of_a_scaled_straight_line_are_off_by_the_scale():
    truth = np.tile(np.eye(4), (300, 1, 1))
    truth[:, 2, 3] = np.arange(300)
    estimate = truth.copy()
    estimate[:, :3, 3] *= 1.02
    found = metrics.segment_errors(estimate, truth)
    assert found.lengths_m == (100.0, 200.0)
    # the first frame beyond 100 m is at 101 m, the one beyond 200 m at 201 m; ten and twenty starts
    starts = {100: len(range(0, 300 - 101, 10)), 200: len(range(0, 300 - 201, 10))}
    expected = sum(2.0 * (length + 1) / length * n for length, n in starts.items()) / sum(starts.values())
    assert found.t_rel_percent == pytest.approx(expected)
    assert found.r_rel_deg_per_100m == pytest.approx(0, abs=1e-9)  # rounding


def test_truth_is_interpolated_at_the_stamps_of_the_estimate():
    xi = np.array([0.3, 0.1, 2.0, 0.05, 0.2, -0.1])  # a constant twist: interpolation is exact
    fine = np.arange(0, 2_000_000_000, 50_000_000)
    truth = Trajectory(fine, se3.exp(xi * fine[:, None] * 1e-9))
    stamps = np.array([-1, 0, 12_345_678, 50_000_000, 1_234_567_891, 1_950_000_000, 1_950_900_000, 3_000_000_000])
    estimate = Trajectory(stamps, se3.exp(xi * stamps[:, None] * 1e-9))
    rows, true = matched(estimate, truth)
    assert rows.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert np.allclose(true.world_from_cam[1:6], estimate.world_from_cam[1:6], atol=1e-12)
    assert (true.stamps_ns == stamps[rows]).all()


def test_sparse_truth_is_not_interpolated():
    truth, estimate = (Trajectory(np.arange(n) * 10**9 // (n - 1), np.tile(np.eye(4), (n, 1, 1))) for n in (2, 3))
    assert matched(estimate, truth)[0].tolist() == [0, 2]


@pytest.mark.parametrize("n", [0, 1, 2])
def test_hardly_any_truth_gives_figures_without_values(n: int):
    figures = evaluate(trajectory(winding_path(5)), trajectory(winding_path(5)[:n]))
    assert figures["frames_compared"] == n
    assert (figures["ate_rmse_m"] is None) == (n < 2)


def test_standing_still_defines_no_percentages():
    still = np.tile(np.eye(4), (50, 1, 1))
    figures = evaluate(trajectory(disturbed(still, 1e-3)), trajectory(still))
    undefined = ("final_drift_percent", "scale_error_percent", "t_rel_percent")
    assert [figures[name] for name in undefined] == [None] * 3 and figures["ate_rmse_aligned_m"] > 0


def test_nees_of_errors_drawn_from_the_covariance_is_six():
    rng = np.random.default_rng(5)
    truth = winding_path(2000)
    half = rng.normal(size=(6, 6)) * np.array([[0.1], [0.1], [0.1], [1e-3], [1e-3], [1e-3]])
    cov = np.tile(half @ half.T, (len(truth), 1, 1))
    cov[0] = 0
    noise = rng.normal(size=(len(truth), 6)) @ half.T
    noise[0] = 0
    estimate = truth @ se3.exp(-noise)  # truth = estimate·Exp(noise)
    standard_error = np.sqrt(2 * 6 / 2000)
    assert np.nanmean(metrics.nees_pose(estimate, cov, truth)) == pytest.approx(6, abs=4 * standard_error)
    assert np.isnan(metrics.nees_pose(estimate, cov, truth)[0])


def test_the_truth_may_have_errors_of_its_own():
    """Each pose of the truth errs, the first one too, whose error moves with the path; σ in m and rad."""
    rng, truth, std = np.random.default_rng(3), winding_path(40), (0.01, 0.004)
    cov = np.diag(np.repeat((0.02, 0.001), 3) ** 2)
    found = []
    for _ in range(200):
        path = metrics.from_first_camera(truth)
        estimate = path @ se3.exp(rng.normal(size=(40, 6)) * np.sqrt(np.diag(cov)))
        estimate[0] = np.eye(4)
        covs = np.broadcast_to(cov, (40, 6, 6)) * (np.arange(40) > 0)[:, None, None]
        wrong = truth @ se3.exp(rng.normal(size=(40, 6)) * np.repeat(std, 3))
        nees = metrics.nees_pose(estimate, covs, wrong, std)
        assert np.isnan(nees[0])
        found.append(nees[1:].mean())
        assert metrics.nees_pose(estimate, covs, wrong)[1:].mean() > 20  # taken as exact
    # the first pose's error is common to a path: 3 of the means' own standard errors, and 2 % as errors are not small
    assert abs(np.mean(found) - 6) < 3 * np.std(found) / np.sqrt(200) + 0.12


def test_nees_of_a_false_covariance_is_not_a_plausible_number():
    poses = winding_path(4)
    cov = np.zeros((4, 6, 6))
    cov[1] = np.diag([1, 1, 1, 1, 1, -1.0])
    cov[2] = np.full((6, 6), np.nan)
    cov[3] = np.eye(6) - 0.5  # indefinite
    values = metrics.nees_pose(poses, cov, poses)
    assert np.isnan(values[[0, 2]]).all() and np.isinf(values[[1, 3]]).all()


def test_umeyama_of_points_on_a_line_and_in_a_place():
    line = np.outer(np.arange(5.0), [1, 2, 2])
    _, pose = metrics.umeyama(line @ se3.exp_so3([0.1, 0.2, 0.3]).T, line)
    assert np.isclose(np.linalg.det(pose[:3, :3]), 1)
    assert metrics.ate_rmse_aligned_m(winding_path(1), winding_path(1, seed=3)) < 1e-12


@pytest.fixture
def evo() -> SimpleNamespace:
    """evo as a second opinion, and two paths to compare."""
    pytest.importorskip("evo")
    from evo.core import metrics, trajectory

    truth = winding_path(150, step_m=0.2)
    estimate = disturbed(truth, 0.01)
    return SimpleNamespace(m=metrics, path=lambda p: trajectory.PosePath3D(poses_se3=list(p)), t=truth, e=estimate)


def test_ate_and_scale_are_those_of_evo(evo: SimpleNamespace):
    for align, ours in (("align", metrics.ate_rmse_aligned_m), ("align_origin", metrics.ate_rmse_m)):
        metric, estimate = evo.m.APE(evo.m.PoseRelation.translation_part), evo.path(evo.e)
        getattr(estimate, align)(evo.path(evo.t))
        metric.process_data((evo.path(evo.t), estimate))
        assert ours(evo.e, evo.t) == pytest.approx(metric.get_statistic(evo.m.StatisticsType.rmse), rel=1e-9)
    _, _, scale = evo.path(evo.e).align(evo.path(evo.t), correct_scale=True)
    assert metrics.scale_error_percent(evo.e, evo.t) == pytest.approx(100 * (1 / scale - 1), rel=1e-9)


def test_errors_of_segments_are_those_of_evo(evo: SimpleNamespace):
    """A path of 30 m has segments of 10 and of 20 m, one of each from every frame that is far enough from the end."""
    found, along = metrics.segment_errors(evo.e, evo.t), metrics.distances_m(evo.t)
    pairs = [
        (i, int(np.argmax(along > along[i] + length)), length)
        for length in found.lengths_m
        for i in range(150)
        if (along > along[i] + length).any()
    ]
    for relation, ours, tolerance in (
        (evo.m.PoseRelation.translation_part, found.t_rel_percent, 1e-9),
        (evo.m.PoseRelation.rotation_angle_rad, np.radians(found.r_rel_deg_per_100m), 1e-6),
    ):
        values = []
        for first, last, length in pairs:
            rpe = evo.m.RPE(relation, delta=1, delta_unit=evo.m.Unit.frames)
            rpe.process_data((evo.path(evo.t[[first, last]]), evo.path(evo.e[[first, last]])))
            values.append(rpe.error[0] / length)
        assert ours == pytest.approx(100 * np.mean(values), rel=tolerance)
