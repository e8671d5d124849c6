"""Preintegration against finer integration and Monte Carlo, and the Jacobian of the factor against differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stream_sfm import core
from stream_sfm.estimators.window.inertia.interval import Interval, Intervals
from stream_sfm.geometry import se3
from stream_sfm.inertial.buffer import SampleBuffer
from stream_sfm.inertial.samples import ImuCalibration, ImuSamples
from stream_sfm.record import changed
from tools.render.inertial import exact

RNG = np.random.default_rng(5)
SECONDS = np.arange(21) / 200
GYRO = np.array([0.4, -0.7, 0.9]) + np.cumsum(RNG.normal(0, 0.15, (21, 3)), axis=0)
ACCEL = np.array([1.0, 9.4, -2.0]) + np.cumsum(RNG.normal(0, 0.5, (21, 3)), axis=0)
BIASES = np.array([0.01, -0.02, 0.015, 0.1, -0.05, 0.08])
DENSITIES = np.array([2e-3, 2e-2])
CAM_FROM_IMU = se3.exp([0.03, 0.015, -0.02, 0.02, -0.03, 1.55])


def integrated(seconds=SECONDS, gyro=GYRO, accel=ACCEL, biases=BIASES):
    return core.preintegrate(seconds, gyro, accel, np.ones(len(seconds) - 1), biases, DENSITIES)


def change(base, other) -> np.ndarray:
    """The error (9,) of one preintegrated motion against another."""
    turned = se3.log_so3(base[0].T @ other[0])
    return np.concatenate([turned, (other[1] - base[1]).ravel()])


def by_runge_kutta(seconds, gyro, accel, rate_hz=10_000):
    """Rotation, velocity and position of samples that are straight lines in between."""

    def rates(t, q, v):
        w = np.array([np.interp(t, seconds, gyro[:, k]) for k in range(3)]) - BIASES[:3]
        a = np.array([np.interp(t, seconds, accel[:, k]) for k in range(3)]) - BIASES[3:]
        x, y, z, s = q
        product = 0.5 * np.array(
            [s * w[0] + y * w[2] - z * w[1], s * w[1] + z * w[0] - x * w[2], s * w[2] + x * w[1] - y * w[0], 0]
        )
        product[3] = -0.5 * (np.array([x, y, z]) @ w)
        return product, Rotation.from_quat(q).as_matrix() @ a, v

    q, v, p = np.array([0, 0, 0, 1.0]), np.zeros(3), np.zeros(3)
    steps = round((seconds[-1] - seconds[0]) * rate_hz)
    h = (seconds[-1] - seconds[0]) / steps
    for k in range(steps):
        t = seconds[0] + k * h
        k1 = rates(t, q, v)
        k2 = rates(t + h / 2, q + h / 2 * k1[0], v + h / 2 * k1[1])
        k3 = rates(t + h / 2, q + h / 2 * k2[0], v + h / 2 * k2[1])
        k4 = rates(t + h, q + h * k3[0], v + h * k3[1])
        q, v, p = (x + h / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in zip((q, v, p), k1, k2, k3, k4, strict=True))
        q = q / np.linalg.norm(q)
    return Rotation.from_quat(q).as_matrix(), v, p


def test_preintegration_is_that_of_a_finer_integration():
    rotation, v, p = by_runge_kutta(SECONDS, GYRO, ACCEL)
    error = change(integrated(), (rotation, np.stack([v, p])))
    assert np.abs(error[:3]).max() < 1e-7 and np.abs(error[3:6]).max() < 1e-6 and np.abs(error[6:]).max() < 1e-7


def test_jacobian_by_biases_equals_differences():
    base, step = integrated(), 1e-5
    numerical = np.stack(
        [
            (change(base, integrated(biases=BIASES + d)) - change(base, integrated(biases=BIASES - d))) / (2 * step)
            for d in step * np.eye(6)
        ],
        axis=1,
    )
    assert np.abs(base[2] - numerical).max() < 2e-3 * np.abs(numerical).max()


def test_jacobian_by_the_clock_equals_differences():
    late = 1e-4

    def shifted(by):  # both ends moved, along the same straight lines
        at = np.concatenate([[0.01 + by], SECONDS[(0.01 + by < SECONDS) & (0.09 + by > SECONDS)], [0.09 + by]])
        of = [np.stack([np.interp(at, SECONDS, x[:, k]) for k in range(3)], axis=1) for x in (GYRO, ACCEL)]
        return integrated(at, *of)

    base = shifted(1e-3)
    numerical = (change(base, shifted(1e-3 + late)) - change(base, shifted(1e-3 - late))) / (2 * late)
    assert np.abs(base[3].ravel() - numerical).max() < 5e-3 * np.abs(numerical).max()


def test_covariance_is_that_of_samples_with_noise():
    base, n = integrated(), 3000
    root = 1 / np.sqrt(np.diff(SECONDS)[0])
    errors = []
    for _ in range(n):
        gyro = GYRO + DENSITIES[0] * root * RNG.normal(size=GYRO.shape)
        accel = ACCEL + DENSITIES[1] * root * RNG.normal(size=ACCEL.shape)
        errors.append(change(base, integrated(gyro=gyro, accel=accel)))
    cov = base[4] + base[5]
    root_cov = np.linalg.cholesky(cov)
    whitened = np.linalg.solve(root_cov, np.array(errors).T)
    # samples at both ends count by half, as those of two intervals do: a twentieth less than white noise in each step
    found = whitened @ whitened.T / n
    assert np.abs(np.diag(found) - 1).max() < 0.2
    assert np.abs(found - np.diag(np.diag(found))).max() < 0.15


@pytest.mark.parametrize("intervals", [1, 3])
def test_jacobian_of_the_factor_equals_differences(intervals):
    n = intervals
    parts = [integrated(gyro=GYRO + 0.1 * k) for k in range(n)]
    cov = np.stack([p[4] + p[5] + 1e-12 * np.eye(9) for p in parts])
    rows = Intervals(
        np.stack([p[0] for p in parts]), np.stack([p[1].ravel() for p in parts]), np.stack([p[2] for p in parts]),
        np.stack([p[3].ravel() for p in parts]), cov, np.tile(BIASES, (n, 1)), np.full(n, 1e-3), np.full(n, 0.1),
    )  # fmt: skip
    state = np.r_[0.4, -0.3, 0.8, 0.5, 9.7, 1.0, BIASES + 1e-4, 0.01, 0.02, -0.01, 0.03, 1.1e-3]
    cams, velocities, then = [np.eye(4)], [], state
    for k in range(n):  # near where the samples lead: there the Jacobian of the rotation is exact
        from_now, then, *_ = core.inertial_motion(
            Intervals(*(row[k : k + 1] for row in rows)), then, CAM_FROM_IMU, np.zeros(6)
        )
        cams.append(se3.exp(RNG.normal(0, 1e-4, 6)) @ se3.inverse(from_now) @ cams[-1])
        velocities.append(then[:3] + RNG.normal(0, 0.1, 3))
    cams, velocities = np.array(cams[1:]), np.array(velocities)
    lead, _ = core.slide_leads(cams, np.zeros((n, 3)))

    def residual(x):
        poses, s, slides, v = np.split(x, [6 * n, 6 * n + 17, 9 * n + 17])
        _, moved = core.slide_leads(se3.exp(poses.reshape(n, 6)) @ cams, slides.reshape(n, 3))
        return core.inertial_rows(rows, moved, lead, velocities + v.reshape(n, 3), state + s, CAM_FROM_IMU)[0]

    _, *both = core.inertial_rows(rows, cams, lead, velocities, state, CAM_FROM_IMU)
    jacobian = np.concatenate(both, axis=1)
    numerical = np.empty_like(jacobian)
    for k in range(jacobian.shape[1]):
        d = np.zeros(jacobian.shape[1])
        d[k] = 1e-6
        numerical[:, k] = (residual(d) - residual(-d)) / 2e-6
    assert np.abs((jacobian - numerical) / (np.abs(numerical).max(axis=0) + 1e-9)).max() < 1e-3
    of_slides, std_slides = RNG.normal(0, 1e-3, (n, 3)), np.full(n, 2e-3)
    for wide in (1.0, 1e12):  # however large the variance of the last interval is beside the others'
        cov[-1] *= wide
        check_information(rows, cams, of_slides, std_slides, velocities, state)


def check_information(rows, cams, slides, std_slides, velocities, state) -> None:
    """The information about poses and state is definite, and with slides and velocities that of all rows together."""
    n, others = len(cams), 6 * len(cams) + 17
    about, weighted, lead, cov, gain, right = core.inertial_information(
        rows, cams, slides, std_slides, velocities, state, CAM_FROM_IMU
    )
    assert np.linalg.eigvalsh(about)[0] > -1e-9 * np.diag(about).max()
    lead_alone, true_cams = core.slide_leads(cams, slides)
    assert (lead == lead_alone).all()
    residual, shared, local = core.inertial_rows(rows, true_cams, lead, velocities, state, CAM_FROM_IMU)
    j = np.block([[shared, local], [np.zeros((3 * n, others)), np.eye(6 * n)[: 3 * n] / std_slides[0]]])
    e = np.concatenate([residual, slides.ravel() / std_slides[0]])
    scale = 1 / np.linalg.norm(j, axis=0)
    step = np.linalg.lstsq(j * scale, -e, rcond=1e-13)[0] * scale  # the least one, as nothing else is known
    assert about @ step[:others] == pytest.approx(weighted, rel=1e-6, abs=1e-6 * np.abs(weighted).max())
    eliminated = cov @ right + gain @ step[:others]
    assert eliminated == pytest.approx(step[others:], rel=1e-4, abs=1e-6 * np.abs(step[others:]).max())


def one_interval() -> Intervals:
    """All samples as one interval, of which the unit's errors are known."""
    part = integrated()
    return Intervals(
        part[0][None], part[1].reshape(1, 6), part[2][None], part[3].reshape(1, 9), (part[4] + part[5])[None],
        BIASES[None], np.zeros(1), np.array([SECONDS[-1]]),
    )  # fmt: skip


def test_the_motion_by_samples_alone_leaves_no_residual():
    rows = one_interval()
    state = np.r_[0.3, -0.2, 1.0, 0.5, 9.7, 1.0, BIASES + 1e-4, 0.01, 0.02, -0.01, 0.03, 1e-4]
    previous_from_now, then, *_ = core.inertial_motion(rows, state, CAM_FROM_IMU, np.zeros(6))
    lead, cam = np.eye(6)[:, 3:], se3.inverse(previous_from_now)[None]
    residual, *_ = core.inertial_rows(rows, cam, lead, then[None, :3], state, CAM_FROM_IMU)
    assert np.abs(residual).max() < 1e-6


def test_how_the_end_of_an_interval_moves_with_its_beginning_equals_differences():
    rows = one_interval()
    state, walk = np.r_[0.3, -0.2, 1.0, 0.5, 9.7, 1.0, BIASES, 0.01, 0.02, -0.01, 0.03, 0.0], np.full(6, 1e-3)

    def end(x):
        from_now, then, *_ = core.inertial_motion(rows, state + x[6:], CAM_FROM_IMU, walk)
        return se3.exp(x[:6]) @ from_now, then

    pose, then = end(np.zeros(23))
    _, _, jacobian, cov = core.inertial_motion(rows, state, CAM_FROM_IMU, walk)

    def change(x):
        moved, state_then = end(x)
        return np.concatenate([se3.log(se3.inverse(pose) @ moved), state_then - then])

    numerical = np.stack([(change(d) - change(-d)) / 2e-6 for d in 1e-6 * np.eye(23)], axis=1)
    assert np.abs(jacobian - numerical).max() < 2e-3 * np.abs(numerical).max()
    added = np.linalg.eigvalsh(cov)
    assert added[0] > -1e-12 and np.allclose(np.diag(cov)[12:18], walk**2)


def test_what_an_error_of_its_length_does_to_an_interval_equals_differences():
    calibration = ImuCalibration(CAM_FROM_IMU)
    state = np.r_[0.3, -0.2, 1.0, 0.5, 9.7, 1.0, BIASES, 0.0, 0.02, -0.01, 0.03, 0.0]
    stamps_ns = np.round(SECONDS * 1e9).astype(np.int64)

    def interval(end_ns):
        buffer = SampleBuffer(calibration)
        buffer.add(ImuSamples(stamps_ns, GYRO, ACCEL))
        return Interval.of(buffer.between(0, end_ns, 0.0), calibration, state, np.ones(3), 0.0)

    middle, step_ns = interval(80_000_000), 100_000
    motion, then, *_ = core.inertial_motion(Intervals.of([middle], np.ones(3)), state, CAM_FROM_IMU, np.zeros(6))
    fixed = se3.inverse(motion)[None], np.eye(6)[:, 3:], then[None, :3], state, CAM_FROM_IMU

    def whitened(end_ns):
        other = changed(interval(end_ns), cov_gyro=middle.cov_gyro, cov_accel=middle.cov_accel)
        return core.inertial_rows(Intervals.of([other], np.ones(3)), *fixed)[0]

    numerical = (whitened(80_000_000 + step_ns) - whitened(80_000_000 - step_ns)) / (2e-9 * step_ns)
    root = np.linalg.cholesky(Intervals.of([middle], np.ones(3)).cov[0])
    assert root @ numerical == pytest.approx(-middle.by_time, rel=1e-2, abs=1e-2)


@pytest.mark.parametrize("rate_rad_s", [1e-5, 1e-3, 0.02, 1.0])
def test_rendered_samples_have_slow_turns_as_well_as_fast_ones(rate_rad_s):
    """A gyroscope that shows nothing below 0.03 rad/s contradicts sound images: d² is 14 to 190 instead of 1 to 7."""
    tilted, rate = se3.exp([1.0, -2.0, 0.5, 0.3, -0.2, 0.1]), rate_rad_s * np.array([0.6, -0.48, 0.64])

    def path(t: float) -> np.ndarray:
        return tilted @ se3.exp(np.concatenate([np.zeros(3), rate * t]))

    measured, _ = exact(path, np.eye(4), np.array([0, 0, -1.0]), 0.7)
    assert measured == pytest.approx(rate, rel=1e-6, abs=1e-11)
