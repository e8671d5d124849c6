"""A recording to render: a scene with what moves in it, a rig, a path, a shutter and exposures."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

from .caster import Sensor, Shot, render_exposure
from .scene import Scene

Array = NDArray[np.float64]
Place = tuple[tuple[float, float, float], float]  # centre_m, yaw_deg
BLUR_MOMENTS = 8  # instants of an open shutter: their images lie a pixel apart at 8 px of blur


@dataclass(frozen=True, slots=True)
class Recording:
    """All that `shot` needs; times in seconds from the first frame.

    `path(t)` (4, 4): the left camera in the world of the scene. `bodies(t)`: where moving boxes are. `gains(i)`: of
    the left and the right camera in frame i. `shutter_s`: how long the shutter is open, 0 for no blur.
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

    def pose(self, i: int) -> Array:
        """world_from_cam (4, 4) of frame i: the world is the first left camera."""
        return se3.inverse(self.path(0.0)) @ self.path(i / self.rate_hz)

    def shot(self, i: int, seed: int) -> Shot:
        """Both images and the depth of frame i."""
        middle_s = i / self.rate_hz
        open_s = self.shutter_s * ((np.arange(BLUR_MOMENTS) + 0.5) / BLUR_MOMENTS - 0.5)
        middle = self._moment(middle_s)
        moments = [self._moment(middle_s + dt) for dt in open_s] if self.shutter_s else [middle]
        left, right = self.gains(i)
        s = self.sensor
        sensor = Sensor(s.read_noise, s.shot_noise, s.gain_left * left, s.gain_right * right)
        return render_exposure(moments, middle, self.rig, sensor, (seed, i))

    def _moment(self, t: float) -> tuple[Scene, Array]:
        return self.scene.with_boxes_at(self.bodies(t)), self.path(t)
