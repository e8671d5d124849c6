"""Every setting of the package: sections of frozen structs, units in the names, read from and written to TOML."""

from .sections import DenseConfig as DenseConfig
from .sections import FrontendConfig as FrontendConfig
from .sections import ImuConfig as ImuConfig
from .sections import MotionConfig as MotionConfig
from .sections import RigConfig as RigConfig
from .sections import RosConfig as RosConfig
from .sections import WindowConfig as WindowConfig
from .settings import Config as Config
from .toml_text import config_to_toml as config_to_toml
from .toml_text import read_config as read_config
from .toml_text import setting_names as setting_names
