"""The base of all sections of settings: frozen and checked, each setting with its meaning and bounds."""

from functools import cache

import msgspec
from msgspec import Meta
from msgspec.structs import FieldInfo

from ..errors import ConfigError
from ..system.wording import expected


def number(description: str, least: float, most: float) -> Meta:
    """Return the meaning of a number and its bounds, which are inclusive."""
    return Meta(description=description, ge=least, le=most)


def expert(description: str, least: float | None = None, most: float | None = None) -> Meta:
    """Return the same for a setting that few runs need, printed in a section such as [expert.frontend]."""
    return Meta(description=description, ge=least, le=most, extra={"expert": True})


@cache
def _fields(kind: type[msgspec.Struct]) -> tuple[FieldInfo, ...]:
    return msgspec.structs.fields(kind)  # takes 0.3 ms, as annotations are read


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The base of all sections; every value is checked when a section is made, in Python or from a file."""

    def __post_init__(self) -> None:
        for field in _fields(type(self)):
            if (value := getattr(self, field.name)) is field.default:
                continue
            given = f"{type(self).__name__}({field.name}={value!r})"
            if isinstance(field.default, Section):
                kind = type(field.default)
                if not isinstance(value, kind):
                    example = f"{kind.__name__}({kind.__struct_fields__[0]}={kind.__struct_defaults__[0]!r})"
                    raise ConfigError(f"{given}: give a {kind.__name__}, as in {field.name}={example}")
                continue
            try:
                msgspec.convert(value, field.type)
            except msgspec.ValidationError as error:
                raise ConfigError(f"{given}: give {expected(str(error))}", hint=("config_to_toml",)) from None
