"""`stream-sfm config`: the settings as commented TOML."""

from . import options


def config(*, expert: options.ResultFlag = False, settings: options.Settings = options.Settings()) -> None:
    """Print the settings as commented TOML, which --config reads.

    Prints the defaults, changed by --config and --set.

    Args:
        expert: print all settings, including those that few runs need
    """
    from ..config import config_to_toml

    print(config_to_toml(settings.read(), expert=expert), end="")
