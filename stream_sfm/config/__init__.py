"""Every setting of the package: sections of frozen structs, units in the names, read from and written to TOML."""

from .rules import (
    ErrorRules,
    FlowRules,
    MonoRules,
    MotionRules,
    PairRules,
    RepetitionRules,
    RowRules,
    Rules,
    StartRules,
    StepRules,
    TurnRules,
)
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
    "ErrorRules",
    "FlowRules",
    "FrontendConfig",
    "ImuConfig",
    "MonoRules",
    "MotionConfig",
    "MotionRules",
    "PairRules",
    "RepetitionRules",
    "RigConfig",
    "RobustConfig",
    "RosConfig",
    "RowRules",
    "Rules",
    "StartRules",
    "StepRules",
    "TurnRules",
    "WindowConfig",
    "config_to_toml",
    "read_config",
    "setting_names",
]
