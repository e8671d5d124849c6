"""Settings are refused where they are made, with what was given and what is wanted."""

from typing import Any

import pytest

import stream_sfm as sfm
from stream_sfm.config import FrontendConfig, WindowConfig, config_to_toml, read_config


@pytest.mark.parametrize(
    "make,message",
    [
        (lambda: sfm.Config(window=3), r"Config\(window=3\): give a WindowConfig, as in window=WindowConfig"),
        (lambda: sfm.Config(window={"frames": 3}), r"Config\(window={'frames': 3}\): give a WindowConfig"),
        (lambda: sfm.Config(window=FrontendConfig()), r"give a WindowConfig"),
        (lambda: sfm.Config(method=3), r"Config\(method=3\): Expected `str`, got `int`"),
        (lambda: sfm.Config(mono="yes"), r"Config\(mono='yes'\): Expected `bool`, got `str`"),
        (lambda: WindowConfig(frames=0), r"WindowConfig\(frames=0\): Expected `int` >= 1"),
        (lambda: WindowConfig(frames=4.5), r"WindowConfig\(frames=4.5\): Expected `int`, got `float`"),
        (lambda: FrontendConfig(renew_fraction=float("nan")), r"renew_fraction=nan\): Expected `float` >= 0"),
    ],
)
def test_a_setting_of_the_wrong_kind_is_refused_when_it_is_made(make: Any, message: str) -> None:
    with pytest.raises(sfm.ConfigError, match=message):
        make()


def test_settings_are_given_by_name_and_unknown_names_are_refused() -> None:
    with pytest.raises(TypeError, match="positional"):
        WindowConfig(8)
    with pytest.raises(TypeError, match="windw"):
        sfm.Config(windw=WindowConfig())


def test_a_file_is_refused_with_the_path_of_the_setting() -> None:
    with pytest.raises(sfm.ConfigError, match=r"configuration: Expected `int` >= 1 - at `window.frames`"):
        read_config(None, ["window.frames=0"])


def test_what_is_made_in_python_is_what_is_read(tmp_path) -> None:
    made = sfm.Config(method="ekf", window=WindowConfig(frames=12), frontend=FrontendConfig(renew_fraction=1))
    (tmp_path / "c.toml").write_text(config_to_toml(made))
    assert read_config(tmp_path / "c.toml") == made
