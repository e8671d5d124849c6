"""Every setting of the package: sections of frozen structs, units in the names, read from and written to TOML."""

from .sections import (
    DenseConfig,
    FrontendConfig,
    ImuConfig,
    MotionConfig,
    RigConfig,
    RobustConfig,
    RosConfig,
    WindowConfig,
)
from .settings import Config
from .toml_text import config_to_toml, read_config, setting_names

__all__ = [
    "Config",
    "DenseConfig",
    "FrontendConfig",
    "ImuConfig",
    "MotionConfig",
    "RigConfig",
    "RobustConfig",
    "RosConfig",
    "WindowConfig",
    "config_to_toml",
    "read_config",
    "setting_names",
]
