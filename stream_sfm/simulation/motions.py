"""True camera paths: poses world_from_cam (n, 4, 4), of which the first is the world's origin."""

from dataclasses import dataclass

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array


@dataclass(frozen=True, slots=True)
class Motion:
    """A path of steps along +x with a steady turn about the vertical axis, and hand shake.

    `step_m` and `turn_rad` per frame. Each pose but the first is off the smooth path by a Gaussian of `shake_m` and
    `shake_rad` on each axis.
    """

    step_m: float
    turn_rad: float = 0.0
    shake_m: float = 0.0
    shake_rad: float = 0.0

    def poses(self, frames: int, rng: np.random.Generator) -> Array:
        """Draw the path (frames, 4, 4) of one trial."""
        step = se3.exp(np.array([self.step_m, 0, 0, 0, -self.turn_rad, 0]))
        path = np.empty((frames, 4, 4))
        path[0] = np.eye(4)
        for k in range(1, frames):
            path[k] = se3.orthonormalise(path[k - 1] @ step)
        shake = rng.normal(size=(frames, 6)) * np.repeat([self.shake_m, self.shake_rad], 3)
        shake[0] = 0
        return path @ se3.exp(shake)


# Paper: about 200 mm between frames. Ours: the shake, which keeps round-off noise from repeating itself; 10 mm, at
# which the path stays short against the depth of the scene; and the turn of 0.03 rad, a right angle in fifty frames.
MOTIONS = {
    "lateral": Motion(step_m=0.200, shake_m=0.005, shake_rad=0.005),
    "slow": Motion(step_m=0.010, shake_m=0.0005, shake_rad=0.005),
    "arc": Motion(step_m=0.200, turn_rad=0.03, shake_m=0.005, shake_rad=0.005),
}
