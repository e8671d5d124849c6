"""All settings in one struct."""

from typing import Annotated

from msgspec import Meta

from ..errors import ConfigError
from .rules import Rules
from .section import Section
from .sections import (
    DenseConfig,
    FrontendConfig,
    ImuConfig,
    MotionConfig,
    RigConfig,
    RosConfig,
    WindowConfig,
)


class Config(Section, frozen=True, kw_only=True):
    """All settings; each has a default."""

    method: Annotated[
        str, Meta(description="estimator: cross-frame, ekf, frame-to-frame, or another name in stream_sfm.methods")
    ] = "cross-frame"
    mask_left: Annotated[
        str, Meta(description="PNG of the left images' size, black where they show the robot or dirt; empty: none")
    ] = ""
    mask_right: Annotated[
        str, Meta(description="PNG of the right images' size, black where they show the robot or dirt; empty: none")
    ] = ""
    mono: Annotated[bool, Meta(description="use the left camera only; lengths have no unit")] = False
    frontend: FrontendConfig = FrontendConfig()
    window: WindowConfig = WindowConfig()
    motion: MotionConfig = MotionConfig()
    rig: RigConfig = RigConfig()
    imu: ImuConfig = ImuConfig()
    ros: RosConfig = RosConfig()
    dense: DenseConfig = DenseConfig()
    rules: Rules = Rules()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mono and self.method != "cross-frame":
            raise ConfigError(f"method {self.method} needs two cameras: with mono the method is cross-frame")

    def needs_scale(self, what: str) -> None:
        """Raise a ConfigError if `what` was requested with one camera."""
        if self.mono:
            raise ConfigError(f"{what} needs two cameras: leave mono out of the configuration")
