"""Units that fail in one way or another: within a second a run is as without samples, and says so."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stream_sfm.estimators.window.inertia.checks import Surprise
from stream_sfm.estimators.window.inertia.rules import InertiaRules
from stream_sfm.inertial.samples import ImuSamples
from stream_sfm.methods import REFERENCE, WITHOUT_IMU
from stream_sfm.types import Observations, Solution, Status
from tests.helpers.estimators import nees, run
from tests.helpers.imu_views import PROJECTION, observed, rms_m, swaying
from tools.render.inertial import BMI160

FRAMES, FAULT = 56, 25  # a second of agreement, the fault, and more than a second with it
MOST = 28  # frames: a second, and some tenths until the odds turn or a hole in the stamps has passed
FIVE_SIGMA = 47.6  # of a squared distance in six dimensions: as improbable as five σ
Fault = Callable[[ImuSamples], ImuSamples]


def with_values(of_gyro: Callable[[np.ndarray], np.ndarray], of_accel: Callable[[np.ndarray], np.ndarray]) -> Fault:
    return lambda s: ImuSamples(s.stamps_ns, of_gyro(s.gyro_rad_s), of_accel(s.accel_m_s2))


def shifted(seconds: float) -> Fault:
    return lambda s: ImuSamples(s.stamps_ns + round(seconds * 1e9), s.gyro_rad_s, s.accel_m_s2)


def same(values: np.ndarray) -> np.ndarray:
    return values


def turned(values: np.ndarray) -> np.ndarray:
    return values[:, [1, 2, 0]]


MIRROR = np.array([1.0, 1.0, -1.0])
FAULTS: dict[str, Fault] = {
    "unplugged": lambda s: s[:0], "clock ahead by 11 s": shifted(11.0), "clock ahead by an hour": shifted(3600.0),
    "clock set back by a minute": shifted(-60.0), "clock ahead by 0.2 s": shifted(0.2),
    "clock behind by 50 ms": shifted(-0.05), "degrees": with_values(np.rad2deg, same),
    "mirrored": with_values(lambda g: g * MIRROR, lambda a: a * MIRROR),
    "gravity's sign": with_values(same, np.negative), "turned": with_values(turned, turned),
    "frozen": with_values(lambda g: np.full_like(g, 0.1), lambda a: np.full_like(a, 5.6)),
    "a step of the gyroscope's bias": with_values(lambda g: g + 0.2, same),
    "nothing but noise": with_values(lambda g: np.random.default_rng(1).normal(size=g.shape), same),
}  # fmt: skip


@cache
def sound(seed: int, frames: int) -> tuple[tuple[np.ndarray, ...], tuple[Observations, ...]]:
    """True poses, and observations with samples that do not fail."""
    poses, observations = zip(*observed(seed, frames), strict=True)
    return poses, observations


@cache
def found_by(method: str, seed: int, frames: int) -> list[Solution]:
    return run(method, PROJECTION, sound(seed, frames)[1])


def failing(
    fault: Fault, seed: int, frames: int, until: int | None = None
) -> tuple[tuple[np.ndarray, ...], list[Observations]]:
    """True poses, and observations whose samples fail from frame FAULT on."""
    poses, observations = sound(seed, frames)
    changed = [
        replace(o, inertial=replace(o.inertial, samples=fault(o.inertial.samples)))
        if FAULT <= k < (frames if until is None else until)
        else o
        for k, o in enumerate(observations)
    ]
    return poses, changed


def tilted(estimate: Solution, pose: np.ndarray, seed: int) -> float:
    """The error of the direction of gravity in units of its σ, radians over radians."""
    inertial = estimate.inertial
    assert inertial is not None
    down = inertial.gravity / np.linalg.norm(inertial.gravity)
    cosine = float(down @ pose[:3, :3].T @ swaying(seed).down)
    return float(np.arccos(np.clip(cosine, -1, 1)) / inertial.std_tilt_rad)


@pytest.mark.parametrize("name", FAULTS)
def test_a_unit_that_fails_is_out_within_a_second_and_no_worse_than_none(name: str, caplog) -> None:
    poses, observations = failing(FAULTS[name], 21, FRAMES)
    found, without = run(REFERENCE, PROJECTION, observations), found_by(WITHOUT_IMU, 21, FRAMES)
    for estimate, pose in list(zip(found, poses, strict=True))[1:]:
        assert estimate.status in (Status.OK, Status.DEGRADED)
        distance2 = nees(estimate.world_from_cam, estimate.cov_pose, pose)
        assert distance2 < FIVE_SIGMA or estimate.status is not Status.OK
    bad = [k for k, estimate in enumerate(found) if estimate.status is Status.DEGRADED]
    assert all(FAULT <= k <= FAULT + MOST for k in bad)
    assert found[-1].inertial is None and "by images alone" in caplog.text
    assert rms_m(found, poses) < 1.15 * rms_m(without, poses)  # with a second of a wrong unit in them


def test_a_unit_that_works_again_is_used_again() -> None:
    poses, observations = failing(FAULTS["turned"], 26, 120, until=60)
    found = run(REFERENCE, PROJECTION, observations)
    used = [e.inertial is not None for e in found]
    assert used[20] and not any(used[FAULT + MOST : 75]) and all(used[100:])
    assert all(e.status is Status.OK for e in found[FAULT + MOST :])
    assert all(tilted(e, p, 26) < 5 for e, p in list(zip(found, poses, strict=True))[100:])


@pytest.mark.parametrize("seed", [21, 33])
def test_a_step_of_the_accelerometer_s_bias_does_not_stay_in_the_tilt(seed: int) -> None:
    poses, observations = failing(with_values(same, lambda a: a + np.array([0.0, 0.2, 0.0])), seed, FRAMES)
    found = run(REFERENCE, PROJECTION, observations)
    assert all(e.status is Status.OK for e in found[1:])
    assert sum(tilted(e, p, seed) > 5 for e, p in list(zip(found, poses, strict=True))[FAULT:]) <= 3


def of_accel(by: Callable[[np.ndarray], np.ndarray]) -> Fault:
    return with_values(same, by)


WRONG_FROM_THE_START: dict[str, Fault] = {
    "x mirrored": of_accel(lambda a: a * [-1.0, 1.0, 1.0]),
    "y mirrored": of_accel(lambda a: a * [1.0, -1.0, 1.0]),
    "z mirrored": of_accel(lambda a: a * MIRROR),
    "gravity's sign": of_accel(np.negative),
    "axes of the accelerometer": of_accel(turned),
    "all axes": with_values(turned, turned),
    "bias": of_accel(lambda a: a + np.array([2.0, 0.0, 1.0])),
}


@pytest.mark.parametrize(
    ("name", "seed", "frames"),
    [
        *((name, seed, 45) for name in WRONG_FROM_THE_START for seed in (5, 21)),
        (
            "gravity's sign",
            820003,
            FRAMES,
        ),  # surprising intervals have a larger variance, which must not hide the noise
    ],
)
def test_the_tilt_of_a_unit_that_is_wrong_from_the_start_is_within_its_sigma(name: str, seed: int, frames: int) -> None:
    fault = WRONG_FROM_THE_START[name]
    poses, observations = zip(*observed(seed, frames), strict=True)
    wrong = [replace(o, inertial=replace(o.inertial, samples=fault(o.inertial.samples))) for o in observations]
    found = list(zip(run(REFERENCE, PROJECTION, wrong), poses, strict=True))[1:]
    assert all(tilted(e, p, seed) < 5 for e, p in found if e.status is Status.OK and e.inertial is not None)


def test_the_tilt_counts_once_samples_have_agreed_for_a_second() -> None:
    _, observations = zip(*observed(21, 45), strict=True)
    found = [e.inertial.std_tilt_rad for e in run(REFERENCE, PROJECTION, observations)[1:] if e.inertial is not None]
    assert min(found[:18]) >= 1 and max(found[24:]) < 0.05


@pytest.mark.parametrize("value", [1e3, 1e5, 1e30, 1e300])
def test_values_that_no_sensor_measures_are_left_out(value: float) -> None:
    """One sample in fifty, as a corrupted line gives."""
    rng = np.random.default_rng(5)

    def garbled(values: np.ndarray) -> np.ndarray:
        return np.where(rng.random((len(values), 1)) < 0.02, value * rng.normal(size=values.shape), values)

    poses, observations = failing(with_values(garbled, garbled), 33, FRAMES)
    found = run(REFERENCE, PROJECTION, observations)
    assert all(e.status is Status.OK and e.inertial is not None for e in found[1:])
    assert rms_m(found, poses) < 1.1 * rms_m(found_by(REFERENCE, 33, FRAMES), poses)


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 20.0, 40.0, 100.0, 1000.0, 4000.0])
def test_samples_of_every_rate_never_make_it_worse(rate_hz: float) -> None:
    poses, observations = zip(*observed(33, 40, replace(BMI160, rate_hz=rate_hz)), strict=True)
    found = run(REFERENCE, PROJECTION, observations)
    assert all(e.status is Status.OK for e in found[1:])
    assert rms_m(found, poses) < 1.05 * rms_m(found_by(WITHOUT_IMU, 33, 40), poses)
    assert (found[-1].inertial is not None) == (rate_hz > 33)


@pytest.mark.parametrize("seed", [22, 23])
def test_a_gyroscope_whose_scale_is_wrong_widens_what_samples_say(seed: int) -> None:
    """No single frame contradicts it; without (85d) the largest squared distances are 52 and 68."""
    poses, observations = sound(seed, FRAMES)
    scaled = with_values(lambda g: 0.75 * g, same)
    shown = [
        replace(o, inertial=replace(o.inertial, samples=scaled(o.inertial.samples))) if k >= FAULT // 2 else o
        for k, o in enumerate(observations)
        if o.inertial is not None
    ]
    found = run(REFERENCE, PROJECTION, shown)
    ok = [nees(e.world_from_cam, e.cov_pose, p) for e, p in zip(found, poses, strict=True) if e.status is Status.OK]
    assert len(ok) > FRAMES // 2 and max(ok) < FIVE_SIGMA


def test_a_sound_unit_never_surprises() -> None:
    surprise, found = Surprise(InertiaRules()), run(REFERENCE, PROJECTION, sound(22, FRAMES)[1])
    for solution in found:
        if solution.inertial is not None:
            surprise = surprise.after(solution.inertial.distance2)
            assert surprise.factor == 1.0
