"""A recording to render: a scene with what moves in it, a rig, a path, a shutter and exposures."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

from .caster import NINE_RAYS, Sampling, Sensor, depth_of, exposed, image_of
from .covers import Cover, covered
from .scene import Scene

Array = NDArray[np.float64]
Place = tuple[tuple[float, float, float], float]  # centre_m, yaw_deg
SIDES = ("left", "right")


@dataclass(frozen=True, slots=True)
class Shot:
    """Raw images (h, w) uint8, and z-depth (h, w) float64, metres, at the pixel centres of the raw left image."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    depth_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class View:
    """What one image is made of, beside scene and path. Equal views of one recording give equal images."""

    camera: Camera
    left_from_camera: Array
    stamp_s: float  # of the exposure
    gain: float
    seed: tuple[int, ...]  # of the noise
    covers: tuple[Cover, ...] = ()


@dataclass(frozen=True, slots=True)
class Recording:
    """All that is needed to render images and their ground truth; times in seconds from the first frame.

    `rig`: what the log's calibration says. `path(t)` (4, 4): the left camera in the world of the scene. `bodies(t)`:
    where moving boxes are. `gains(i)`: of the left and the right camera in frame i. `shutter_s`: how long the shutter
    is open, 0 for no blur. `readout_s`: of a rolling shutter, see `image_of`. `right_late_s`: by how much the right
    camera exposes after the stamp. `true_rig(i)`: the rig that takes frame i, where the calibration is wrong.
    `stamp_error_s(i)`: of the stamp of frame i, which the left camera exposes at i / rate_hz. `covers`: layers over all
    images. `jpeg_quality`: None for what the writer of the log prefers. `sampling`: rays of a pixel.
    """

    scene: Scene
    rig: StereoRig
    frames: int
    rate_hz: float
    path: Callable[[float], Array]
    bodies: Callable[[float], Mapping[int, Place]] = lambda _: {}
    gains: Callable[[int], tuple[float, float]] = lambda _: (1.0, 1.0)
    shutter_s: float = 0.0
    sensor: Sensor = field(default_factory=Sensor)
    readout_s: float = 0.0
    right_late_s: float = 0.0
    true_rig: Callable[[int], StereoRig] | None = None
    stamp_error_s: Callable[[int], float] = lambda _: 0.0
    covers: tuple[Cover, ...] = ()
    jpeg_quality: int | None = None
    sampling: Sampling = NINE_RAYS

    def pose(self, i: int) -> Array:
        """world_from_cam (4, 4) of frame i as it is exposed: the world is the first left camera."""
        return se3.inverse(self.path(0.0)) @ self.path(i / self.rate_hz)

    def view(self, i: int, side: str, seed: int) -> View:
        """What the image of a side in frame i is made of."""
        rig = self.true_rig(i) if self.true_rig else self.rig
        k = SIDES.index(side)
        gain = self.gains(i)[k] * (self.sensor.gain_left, self.sensor.gain_right)[k]
        left_from_camera = se3.inverse(rig.right_from_left) if k else np.eye(4)
        stamp_s = i / self.rate_hz + k * self.right_late_s
        return View(rig.cameras[side], left_from_camera, stamp_s, gain, (seed, i, k), self.covers)

    def image(self, view: View) -> NDArray[np.uint8]:
        """The raw image of a view."""

        def moment(t: float) -> tuple[Scene, Array]:
            return self._scene(t), self.scene.room_from_world @ self.path(t) @ view.left_from_camera

        light = image_of(view.camera, moment, view.stamp_s, self.shutter_s, self.readout_s, self.sampling)
        light = covered(light, view.covers, view.seed[-1])
        return exposed(light, view.gain, self.sensor, view.seed)

    def depth_m(self, i: int) -> Array:
        """z-depth (h, w), metres, that the raw left camera of frame i has at the stamp, in all rows."""
        rig = self.true_rig(i) if self.true_rig else self.rig
        t = i / self.rate_hz
        return depth_of(self._scene(t), rig.left, self.scene.room_from_world @ self.path(t))

    def shot(self, i: int, seed: int) -> Shot:
        """Both images and the depth of frame i."""
        left, right = (self.image(self.view(i, side, seed)) for side in SIDES)
        return Shot(left, right, self.depth_m(i))

    def wandering(self, seed: int) -> "Recording":
        """Held by a hand that wanders by some centimetres and degrees, as the seed has it; the same for seed 0."""
        if not seed:
            return self
        rng = np.random.default_rng(seed)
        size = rng.normal(0, 1, (3, 6)) * (0.02, 0.02, 0.02, 0.015, 0.015, 0.015)  # metres, radians
        frequency_hz, phase = rng.uniform(0.1, 0.6, (3, 6)), rng.uniform(0, 2 * np.pi, (3, 6))

        def path(t: float) -> Array:
            return self.path(t) @ se3.exp((size * np.sin(2 * np.pi * frequency_hz * t + phase)).sum(0))

        return replace(self, path=path)

    def _scene(self, t: float) -> Scene:
        return self.scene.with_boxes_at(self.bodies(t))
