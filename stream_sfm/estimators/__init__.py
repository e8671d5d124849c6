"""Everything that turns observations into motion and structure; each method implements `types.Estimator`.

It does not read pixels (`frontend/` does) or files (`logs/recording/` does). Equations "(n)" are those of
docs/mathematics.md.

* `window/`: the default, `cross-frame`, a window with a joint prior, for two cameras and for one.
* `baselines/`: the methods to compare with, and the full batch, which is the bound for all of them.
* Shared: `initial_motion` (where every frame starts), `motion_model`, `lifecycle` (how maps begin and end),
  `triangulation`.

`methods.py` lists them by name. A method is imported on first use, so that the others do not pay for its heavy
dependency (filterpy for the EKF).
"""

from importlib import import_module

import msgspec

from ..config import Config
from ..errors import ConfigError
from ..geometry.stereo import StereoProjection
from ..methods import METHODS
from ..system.wording import unknown_name
from ..types import Estimator


def check_method(name: str) -> None:
    """Raise a ConfigError for a name that is not in METHODS."""
    if name not in METHODS:
        raise ConfigError(unknown_name("method", name, METHODS))


def make_estimator(name: str, projection: StereoProjection, config: Config) -> Estimator:
    """Return a new estimator for one sequence. Raises ConfigError for a name that is not in METHODS."""
    if projection.virtual_right:
        from .window.mono import CrossFrameMono

        return CrossFrameMono(projection, config)
    check_method(name)
    method = METHODS[name]
    if method.frames is not None:
        config = msgspec.structs.replace(config, window=msgspec.structs.replace(config.window, frames=method.frames))
    if not method.inertial:
        config = msgspec.structs.replace(config, imu=msgspec.structs.replace(config.imu, enabled=False))
    kind = getattr(import_module(f"{__name__}.{method.module}"), method.kind)
    estimator: Estimator = kind(projection, config)
    estimator.name = name
    return estimator
