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
        (lambda: sfm.Config(method=3), r"Config\(method=3\): give text"),
        (lambda: sfm.Config(mono="yes"), r"Config\(mono='yes'\): give true or false"),
        (lambda: WindowConfig(frames=0), r"WindowConfig\(frames=0\): give a whole number of at least 1"),
        (lambda: WindowConfig(frames=4.5), r"WindowConfig\(frames=4.5\): give a whole number"),
        (lambda: FrontendConfig(renew_fraction=float("nan")), r"renew_fraction=nan\): give a number of at least 0"),
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


@pytest.mark.parametrize(
    "override, message",
    [
        ("window.frames=0", r"setting window\.frames is 0; it must be a whole number of at least 1"),
        ("window.frames=100", r"setting window\.frames is 100; it must be a whole number of at most 64"),
        ("window.frames=many", r"setting window\.frames is 'many'; it must be a whole number"),
        ("motion.std_acceleration_m_s2=0", r"it must be a number greater than 0"),
        ("mono=1", r"setting mono is 1; it must be true or false"),
        ("window=3", r"setting window is 3; it must be a section"),
        ("window.frame=8", r"unknown setting 'window\.frame'; did you mean window\.frames\?"),
        ("widow.frames=8", r"unknown section 'widow'; did you mean window\?"),
        ("nonsense=1", r"unknown setting 'nonsense'; known are method, mono, estimate_every, frontend"),
    ],
)
def test_a_file_is_refused_with_the_setting_and_what_it_must_be(override: str, message: str) -> None:
    with pytest.raises(sfm.ConfigError, match=message):
        read_config(None, [override])


def test_what_is_made_in_python_is_what_is_read(tmp_path) -> None:
    made = sfm.Config(method="ekf", window=WindowConfig(frames=12), frontend=FrontendConfig(renew_fraction=1))
    (tmp_path / "c.toml").write_text(config_to_toml(made))
    assert read_config(tmp_path / "c.toml") == made
