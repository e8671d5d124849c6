"""Settings from TOML and as TOML.

Unknown keys and values out of range are ConfigErrors that name the setting.
"""

import json
from collections.abc import Iterator
from functools import cache, lru_cache
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from ..errors import ConfigError, as_error
from ..system.inputs import LIMITS, parse_toml, read_small
from ..system.wording import invalid_setting
from .rules import Rules, kinds_of_rules
from .section import Section
from .settings import Config


def read_config(path: str | Path | None, overrides: list[str] | tuple[str, ...] = ()) -> Config:
    """Read the configuration of a TOML file (None: the defaults), then apply `section.key=value` overrides.

    Raises ConfigError naming the file and the key.
    """
    data: dict[str, Any] = {}
    where = ""
    if path is not None:
        where = f" in {path}"
        with (
            as_error(ConfigError, f"cannot read configuration {path}", OSError),
            as_error(ConfigError, f"configuration {path} is not TOML", ValueError, RecursionError),
        ):
            data = parse_toml(read_small(path, LIMITS.settings_bytes).decode("utf-8-sig"))
    for override in overrides:
        _apply(override, data)
    expert = data.pop("expert", {})
    if not isinstance(expert, dict) or not all(isinstance(section, dict) for section in expert.values()):
        raise ConfigError(f"configuration{where}: expert holds sections only, such as [expert.frontend]")
    _merge(expert, data, "", where)
    kind = _kind_of_file()
    try:
        found = msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        known = msgspec.to_builtins({**msgspec.structs.asdict(Config()), "rules": kind().rules})
        text = invalid_setting(str(error), data, known)
        raise ConfigError(f"configuration{where}: {text}", hint=("config_to_toml",)) from None
    rules = (getattr(found.rules, name) for name in kinds_of_rules())
    changed = tuple(section for section in rules if section != type(section)())
    settings = {name: getattr(found, name) for name in Config.__struct_fields__}
    return Config(**{**settings, "rules": Rules(changed)})


@cache
def _kind_of_file() -> type[Any]:
    """Return the kind of what a file holds: a Config in which the rules of each room have their name."""
    sections = [(name, kind, kind()) for name, kind in kinds_of_rules().items()]
    rules = msgspec.defstruct("Rules", sections, bases=(Section,), frozen=True)
    return msgspec.defstruct("Config", [("rules", rules, rules())], bases=(Config,), frozen=True)


def _merge(expert: dict[str, Any], data: dict[str, Any], path: str, where: str) -> None:
    """Add the settings of sections such as [expert.frontend] to [frontend], which may also be present."""
    for key, value in expert.items():
        known = data.get(key)
        if isinstance(value, dict) and isinstance(known, dict):
            _merge(value, known, f"{path}{key}.", where)
        elif key in data:
            raise ConfigError(f"configuration{where}: {path}{key} is set twice, also as expert.{path}{key}")
        else:
            data[key] = value


def _apply(override: str, data: dict[str, Any]) -> None:
    """Apply an override such as `window.frames=12` to the content of a TOML file."""
    key, sign, text = override.partition("=")
    if not sign:
        raise ConfigError(f"setting {override!r} has no value: write KEY=VALUE, for example window.frames=12")
    try:
        value = parse_toml(f"x = {text}")["x"]
    except (ValueError, RecursionError):
        value = text  # a bare word is a string
    *sections, leaf = key.strip().split(".")
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise ConfigError(f"setting {override!r}: {section} is not a section")
    data[leaf] = value


def setting_names() -> list[str]:
    """Every setting with its section, such as `window.frames`."""
    return [".".join(filter(None, (name, key))) for name, part in _sections(Config()) for key in _keys(type(part))]


@lru_cache(maxsize=8)  # a run writes it twice, into two files
def config_to_toml(config: Config, expert: bool = True) -> str:
    """Return the configuration as commented TOML, which `read_config` reads back unchanged.

    Without `expert`, settings that few runs need are left out, unless they differ from their defaults.
    """
    lines = ["# stream_sfm configuration; every setting may be left out"]
    if not expert:
        lines.append("# settings that few runs need are omitted; they are in sections such as [expert.frontend]")
    for name, section in _sections(config):
        metas = _keys(type(section))
        plain = [key for key, meta in metas.items() if not (meta.extra or {}).get("expert")]
        rest = [key for key in metas if key not in plain]
        if not expert:
            defaults = type(section)()
            rest = [key for key in rest if getattr(section, key) != getattr(defaults, key)]
        lines += _section_lines(name, section, plain)
        lines += _section_lines(f"expert.{name}", section, rest)
    return "\n".join(lines) + "\n"


def _sections(config: Config) -> Iterator[tuple[str, Section]]:
    """Return names and sections; the first has no name and holds the settings outside any section."""
    yield "", config
    values = ((name, getattr(config, name)) for name in config.__struct_fields__ if name != "rules")
    yield from ((name, value) for name, value in values if isinstance(value, Section))
    yield from ((f"rules.{name}", config.rules.of(kind)) for name, kind in kinds_of_rules().items())


@cache
def _keys(kind: type[Section]) -> dict[str, Meta]:
    """Return the settings of a kind of section, without its subsections."""
    hints = get_type_hints(kind, include_extras=True)
    return {key: hint.__metadata__[0] for key, hint in hints.items() if get_origin(hint) is Annotated}


def _section_lines(name: str, section: Section, keys: list[str]) -> list[str]:
    if not keys:
        return []
    metas = _keys(type(section))
    purpose = (type(section).__doc__ or "").partition("\n")[0]  # empty if Python has removed docstrings (-OO)
    lines = ["", f"[{name}]  # {purpose}"] if name else []
    for key in keys:
        lines += [f"# {metas[key].description}", f"{key} = {json.dumps(getattr(section, key), ensure_ascii=False)}"]
    return lines
