"""Paths drawn at random through a place, and who passes by. Each is a smooth function of continuous time."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from .hard import robot_pose
from .places import Rng, Site
from .recording import Place
from .scene import Box
from .textures import carton, crate, fabric

Array = NDArray[np.float64]
Path = Callable[[float], Array]  # room_from_cam (4, 4) at a time in seconds
_MARGIN_S = 0.5  # before and after the recording: rows and late cameras expose there
_RAMP_S = 0.08, 0.2  # of starts and stops, where brakes allow
_BRAKING_M_S2 = 6.0
_SHAKEN_HZ = 1.7  # at most, by an uneven road
_STEP_M = 0.7  # of somebody who walks
_PATIENCE = 40  # draws of an arc before a shorter one is tried


def _waves(rng: Rng, sizes: tuple[float, ...], hz: tuple[float, float]) -> Callable[[float], Array]:
    """Sums of three sine waves (k,), each of about these sizes, at drawn frequencies."""
    shape = 3, len(sizes)
    size = rng.uniform(0.3, 0.8, shape) * sizes
    rate, phase = 2 * np.pi * rng.uniform(*hz, shape), rng.uniform(0, 2 * np.pi, shape)
    return lambda t: (size * np.sin(rate * t + phase)).sum(axis=0)


def _peak_rate(angles: Callable[[float], Array], duration_s: float) -> float:
    times_s = np.arange(0, duration_s, 0.01)
    return float(np.linalg.norm(np.diff([angles(t) for t in times_s], axis=0), axis=1).max() / 0.01)


def _spot(rng: Rng, site: Site) -> tuple[Array, float]:
    """A position and a heading in degrees; in long places along them."""
    x, y = rng.uniform(-0.7, 0.7, 2) * site.free_m
    long = site.free_m[0] > 3 * site.free_m[1]
    heading = 180 * rng.integers(2) + rng.uniform(-20, 20) if long else rng.uniform(-180, 180)
    return np.array([x, y, site.eye_m]), float(heading)


def _arc(rng: Rng, site: Site, length_m: float) -> tuple[Array, float, float]:
    """Where an arc of a length begins (x, y), its heading in radians there, and its curvature; all of it is free."""
    long = site.free_m[0] > 3 * site.free_m[1]
    for k in range(100 * _PATIENCE):
        s = np.linspace(0, length_m * 0.93 ** (k // _PATIENCE), 50)
        heading = rng.normal(0, 0.03) + np.pi * rng.integers(2) if long else rng.uniform(-np.pi, np.pi)
        curvature = rng.normal(0, 0.005) if long else rng.uniform(-0.4, 0.4)
        along = heading + curvature * s
        line = np.stack([np.cos(along), np.sin(along)], axis=1).cumsum(axis=0) * (s[1] - s[0])
        begin = rng.uniform(-1, 1, 2) * site.free_m - line[len(line) // 2]
        if (np.abs(begin + line) < site.free_m).all():
            return begin, float(heading), float(curvature)
    raise ValueError("no arc fits into the place")


def _along(
    rng: Rng, site: Site, progress: Callable[[float], float], length_m: float, speed: float, walked: bool
) -> Path:
    """Along an arc on foot or on wheels, as far as `progress` says; bob and roll belong to places, not to times."""
    begin, heading, curvature = _arc(rng, site, length_m)
    wave_m = _STEP_M if walked else max(1.0, length_m / 8, speed / _SHAKEN_HZ)
    bob_m, nod_deg = (0.02, 1.5) if walked else (0.008, 0.4)
    look, down = rng.uniform(-12, 12), rng.uniform(-6, 1)
    phase = rng.uniform(0, 2 * np.pi, 4)

    def path(t: float) -> Array:
        s = progress(t)
        turn = curvature * s
        chord = s * np.sinc(turn / 2 / np.pi)
        x, y = begin + chord * np.array([np.cos(heading + turn / 2), np.sin(heading + turn / 2)])
        wave = np.sin(2 * np.pi * s / wave_m * np.array([1, 0.5, 1, 0.5]) + phase)
        at = np.array([x, y, site.eye_m + bob_m * wave[0]])
        at[:2] += bob_m * wave[1] * np.array([-np.sin(heading), np.cos(heading)])
        return robot_pose(at, (np.rad2deg(heading + turn) + look, down + nod_deg * wave[2], nod_deg * wave[3]))

    return path


def hand_held(rng: Rng, site: Site, duration_s: float) -> Path:
    """In a restless hand: turns of up to 25 to 60 degrees per second."""
    middle, heading = _spot(rng, site)
    moved = _waves(rng, (0.25, 0.25, 0.1), (0.2, 0.8))
    shaken = _waves(rng, (12.0, 6.0, 5.0), (0.3, 1.2))
    size = rng.uniform(25, 60) / _peak_rate(shaken, duration_s)
    pan = rng.uniform(-8, 8)
    return lambda t: robot_pose(middle + moved(t), np.array([heading + pan * t, -3, 0]) + size * shaken(t))


def shaken(rng: Rng, site: Site, duration_s: float) -> Path:
    """In a hand that shakes it: turns of up to 45 to 90 degrees per second at 2 to 4 Hz."""
    middle, heading = _spot(rng, site)
    moved, swung = _waves(rng, (0.25, 0.25, 0.1), (0.2, 0.8)), _waves(rng, (3.0, 3.0, 2.0), (2.0, 4.0))
    size = rng.uniform(45, 90) / _peak_rate(swung, duration_s)
    return lambda t: robot_pose(middle + moved(t), np.array([heading, -3, 0]) + size * swung(t))


def vibrating(rng: Rng, site: Site, duration_s: float) -> Path:
    """At rest with rotors running: turns of 10 to 30 degrees per second and 1 to 4 m/s² at 20 to 80 Hz."""
    middle, heading = _spot(rng, site)
    hz = rng.uniform(20, 80, 6)
    rate, phase = 2 * np.pi * hz, rng.uniform(0, 2 * np.pi, 6)
    size = np.concatenate([rng.uniform(1, 4, 3) / rate[:3] ** 2, rng.uniform(10, 30, 3) / rate[3:]])

    def path(t: float) -> Array:
        wave = size * np.sin(rate * t + phase)
        return robot_pose(middle + wave[:3], np.array([heading, -3, 0]) + wave[3:])

    return path


def _speed(rng: Rng, site: Site, duration_s: float, walked: bool) -> float:
    """Metres per second: of somebody who walks, of a car in a street, else of a small robot."""
    wanted = rng.uniform(0.8, 1.5) if walked else rng.uniform(4, 13) if site.free_m[0] > 30 else rng.uniform(0.4, 1.5)
    return float(min(wanted, 1.8 * site.free_m[0] / duration_s))


def walk(rng: Rng, site: Site, duration_s: float) -> Path:
    """On foot along an arc, with the bob and sway of steps."""
    speed = _speed(rng, site, duration_s, walked=True)
    return _along(rng, site, lambda t: speed * t, speed * duration_s, speed, walked=True)


def drive(rng: Rng, site: Site, duration_s: float) -> Path:
    """On wheels along an arc, on an uneven floor."""
    speed = _speed(rng, site, duration_s, walked=False)
    return _along(rng, site, lambda t: speed * t, speed * duration_s, speed, walked=False)


def spin(rng: Rng, site: Site, duration_s: float) -> Path:
    """Turning on the spot, on and on or there and back, with the camera in the axis or some centimetres beside it."""
    middle, heading = _spot(rng, site)
    rate, lever_m = rng.uniform(15, 60) * rng.choice([-1, 1]), rng.choice([0.0, rng.uniform(0.03, 0.15)])
    there_and_back = rng.random() < 0.5
    hz = rng.uniform(0.15, 0.3)

    def path(t: float) -> Array:
        turned = rate / (2 * np.pi * hz) * np.sin(2 * np.pi * hz * t) if there_and_back else rate * t
        yaw = np.deg2rad(heading + turned)
        return robot_pose(middle + lever_m * np.array([np.cos(yaw), np.sin(yaw), 0]), (heading + turned, -3, 0))

    return path


def _distance(
    speed: float, ramp_s: float, duration_s: float, moves: Callable[[Array], Array]
) -> Callable[[float], float]:
    """Distance over time at a speed, where `moves(times)`; starts and stops have a σ of `ramp_s`, as brakes allow."""
    step_s = 0.01
    times_s = np.arange(-_MARGIN_S, duration_s + _MARGIN_S, step_s)
    ramp_s = max(ramp_s, speed / (np.sqrt(2 * np.pi) * _BRAKING_M_S2))
    gone_m = speed * step_s * np.cumsum(gaussian_filter1d(moves(times_s).astype(float), ramp_s / step_s))
    return CubicSpline(times_s, gone_m)


def stand(rng: Rng, site: Site, duration_s: float) -> Path:
    """Exactly still, for all of the time or until it goes on after half of it or more."""
    begin_s = duration_s * rng.uniform(0.5, 0.8) if rng.random() < 0.5 else 2 * duration_s
    ramp_s, speed = rng.uniform(*_RAMP_S), _speed(rng, site, duration_s, walked=False)
    gone_m = _distance(speed, ramp_s, duration_s, lambda t: t > begin_s)
    return _along(rng, site, lambda t: float(gone_m(t)), speed * max(1.0, duration_s - begin_s), speed, walked=False)


def stop_and_go(rng: Rng, site: Site, duration_s: float) -> Path:
    """On wheels, with stops of about a second."""
    period_s, share, first_s = rng.uniform(1.5, 3), rng.uniform(0.4, 0.7), rng.uniform(0, 1.5)
    ramp_s, speed = rng.uniform(*_RAMP_S), _speed(rng, site, duration_s, walked=False)
    period_s *= max(1.0, speed / 3)  # a car brakes for longer
    gone_m = _distance(speed, ramp_s, duration_s, lambda t: (t + first_s) % period_s < share * period_s)
    return _along(rng, site, lambda t: float(gone_m(t)), speed * duration_s, speed, walked=False)


WAYS: dict[str, Callable[[Rng, Site, float], Path]] = {
    maker.__name__: maker for maker in (hand_held, walk, drive, spin, stand, stop_and_go, shaken, vibrating)
}
_ABOVE_M = 100.0
_NEAREST_M = 0.9  # of somebody who passes, to the camera


def passers(
    rng: Rng, site: Site, path: Path, duration_s: float, count: int
) -> tuple[tuple[Box, ...], Callable[[float], dict[int, Place]]]:
    """Boxes that pass before the camera at steady speeds, and where they are; they stand behind those of the site."""
    cars = site.free_m[0] > 30
    size = (4.2, 1.8, 1.6) if cars else (0.5, 0.45, 1.75)
    distances_m, speeds = ((7, 14), (3, 8)) if cars else ((1.3, 3.5), (0.4, 1.5))
    boxes, lines = [], []
    for _ in range(count):
        for _ in range(_PATIENCE):
            at_s = rng.uniform(0.1, 0.9) * duration_s
            camera = path(at_s)
            ahead, aside = camera[:2, 2], camera[:2, 0]
            distance, speed = rng.uniform(*distances_m), rng.uniform(*speeds)
            direction = aside * rng.choice([-1, 1]) + ahead * rng.uniform(-0.4, 0.4)
            velocity = speed * direction / np.linalg.norm(direction)
            crossing = camera[:2, 3] + distance * ahead - at_s * velocity
            apart = [np.linalg.norm(crossing + t * velocity - path(t)[:2, 3]) for t in np.linspace(0, duration_s, 40)]
            if min(apart) > _NEAREST_M + size[0] / 2:
                break
        else:
            continue
        yaw = float(np.rad2deg(np.arctan2(velocity[1], velocity[0])))
        paint = (fabric(105), carton, crate)[rng.integers(3)]
        boxes.append(Box((0, 0, _ABOVE_M), size, paint, yaw))  # its shadow would stay where it is built
        lines.append((crossing, velocity, yaw))
    first, height = len(site.boxes), size[2] / 2

    def bodies(t: float) -> dict[int, Place]:
        return {
            first + k: ((*(start + t * velocity).tolist(), height), yaw)
            for k, (start, velocity, yaw) in enumerate(lines)
        }

    return tuple(boxes), bodies
