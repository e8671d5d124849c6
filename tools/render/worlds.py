"""Worlds drawn at random, each from its seed: place, path, rig, light, movers, repetition, and none to three faults.

Of the seeds above `FIRST_KINDS` six in ten have one of `KINDS` instead of drawn faults. Smaller seeds, and the rest,
are the worlds that they were before there were kinds. A world without its faults has the same scene, path, noise and
stamps, so that errors can be compared. What faults are asked for changes nothing else either.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

from .caster import FOUR_RAYS, Sensor
from .covers import Dirt, OwnBody, Reflection
from .faults import Fault, focal, knock, late, rolling, slow_turn, zoom
from .inertial import UNITS
from .places import SITES, Rng
from .recording import Recording
from .scene import build_scene
from .ways import WAYS, passers

PATHS = {  # the places that each path may go through
    "hand_held": ("hall", "corridor", "yard"),
    "walk": ("hall", "corridor", "street", "yard"),
    "drive": ("street", "street", "yard", "corridor"),
    "spin": ("hall", "yard"),
    "stand": ("hall", "corridor", "street", "yard"),
    "stop_and_go": ("hall", "corridor", "street", "yard"),
}
RIGS = ("converging", "wide", "small", "unrectified")
LIGHTS = {
    "bright": Sensor(1.2, 0.015, 1.0, 0.98),
    "even": Sensor(1.4, 0.02, 0.8, 0.82),
    "dim": Sensor(2.0, 0.04, 0.4, 0.39),
    "drifting": Sensor(1.4, 0.02, 0.9, 0.9),  # exposures follow the light, smoothly
}
FIRST_KINDS, _KINDS_SHARE = 1000, 0.6  # the last seed without kinds, and the share of worlds above it that have one
_FAULTS_SHARE = (0.25, 0.4, 0.2, 0.15)  # of worlds with none to three faults


def _signed(rng: Rng, low: float, high: float) -> float:
    return float(rng.uniform(low, high) * rng.choice([-1, 1]))


def _turn(rng: Rng, low_rad: float, high_rad: float) -> np.ndarray:
    axis = rng.standard_normal(3)
    return rng.uniform(low_rad, high_rad) * axis / np.linalg.norm(axis)


def _zoom(rng: Rng, frames: int, rate_hz: float) -> Fault:
    begin_s = float(rng.uniform(0, 0.5) * frames / rate_hz)
    return zoom(round(_signed(rng, 0.003, 0.02), 4), round(begin_s, 2), round(begin_s + rng.uniform(0.5, 2), 2))


def _jitter(rng: Rng, frames: int, rate_hz: float) -> Fault:
    std_s = float(rng.uniform(0.3e-3, 3e-3))
    errors_s = np.clip(rng.normal(0, std_s, frames), -0.3 / rate_hz, 0.3 / rate_hz)
    errors_s[0] = 0.0
    return Fault(f"stamps of both images err by {1e3 * std_s:.2f} ms", stamp_error_s=lambda i: float(errors_s[i]))


def _exposure(rng: Rng, frames: int, rate_hz: float) -> Fault:
    steps = np.sort(rng.choice(np.arange(5, frames - 5), int(rng.integers(1, 4)), replace=False)).tolist()
    factors = np.cumprod([1.0, *np.exp([_signed(rng, 0.2, 0.5) for _ in steps])])
    factors = np.clip(factors, 0.4, 1.5)
    told = ", ".join(f"{factor:.2f} from frame {k}" for k, factor in zip(steps, factors[1:], strict=True))
    return Fault(
        f"exposures of both cameras step: {told}",
        gain=lambda i: float(factors[np.searchsorted(steps, i, side="right")]),
    )


def _dirt(rng: Rng, frames: int, rate_hz: float) -> Fault:
    spots, share = int(rng.integers(2, 9)), float(rng.uniform(0.04, 0.12))
    return Fault(
        f"dirt on both lenses: {spots} spots of {share:.0%} of the width", covers=(Dirt(_seed(rng), spots, share),)
    )


def _body(rng: Rng, frames: int, rate_hz: float) -> Fault:
    height, width, disparity = rng.uniform((0.1, 0.4, 0.05), (0.28, 1.0, 0.2)).tolist()
    return Fault(
        f"the own body covers up to {height:.0%} of the height along {width:.0%} of the lower edge",
        covers=(OwnBody(_seed(rng), height, width, disparity),),
    )


def _jpeg(rng: Rng, frames: int, rate_hz: float) -> Fault:
    quality = int(rng.integers(30, 61))
    return Fault(f"JPEG of quality {quality}", jpeg_quality=quality)


def _breathing(rng: Rng, frames: int, rate_hz: float) -> Fault:
    size, hz, phase = (
        float(rng.uniform(0.002, 0.008)),
        float(rng.uniform(0.2, 0.7)),
        float(rng.uniform(0, 2 * np.pi)),
    )
    return Fault(
        f"true focal lengths of both cameras are 1 + {size:.4f} sin({2 * np.pi * hz:.2f} t + {phase:.2f}) times the "
        "calibrated ones",
        focus=lambda t, i: float(1 + size * np.sin(2 * np.pi * hz * t + phase)),
    )


def _reflection(rng: Rng, frames: int, rate_hz: float) -> Fault:
    height, opacity, disparity = rng.uniform((0.3, 0.15, 0.02), (0.7, 0.4, 0.12)).tolist()
    return Fault(
        f"a reflection on a windscreen over {height:.0%} of the height, {opacity:.0%} of the light, with a disparity "
        f"of {disparity:.1%} of the width",
        covers=(Reflection(_seed(rng), height, opacity, disparity),),
    )


def _seed(rng: Rng) -> int:
    return int(rng.integers(2**31))


# Each draws its size: (rng, frames, rate_hz) -> fault.
DRAWN_FAULTS: dict[str, Callable[[Rng, int, float], Fault]] = {
    "late": lambda rng, frames, rate_hz: late(round(float(np.exp(rng.uniform(0, np.log(15)))), 2)),
    "readout": lambda rng, frames, rate_hz: rolling(round(float(rng.uniform(3, 35)), 1)),
    "focal": lambda rng, frames, rate_hz: focal(round(_signed(rng, 0.15, 0.5), 3)),
    "zoom": _zoom,
    "knock": lambda rng, frames, rate_hz: knock(_turn(rng, 3e-4, 2e-3), int(frames * rng.uniform(0.25, 0.75))),
    "slow_turn": lambda rng, frames, rate_hz: slow_turn(_turn(rng, 5e-6, 3e-5)),
    "jitter": _jitter,
    "exposure": _exposure,
    "dirt": _dirt,
    "body": _body,
    "jpeg": _jpeg,
}
ALL_FAULTS = DRAWN_FAULTS | {"breathing": _breathing, "reflection": _reflection}


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of world: its paths and places, its faults, how often it has inertial samples, and its shutter.

    No `places`: those of the path.
    """

    paths: tuple[str, ...]
    places: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    sampled: float = 0.5
    shutter_s: tuple[float, float] = (0.0, 0.0)


KINDS = {
    "shaken": Kind(("shaken",), ("hall", "corridor", "yard"), ("readout",), sampled=0.0),
    # An image shows the mean pose of its exposure, and the truth is that of its middle: short beside 1/80 s.
    "vibrating": Kind(("vibrating",), ("hall", "corridor", "yard"), shutter_s=(0.0005, 0.002)),
    "tiles": Kind(("hand_held", "walk", "drive", "spin"), ("tiled",)),
    "own body": Kind(("spin", "drive", "stop_and_go"), faults=("body",)),
    "windscreen": Kind(("drive", "stop_and_go"), ("street",), ("reflection",)),
    "breathing": Kind(("hand_held", "walk", "drive"), faults=("breathing",), sampled=1.0),
    "stop and go": Kind(("stop_and_go",), ("street", "corridor", "yard"), sampled=1.0),
}


def drawn_rig(rng: Rng, kind: str, width: int, outdoors: bool) -> StereoRig:
    """A pair of one of the `RIGS`; outdoors with a baseline three times as long."""
    fov_deg = rng.uniform(*{"wide": (92, 108), "small": (60, 75)}.get(kind, (65, 82)))
    baseline_m = rng.uniform(*{"small": (0.045, 0.065)}.get(kind, (0.1, 0.2))) * (3 if outdoors else 1)
    converging_deg = rng.uniform(1, 3) if kind == "converging" else rng.uniform(-0.3, 0.3)
    lens = {"wide": (-0.03, 0.004), "unrectified": (-0.17, 0.05)}.get(kind, (-0.05, 0.012))
    off = (1.5, 0.06) if kind == "unrectified" else (0.25, 0.01)  # degrees, and shares of the baseline
    height, f = 3 * width // 4, width / 2 / np.tan(np.deg2rad(fov_deg / 2))

    def camera() -> Camera:
        fx = f * (1 + rng.normal(0, 0.004))
        k = np.array(
            [[fx, 0, width * rng.uniform(0.485, 0.515)], [0, fx, height * rng.uniform(0.485, 0.515)], [0, 0, 1]]
        )
        d = (*(np.array(lens) * rng.uniform(0.9, 1.1, 2)), *rng.normal(0, 3e-4, 2), 0.0)
        return Camera(width, height, k, tuple(map(float, d)), "plumb_bob")

    left, right = camera(), camera()
    turn = np.deg2rad(rng.uniform(-off[0], off[0], 3) - converging_deg * np.eye(3)[1])
    at = baseline_m * np.array([1, *rng.uniform(-off[1], off[1], 2)])
    return StereoRig(left, right, se3.inverse(se3.from_rotation_translation(se3.exp_so3(turn), at)))


@dataclass(frozen=True)
class World:
    """All that a seed draws. `asked`: faults by name, or how many; None for as many as the seed has.

    `kind`: of `KINDS`, if it has one; `imu`: the unit whose samples the log has, if any.
    """

    seed: int
    asked: tuple[str, ...] | int | None
    path: str
    place: str
    rig: str
    light: str
    movers: int
    repetition: bool
    width: int
    frames: int
    rate_hz: float
    kind: str | None = None
    imu: str | None = None

    def _rng(self, stream: int) -> Rng:
        return np.random.default_rng((self.seed, stream))

    @cached_property
    def faults(self) -> dict[str, Fault]:
        """By name; the size of each depends on seed and name alone. Dirt lies behind, the body before the others."""
        rng, names = self._rng(1), list(DRAWN_FAULTS)
        count = int(rng.choice(len(_FAULTS_SHARE), p=_FAULTS_SHARE))
        order = rng.permutation(names).tolist()
        if self.asked is not None:
            wanted = self.asked if isinstance(self.asked, tuple) else order[: self.asked]
        else:
            wanted = order[:count] if self.kind is None else KINDS[self.kind].faults
        return {
            name: draw(self._rng(100 + k), self.frames, self.rate_hz)
            for k, (name, draw) in enumerate(ALL_FAULTS.items())
            if name in wanted
        }

    def clean(self) -> Recording:
        """Build the recording without faults, which takes some seconds."""
        duration_s = self.frames / self.rate_hz
        site = SITES[self.place](self._rng(2), self.repetition)
        path = WAYS[self.path](self._rng(3), site, duration_s)
        boxes, bodies = passers(self._rng(4), site, path, duration_s, self.movers)
        rig = drawn_rig(self._rng(5), self.rig, self.width, site.outdoors)
        scene = build_scene((*site.boxes, *boxes), self.seed, site.texel_m)
        rng, size = self._rng(6), 0.3 if self.light == "drifting" else 0.03
        hz, phase = rng.uniform(0.1, 0.4), rng.uniform(0, 2 * np.pi)

        def gains(i: int) -> tuple[float, float]:
            gain = 1 + size * np.sin(2 * np.pi * hz * i / self.rate_hz + phase)
            return gain, gain

        shutter_s = 0.0 if self.kind is None else float(self._rng(8).uniform(*KINDS[self.kind].shutter_s))
        return Recording(
            scene, rig, self.frames, self.rate_hz, path, bodies, gains, shutter_s, LIGHTS[self.light],
            sampling=FOUR_RAYS,
        )  # fmt: skip

    def with_faults(self, clean: Recording) -> Recording:
        """The recording with the faults of this world; `clean` is the one without."""
        for fault in self.faults.values():
            clean = fault.applied(clean)
        return clean

    @property
    def scene_truth(self) -> str:
        """What was drawn beside the faults, in a line."""
        kind = "" if self.kind is None else f"{self.kind}: "
        samples = "" if self.imu is None else f", samples of a {self.imu}"
        movers, again = f"{self.movers or 'nobody'} passing", ", repeating" * self.repetition
        return (
            f"{kind}{self.path}, {self.place}{again}, {self.rig} rig, {self.light} light, {movers}, "
            f"{self.frames} frames of {self.width} px at {self.rate_hz:g} Hz{samples}"
        )

    @property
    def faults_told(self) -> str:
        """The faults with their sizes, shorter than `truth`."""
        return ", ".join(f"{name} {_size_told(fault)}".strip() for name, fault in self.faults.items()) or "none"

    @property
    def truth(self) -> str:
        """What was drawn, in a line."""
        return f"{self.scene_truth}; faults: {'; '.join(f'{k}: {v.truth}' for k, v in self.faults.items()) or 'none'}"


def _size_told(fault: Fault) -> str:
    """The size of a fault in its unit, where one number has it."""
    if fault.right_late_s or fault.readout_s:
        return f"{1e3 * (fault.right_late_s or fault.readout_s):.3g} ms"
    if fault.calibrated_focal != 1:
        return f"{100 * (fault.calibrated_focal - 1):+.2g} %"
    return str(fault.jpeg_quality or "")


def drawn_world(seed: int, asked: tuple[str, ...] | int | None = None) -> World:
    """Draw the world of a seed."""
    rng = np.random.default_rng((seed, 0))
    path = str(rng.choice(list(PATHS)))
    world = World(
        seed,
        asked,
        path=path,
        place=str(rng.choice(PATHS[path])),
        rig=str(rng.choice(RIGS)),
        light=str(rng.choice(list(LIGHTS))),
        movers=int(rng.integers(1, 4) if path == "stand" else rng.choice([0, 0, 0, 1, 2, 3])),
        repetition=bool(rng.random() < 0.2),
        width=int(rng.choice([320, 400, 480])),
        frames=int(rng.integers(60, 101)),
        rate_hz=float(rng.choice([10, 12.5, 15] if path in ("drive", "stop_and_go") else [15, 20, 25])),
    )
    return world if seed <= FIRST_KINDS else _of_kind(world)


def _of_kind(world: World) -> World:
    """The world as a kind of it, where its seed has one; drawn by a generator of its own."""
    rng = np.random.default_rng((world.seed, 7))
    if rng.random() >= _KINDS_SHARE:
        return world
    name = str(rng.choice(list(KINDS)))
    kind = KINDS[name]
    path = str(rng.choice(kind.paths))
    place = str(rng.choice(kind.places or PATHS[path]))
    imu = str(rng.choice(list(UNITS))) if rng.random() < kind.sampled else None
    repetition = world.repetition or place == "tiled"
    return replace(world, path=path, place=place, repetition=repetition, kind=name, imu=imu)
