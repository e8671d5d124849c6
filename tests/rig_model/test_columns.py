"""Effects of rig errors on views of a moving camera: every column against differences of exactly simulated views."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.config import RigConfig
from stream_sfm.estimators.window.unknowns.exposures import ExposureClock, TwistError
from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection, velocities
from stream_sfm.rig_model.estimate import Amplitudes, RigEstimate
from stream_sfm.rig_model.field import WORTH_ESTIMATING, field_over
from stream_sfm.rig_model.model import RigModel, disparity_over_image
from stream_sfm.rig_model.terms import (
    DELAY,
    FOCAL,
    FOCUSING,
    READOUT,
    TERMS,
    TURNING,
    columns,
    prior_std,
    terms_of_turn,
)
from tests.helpers.rectified import own_rows

P = StereoProjection(600.0, 250.0, 262.0, 240.0, 0.25, 512, 480)
RNG = np.random.default_rng(3)
POINTS = np.c_[RNG.uniform(-1, 1, (60, 2)), RNG.uniform(2, 8, 60), RNG.uniform(0.2, 2, 60)]
TWIST = np.array([0.4, -0.2, 0.9, 0.3, -0.5, 0.2])  # m/s and rad/s
Z_PX = P.project_homogeneous(POINTS)
FAR_PX = np.tile(Z_PX[:, :2], 2) + np.array([0, 0, P.cx_right_px - P.cx_left_px, 0])  # the same, infinitely far
MODEL = RigModel.of(P, RigConfig())
row_of = own_rows(P)
CAMERAS = P, row_of
STEADY, MOTION = np.stack([TWIST, np.zeros(6)]), np.stack([TWIST, [3.0, 2.0, -4.0, 2.0, 3.0, -1.5]])
AT_ONCE = np.zeros(2)


def seen_at(seconds: Array, motion: Array) -> Array:
    """Views (n, 4) of points with a motion (2, 6), each coordinate after its time: (n, 4) seconds."""
    result = np.empty(Z_PX.shape)
    for k in range(4):
        t = seconds[:, k : k + 1]
        moved = se3.exp(t * motion[0] + 0.5 * t**2 * motion[1]) @ POINTS[..., None]
        result[:, k] = P.project_homogeneous(moved[..., 0])[:, k]
    return result


def per_second(times: Array, twist: Array = TWIST) -> Array:
    """The effect on views of a delay of `times` (n, 4), per second of an error of timing, by central differences."""
    step = 1e-5
    steady = np.stack([twist, np.zeros(6)])
    return (seen_at(step * times, steady) - seen_at(-step * times, steady)) / (2 * step)


LATE = np.broadcast_to([0.0, 0.0, 1.0, 0.0], Z_PX.shape)  # the effect on the right row is removed with the rows
ROWS = row_of(Z_PX)


def test_velocities_are_those_of_moving_points() -> None:
    expected = per_second(np.ones(Z_PX.shape))
    assert np.abs(velocities(P, POINTS, TWIST) - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize(("term", "times"), [(DELAY, LATE), (READOUT, ROWS)])
def test_columns_of_timing_are_views_taken_at_other_times(term: str, times: Array) -> None:
    expected = per_second(times)
    views, at = core.timed_views(*CAMERAS, POINTS, STEADY, AT_ONCE, None), [DELAY, READOUT].index(term)
    assert np.abs(views[:, :, at] - expected).max() < 1e-6 * np.abs(expected).max()


def test_views_are_as_late_as_delay_and_readout_make_them() -> None:
    """So an error of the twist moves them by their velocities under it, for that long."""
    model = replace(MODEL, row_of=row_of)
    timing_s, error, step = np.array([0.004, 0.02]), np.array([0.02, -0.01, 0.03, 0.1, -0.2, 0.05]), 1e-3
    late_s = model.late_s(Z_PX, timing_s)
    np.testing.assert_allclose(late_s, 0.004 * np.array([0, 0, 1, 1]) + 0.02 * ROWS)
    moved = (seen_at(step * late_s, np.stack([error, 0 * error])) - Z_PX) / step
    np.testing.assert_allclose(moved, late_s * velocities(P, POINTS, error), atol=1e-4 * np.abs(moved).max())
    np.testing.assert_array_equal(MODEL.late_s(Z_PX, np.array([0.0, 0.02])), np.zeros_like(Z_PX))


@pytest.mark.parametrize(("delay_s", "readout_s"), [(0.008, 0.0), (0.0, 0.02), (0.004, 0.01)])
def test_timing_is_exact_to_second_order(delay_s: float, readout_s: float) -> None:
    """A view is taken later, while its points accelerate: with half the timing, an eighth of the rest remains."""

    def left_px(share: float) -> float:
        timing = share * np.array([delay_s, readout_s])
        seconds = timing[0] * LATE + timing[1] * ROWS
        views = core.timed_views(*CAMERAS, POINTS, MOTION, timing, Z_PX)
        return float(np.abs(seen_at(seconds, MOTION) - Z_PX - views @ timing).max())

    linear = core.timed_views(*CAMERAS, POINTS, STEADY, AT_ONCE, Z_PX) @ [delay_s, readout_s]
    error_px = np.abs(seen_at(delay_s * LATE + readout_s * ROWS, MOTION) - Z_PX - linear).max()
    assert left_px(1.0) < 0.05 * error_px
    assert left_px(0.5) == pytest.approx(left_px(1.0) / 8, rel=0.2)


def test_the_focal_length_is_that_of_both_cameras() -> None:
    step = 1e-4
    longer, shorter = (replace(P, f_px=P.f_px * (1 + s)).project_homogeneous(POINTS) for s in (step, -step))
    found = columns(P, Z_PX)[:, :, TERMS.index(FOCAL)]
    assert np.abs(found - (longer - shorter) / (2 * step)).max() < 1e-6 * np.abs(found).max()


def test_errors_that_grow_are_those_of_their_age() -> None:
    """Rotations of the right camera, eq. (72d), and the focal length: current errors follow from start and rate."""
    age_s = np.linspace(0, 3, len(Z_PX))
    found = columns(P, Z_PX, age_s=age_s)
    at = [TERMS.index(term) for term in TURNING]
    assert found[:, 2, at] == pytest.approx(age_s[:, None] * core.effects_of_turn(P, Z_PX[:, 2:])[:, 0])
    focusing, focal = found[..., TERMS.index(FOCUSING)], found[..., TERMS.index(FOCAL)]
    assert focusing == pytest.approx(age_s[:, None] * focal)
    rates, cov = np.zeros(len(MODEL)), np.eye(len(MODEL))
    rates[: len(TERMS)] = np.random.default_rng(5).normal(size=len(TERMS))
    now = MODEL.in_units(RigEstimate(rates, cov, 0.9, rates, cov, np.ones(len(MODEL)), age_s=2.0))
    still = columns(P, FAR_PX) @ now.mean[: len(TERMS)]
    grown = MODEL.effects(FAR_PX, age_s=2.0) @ rates
    assert still[:, 2] == pytest.approx(grown[:, 2], abs=2e-3)  # (72d) is a polynomial


def test_without_velocities_or_rows_timing_has_no_effect_and_a_missing_side_has_no_error() -> None:
    model = RigModel.of(P, RigConfig(), row_of=row_of)
    timing = slice(TERMS.index(DELAY), TERMS.index(READOUT) + 1)
    assert not model.effects(Z_PX)[..., timing].any()
    assert not replace(model, row_of=None).by_timing(POINTS, MOTION, AT_ONCE, Z_PX).any()
    z_px = Z_PX.copy()
    z_px[0, 2:] = np.nan
    for effects in (model.effects(z_px), model.by_timing(POINTS, MOTION, AT_ONCE, z_px)):
        assert not effects[0, 2:].any() and effects[0, :2].any() and np.isfinite(effects).all()


def test_an_error_of_both_principal_points_is_a_rotation_of_the_axes_and_a_term_for_the_rest() -> None:
    """With an error δ of principal points, views are those of a camera rotated by δ/f, plus δ times the term."""
    delta, points = 0.01, POINTS[:, :3] / POINTS[:, 3:]
    for axis, term in ((1, "centre x"), (0, "centre y")):
        shift = delta * np.array([axis == 1, axis == 0] * 2, float)
        turn = np.zeros(6)
        turn[3 + axis] = (delta if axis == 1 else -delta) / P.f_px
        turned = P.project(se3.transform(se3.exp(turn), points))
        effects = columns(P, Z_PX)[:, :, TERMS.index(term)]
        left = Z_PX + shift - turned - delta * effects
        # the right row has the error of the left one, as rows are measured; δ² is a ten-thousandth
        assert np.abs(left[:, :3]).max() < 1e-2 * np.abs(delta * effects).max()


def test_a_lens_has_its_error_in_the_corner_and_the_disparity_at_the_edge() -> None:
    u, v = P.width - 1.0, P.height - 1.0
    effects = columns(P, np.array([[u, v, u, v]]))[0]
    assert effects[2, :6] == pytest.approx(1) and not effects[[0, 1, 3], :6].any()
    corner = np.array([[P.width, 0.0, P.width, 0.0]])  # the farthest from (250, 240)
    radial = columns(P, corner)[0, :2, TERMS.index("radial 3")]
    assert np.linalg.norm(radial) == pytest.approx(1, rel=1e-9)


def test_terms_of_a_rotation_shift_far_points_like_the_rotation() -> None:
    turn, far = np.array([1e-5, -2e-5, 3e-5]), np.c_[POINTS[:, :3], np.zeros(60)]
    z_px = P.project_homogeneous(far)
    turned = P.project_homogeneous(far @ se3.exp(np.r_[0, 0, 0, -turn]).T)  # points rotate the other way
    found = columns(P, z_px)[:, 2] @ terms_of_turn(P) @ turn
    assert np.abs(found - (turned - z_px)[:, 2]).max() < 1e-3 * np.abs(found).max()  # θ² is beyond the linear model


def test_a_field_has_the_covariance_of_its_process() -> None:
    """It is exp(−d²/(2ℓ²)), without the part that a grid and the leading functions on it do not have."""
    at_px = np.random.default_rng(1).uniform([0, 0], [P.width, P.height], (80, 2))
    basis = MODEL.effects(np.tile(at_px, 2))[:, :, len(TERMS) :]
    disparity, u, v = basis[:, 0] - basis[:, 2], basis[:, 0], basis[:, 1]
    assert (basis[:, 3] == v).all()
    assert not any((a @ b.T).any() for a, b in ((disparity, u), (disparity, v), (u, v)))  # three processes
    apart = np.linalg.norm(at_px[:, None] - at_px, axis=2)
    expected = np.exp(-0.5 * (apart / (0.13 * P.width)) ** 2)
    inside = ((at_px > 40) & (at_px < np.array([P.width, P.height]) - 40)).all(axis=1)
    for part in (disparity, u, v):
        off = (part @ part.T - expected)[np.ix_(inside, inside)]
        assert np.linalg.eigvalsh(off).max() < 1e-9 and -np.diag(off).mean() < 0.2


@pytest.mark.parametrize("size", [(752, 480), (1241, 376), (480, 640)])
def test_the_functions_of_a_field_are_those_that_have_most_of_it(size: tuple[int, int]) -> None:
    """Each adds less than the one before; all have the process at its points, and those of the window a share of it."""
    whole, part = field_over(*size), field_over(*size, WORTH_ESTIMATING)
    nodes = np.stack(np.meshgrid(whole.u_px, whole.v_px), axis=2).reshape(-1, 2)
    basis = whole.at(nodes)
    apart = np.linalg.norm(nodes[:, None] - nodes, axis=2)
    assert basis @ basis.T == pytest.approx(np.exp(-0.5 * (apart / (0.13 * size[0])) ** 2), abs=1e-9)
    variances = (basis**2).sum(axis=0)
    assert (np.diff(variances) <= 1e-9).all()
    n = part.size
    assert np.array_equal(part.at(nodes), basis[:, :n])
    assert variances[: n - 1].sum() < WORTH_ESTIMATING * len(nodes) <= variances[:n].sum()


def test_units_and_amplitudes_of_a_model_are_the_same_errors() -> None:
    """Those of a map of the disparity over the image are the same too, at every position."""
    rng, t = np.random.default_rng(2), len(TERMS)
    mean, root = rng.normal(size=len(MODEL)), rng.normal(size=(len(MODEL), len(MODEL)))
    cov = root @ root.T
    found = MODEL.in_units(RigEstimate(mean, cov, 0.9, mean, cov, np.ones(len(MODEL))))
    assert found.prior_std[:t] == pytest.approx(prior_std(RigConfig())) and found.refined is None
    error = (MODEL.effects(FAR_PX) @ mean)[:, :2] - (MODEL.effects(FAR_PX)[..., t:] @ mean[t:])[:, :2]
    assert error == pytest.approx((columns(P, FAR_PX) @ found.mean[:t])[:, :2])
    error_px, std_px = disparity_over_image(P, found, (5, 7))
    u, v = np.meshgrid(np.linspace(0, P.width - 1, 7), np.linspace(0, P.height - 1, 5))
    grid = np.stack([u.ravel(), v.ravel(), u.ravel() + 12.0, v.ravel()], axis=1)
    of_disparity = MODEL.effects(grid)[:, 0] - MODEL.effects(grid)[:, 2]
    assert error_px.ravel() == pytest.approx(of_disparity @ mean, rel=1e-9)
    assert std_px.ravel() == pytest.approx(np.linalg.norm(of_disparity @ root, axis=1), rel=1e-9)
    timing, cov_timing = MODEL.timing(Amplitudes(mean, cov))
    k = TERMS.index(DELAY)
    assert timing == pytest.approx(found.mean[k : k + 2])
    assert cov_timing == pytest.approx(found.cov[k : k + 2, k : k + 2], rel=1e-6)
    assert found.mean[0] == pytest.approx(mean[0] * RigConfig().std_disparity_px)
    root_of_turn = MODEL.root_of_turn(1e-5)
    assert MODEL.root[:6, :6] @ root_of_turn[:6] == pytest.approx(1e-5 * terms_of_turn(P)[:6])


SECONDS = np.array([0, 0.09, 0.21, 0.3, 0.38, 0.52])


def test_a_steady_rotation_and_a_polynomial_path_have_their_own_velocities_and_accelerations() -> None:
    t = SECONDS
    steady = se3.exp(TWIST * t[:, None]) @ se3.exp(np.array([0.3, 1, 2, 0.1, 0.2, 0.3]))
    assert core.point_motions(steady, t) == pytest.approx(np.tile(STEADY, (6, 1, 1)), abs=1e-7)
    cubic = np.tile(np.eye(4), (6, 1, 1))
    cubic[:, 0, 3], cubic[:, 1, 3] = 2 * t**3 - t, t**2
    found = core.point_motions(cubic, t)
    assert found[:, 0, 0] == pytest.approx(6 * t**2 - 1, abs=1e-9)
    assert found[:, 0, 1] == pytest.approx(2 * t, abs=1e-9)
    assert found[:, 1, 0] == pytest.approx(12 * t, abs=1e-9)
    assert found[:, 1, 1] == pytest.approx(np.full(6, 2.0), abs=1e-9)
    for few in (2, 3):
        found = core.point_motions(steady[:few], t[:few])
        assert found == pytest.approx(np.tile(STEADY, (few, 1, 1)), abs=1e-7)
    assert not core.point_motions(cubic[:1], t[:1]).any()


@pytest.mark.parametrize("mean", [(0.004, 0.0), (0.0, 0.02)])
def test_unknown_timing_has_the_covariance_of_its_causes(mean: tuple[float, float]) -> None:
    """Monte Carlo of delays and readouts that are constant between frames, and of errors of the velocity."""
    rng, draws = np.random.default_rng(4), 40_000
    cov, std_twist = np.diag([1e-3, 5e-3]) ** 2, np.repeat([0.3, 0.1], 3)
    points, then, now = POINTS[:5], TWIST, 0.5 * TWIST
    before, after, *units = (
        core.timed_views(*CAMERAS, points, np.stack([t, np.zeros(6)]), np.array(mean), None)
        for t in (then, now, *np.eye(6))
    )
    by_unit = np.stack(units, axis=2)
    timing = np.array(mean), cov, std_twist
    unknown = core.timing_unknowns(*CAMERAS, points, then, points, now, *timing).reshape(20, -1)
    drawn = mean + rng.normal(size=(draws, 2)) @ np.sqrt(cov)
    off = rng.normal(size=(draws, 6)) * std_twist
    by_time = (after - before).reshape(20, 2)
    moved = (drawn - mean) @ by_time.T
    for k in range(2):
        moved += drawn[:, k : k + 1] * (off @ by_unit[..., k].reshape(20, 6).T)
    expected = moved.T @ moved / draws
    found = unknown @ unknown.T
    scale = np.sqrt(np.diag(expected)).clip(1e-9)
    # twice four standard errors of a covariance, as products of two Gaussians have tails; and the omitted part is less
    # than the noise of one view
    left_out_px2 = np.linalg.eigvalsh(expected)[: -unknown.shape[1]].sum()
    assert left_out_px2 < 14 * 0.1**2
    off = np.abs(found - expected) - left_out_px2
    assert (off / np.outer(scale, scale)).max() < 8 / np.sqrt(draws)


def test_the_errors_of_motions_are_those_of_their_polynomials() -> None:
    """Of a path with a constant fourth derivative, for frames at the ends; inside, polynomials have one order more."""
    t, k = SECONDS, 0.7
    path = np.tile(np.eye(4), (6, 1, 1))
    path[:, 0, 3] = k * t**4
    found = core.point_motions(path, t)
    off = np.array([4 * k * t**3, 12 * k * t**2]).T - found[:, :, 0]
    size, bend = core.errors_of_motions(t, 0.1).T
    for i in (0, 1, 4, 5):
        assert size[i] * k * 6 * 0.1**3 == pytest.approx(off[i, 0], rel=1e-6)
        assert 2 * bend[i] * off[i, 0] == pytest.approx(off[i, 1], rel=1e-6)
    assert off[2:4] == pytest.approx(0, abs=1e-9)
    even = core.errors_of_motions(np.arange(9) / 30, 1 / 30)[:, 0]
    assert even == pytest.approx([-1, 1 / 3, *5 * [-1 / 6], -1 / 3, 1])
    assert not core.errors_of_motions(t[:1], 0.1).any()


def test_later_frames_show_the_twists_of_a_shaken_camera_as_errors_of_motions_say() -> None:
    """At 4 Hz, seen at 20 Hz. The errors of one frame, as others follow, are one number; and its change is the bend."""
    rng, errors = np.random.default_rng(8), []
    for _ in range(200):
        phase, t = rng.uniform(0, 2 * np.pi), np.arange(12) / 20
        rate = 2 * np.pi * rng.uniform(3.5, 4.5)
        paths = np.tile(np.eye(4), (12, 1, 1))
        paths[:, 0, 3] = np.sin(rate * t + phase)
        at = 7
        true = np.array([rate * np.cos(rate * t[at] + phase), -(rate**2) * np.sin(rate * t[at] + phase)])
        errors.append([true - core.point_motions(paths[:n], t[:n])[at, :, 0] for n in (8, 9, 10)])
    first = np.array(errors)[:, 0]
    for later, n in zip(np.swapaxes(errors, 0, 1), (8, 9, 10), strict=True):
        size, bend = core.errors_of_motions(np.arange(n) / 20, 1 / 20)[at]
        rms = np.sqrt((later**2).mean(axis=0))
        assert rms[0] == pytest.approx(abs(size) * np.sqrt((first[:, 0] ** 2).mean()), rel=0.25)
        if abs(bend) > 1e-6:
            assert np.corrcoef(later[:, 0], later[:, 1])[0, 1] * np.sign(bend) > 0.8
            assert rms[1] == pytest.approx(2 * abs(bend) * rms[0], rel=0.25)
    assert np.corrcoef(first[:, 0], np.array(errors)[:, 2, 0])[0, 1] < -0.9


def test_the_error_of_the_newest_velocity_is_learnt_from_how_velocities_change() -> None:
    rng, std, change = np.random.default_rng(6), np.repeat([0.2, 0.05], 3), np.full(6, 0.1)
    error = TwistError()
    assert error.cov(change, 0.5) == pytest.approx(1.25 * 0.01 * np.eye(6))
    extrapolated: dict[int, Array] = {}
    for newest in range(200):
        frames, size = list(range(max(0, newest - 5), newest + 1)), rng.uniform(0.5, 3)
        extrapolated[newest] = TWIST + size * std * rng.normal(size=6)
        twists = np.array([extrapolated[k] if k == newest else TWIST for k in frames])
        error = error.after(frames, twists, size)
    # over 20 frames, with decreasing weights: a variance is known to a factor of 1 ± 0.22
    found = error.cov(change, 0.0)
    assert np.diag(found) == pytest.approx(std**2, rel=4 * 0.23)
    assert error.cov(change, 0.5) == pytest.approx(found + 0.25 * 0.01 * np.eye(6))


@pytest.mark.parametrize("uneven", ["stamps", "exposures"])
def test_exposure_times_are_those_with_the_smoother_motion(uneven: str) -> None:
    """Frames are evenly spaced and stamped with a jitter of 1 ms, or triggered with this jitter; one is dropped."""
    rng, clock, now = np.random.default_rng(7), ExposureClock(), dict[int, Array]()
    even = np.delete(np.arange(60) / 30, 31)
    jittered = even + rng.normal(size=len(even)) * 1e-3
    exposed = even if uneven == "stamps" else jittered
    swing = np.array([0.1, 0.05, 0.2, 0.1, 0.3, 0.05])
    poses = se3.exp(swing * np.sin(3 * exposed[:, None]))
    for newest in range(len(even)):
        window = slice(max(0, newest - 9), newest + 1)
        stamps = (jittered[window] * 1e9).astype(int).tolist()
        seconds, clock = clock.seconds(poses[window], stamps, np.ones(6))
        now[newest] = seconds - (exposed[window] - exposed[window][0])
    wrong_s = np.concatenate([np.diff(now[k]) for k in range(20, len(even))])
    # the period of an even clock is known to 1 ms/√82.5 from ten frames, intervals of stamps to √2 ms
    assert np.abs(wrong_s).max() < (5e-3 / np.sqrt(82.5) if uneven == "stamps" else 1e-8)
