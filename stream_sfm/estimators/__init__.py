"""Everything that turns observations into motion and structure; each keeps the contract `types.Estimator`.

Not here: pixels of images (`frontend/`), files (`recording/`). Equations "(n)" are those of docs/mathematics.md.

`METHODS` is the list: name -> (module, class). They are imported when asked for, so that a method's heavy
dependency (filterpy for the EKF) costs nothing to the others.
"""

from importlib import import_module

from ..config import Config
from ..errors import ConfigError
from ..geometry.stereo import StereoProjection
from ..types import Estimator

METHODS: dict[str, tuple[str, str]] = {
    "cross-frame": ("cross_frame.window", "CrossFrame"),
    "cross-frame-wc": ("baselines.per_point", "CrossFrameWC"),
    "cross-frame-cc": ("baselines.per_point", "CrossFrameCC"),
    "cross-frame-cc-literal": ("baselines.per_point", "CrossFrameCCLiteral"),
    "ekf": ("baselines.ekf", "Ekf"),
    "ekf-cv": ("baselines.ekf", "EkfConstantVelocity"),
    "frame-to-frame": ("baselines.frame_to_frame", "FrameToFrame"),
    "depth-filter": ("baselines.per_point", "DepthFilter"),
}


def make_estimator(name: str, projection: StereoProjection, config: Config) -> Estimator:
    """A fresh estimator for one sequence. Raises ConfigError for a name that is not in METHODS."""
    if projection.virtual_right:
        from .cross_frame.mono import CrossFrameMono

        return CrossFrameMono(projection, config)
    if name not in METHODS:
        raise ConfigError(f"method {name!r} is not known; known are {', '.join(METHODS)}")
    module, attribute = METHODS[name]
    kind = getattr(import_module(f"{__name__}.{module}"), attribute)
    estimator: Estimator = kind(projection, config)
    return estimator
