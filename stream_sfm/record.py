"""Records: the data passed between stages, and the states that stages take and return.

A field of a record may have one description: its kind, which determines the effect of a change of frames; its shape in
a file, where arrays are flat; the text that explains it in a file; and whether it is a column of a table.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from enum import Enum, auto
from typing import Any, NamedTuple, Protocol, TypeVar, cast, dataclass_transform

import msgspec
import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
def record(cls: type[T]) -> type[T]:
    """Make a class an immutable record; `changed` returns a changed copy.

    It is a frozen msgspec struct, for which no code is generated and compiled: it takes a tenth of the time of a
    dataclass to define, and a third to fill. `fields`, `replace` and `asdict` of `dataclasses` accept it as well.
    Records contain arrays, so they are neither compared nor printed.
    """
    members = {name: _member(value) for name, value in vars(cls).items() if name not in ("__dict__", "__weakref__")}
    members = {"__repr__": object.__repr__, "__dataclass_fields__": _Fields(cls)} | members
    members["__annotations__"] = cls.__annotations__  # from Python 3.14 on they are not among the members
    struct: Any = type(msgspec.Struct)
    made: type[T] = struct(cls.__name__, (msgspec.Struct,), members, frozen=True, eq=False, dict=True)
    return made


def _member(value: Any) -> Any:
    """Return a member of a struct; a `default_factory` becomes that of msgspec, which is called for each record."""
    factory: Any = value.default_factory if isinstance(value, Field) else None
    return value if factory is None else msgspec.field(default_factory=factory)


class _Fields:
    """The fields of a record for `dataclasses`, made on first use, as this takes some 0.1 ms."""

    def __init__(self, cls: type) -> None:
        self._cls = cls

    def __get__(self, _: Any, of: Any) -> dict[str, Field[Any]]:
        cls: Any = dataclass(init=False, eq=False, repr=False)(self._cls)
        found: dict[str, Field[Any]] = cls.__dataclass_fields__
        of.__dataclass_fields__ = found
        return found


def filled(cls: type[T], parts: Any, **others: Any) -> T:
    """Return a record from a result of the compiled core, with fields of the same names, and from other fields."""
    return cls(**dict(zip(type(parts).__match_args__, parts, strict=True)), **others)


class _Changed(Protocol):
    def __call__(self, of: T, /, **fields: Any) -> T: ...


changed: _Changed = cast(Any, msgspec.structs.replace)
"""Return a record with other values in some fields. Raises TypeError for an unknown field."""


settle: Callable[[Any, str, Any], None] = msgspec.structs.force_setattr
"""Set a field of a record while it is made: in its `__post_init__`, which checks and converts what was given."""


class Kind(Enum):
    """The kind of a field whose value depends on the frame of reference."""

    FRAMES = auto()  # one frame index, or several
    TRACKS = auto()  # ids of tracks
    POSES = auto()  # one pose in the world (4, 4), or several
    COV_POSE = auto()  # the covariance (6, 6) of the perturbation on the right of a pose in the world
    POINTS = auto()  # points (n, 3) in the world
    COV_POINTS = auto()  # their covariances (n, 3, 3)
    PARTS = auto()  # a record with such fields


class About(NamedTuple):
    """The description of a field, in its annotation: `Annotated[Array, About(Kind.POSES, shape=(4, 4))]`.

    `shape`: the shape of the value, whose array is flat in a file; -1 stands for the remaining size, a text for a size
    that several fields share. `of`: for a covariance, the field that it belongs to. `says`: the text that explains the
    field in a file of estimates; a field without it is not written as it is. `column`: the field is a column in tables
    of frames, too.
    """

    kind: Kind | None = None
    shape: tuple[int | str, ...] | None = None
    of: str = ""
    says: str = ""
    column: bool = False

    def __repr__(self) -> str:
        return repr(self.says or (self.kind and self.kind.name.lower()) or self.shape)


def about(described: Field[Any]) -> About:
    """Return the description of a field, empty if there is none."""
    return next((x for x in getattr(described.type, "__metadata__", ()) if isinstance(x, About)), About())


def plain_type(described: Field[Any]) -> Any:
    """Return the type of a field without its description."""
    return getattr(described.type, "__origin__", described.type)


Change = Callable[[Any, Any], Any]


def with_changes(of: T, changes: Mapping[Kind, Change]) -> T:
    """Return a dataclass with `changes` applied to its fields of each kind, also in its parts.

    A change is called with the value and, for a covariance, with the value of the field that it belongs to. Fields of
    other kinds are not changed.
    """
    values = {}
    for each in fields(of):  # type: ignore[arg-type]
        value, meaning = getattr(of, each.name), about(each)
        if value is not None and meaning.kind is Kind.PARTS:
            values[each.name] = with_changes(value, changes)
        elif value is not None and meaning.kind is not None and meaning.kind in changes:
            values[each.name] = changes[meaning.kind](value, getattr(of, meaning.of or each.name))
    return replace(of, **values)  # type: ignore[type-var]


def indices(rows: NDArray[Any] | slice) -> NDArray[np.intp] | slice:
    """Return the rows of a mask as indices; indices and slices as they are."""
    return rows.nonzero()[0] if not isinstance(rows, slice) and rows.dtype == bool else rows


def rows_of(column: NDArray[Any], rows: NDArray[Any] | slice) -> NDArray[Any]:
    """Return some rows (indices, mask or slice) of an array (n, …).

    Indexing takes four times as long as NumPy's `take` where a row is more than a number.
    """
    rows = indices(rows)
    return column[rows] if isinstance(rows, slice) else column.take(rows, axis=0)


def columns_at(columns: Iterable[NDArray[Any]], rows: NDArray[Any] | slice) -> list[NDArray[Any]]:
    """Return the same rows of several arrays, as `rows_of` does; a mask is converted only once."""
    rows = indices(rows)
    if isinstance(rows, slice):
        return [column[rows] for column in columns]
    return [column.take(rows, axis=0) for column in columns]
