"""Records: what stages hand to each other, and the states that they take and return."""

from dataclasses import dataclass, field
from typing import Any, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
def record(cls: type[T]) -> type[T]:
    """Make a class a dataclass with slots that nothing changes; `changed` returns a changed copy.

    The type checker sees to that, not Python: a frozen dataclass takes five times as long to fill, and three times as
    long to define. Records hold arrays, so they are neither compared nor printed. What users are given is frozen.
    """
    return dataclass(slots=True, eq=False, repr=False)(cls)


def changed(of: T, **fields: Any) -> T:
    """Return a record with other values in some fields; `dataclasses.replace` takes almost twice as long."""
    result = object.__new__(type(of))
    for name in type(of).__slots__:  # type: ignore[attr-defined]
        setattr(result, name, getattr(of, name))
    for name, value in fields.items():
        setattr(result, name, value)
    return result


def indices(rows: NDArray[Any] | slice) -> NDArray[np.intp] | slice:
    """Return the rows of a mask as indices; indices and slices as they are."""
    return rows.nonzero()[0] if not isinstance(rows, slice) and rows.dtype == bool else rows


def rows_of(column: NDArray[Any], rows: NDArray[Any] | slice) -> NDArray[Any]:
    """Return some rows (indices, mask or slice) of an array (n, …).

    Indexing takes four times as long as NumPy's `take` where a row is more than a number.
    """
    rows = indices(rows)
    return column[rows] if isinstance(rows, slice) else column.take(rows, axis=0)
