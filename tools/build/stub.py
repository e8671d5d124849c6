"""Write the stub of the compiled core from the module itself: `python tools/build/stub.py`.

Its functions are what the stub generator of nanobind says of the module; `help` has their descriptions. The classes
above them are the records that stages take and return, as the module describes them. Any object that has the fields of
a record is taken for it, which the type checker verifies. A test compares the stub with the module.
"""

import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from types import ModuleType
from typing import Any

from nanobind.stubgen import StubGen

STUB = Path(__file__).resolve().parents[2] / "stream_sfm/core/_core.pyi"
_HEAD = """\
# The compiled core as Python calls it, written by tools/build/stub.py from the module. Arrays of another type or order
# are copied; one of a wrong shape is a ValueError (TypeError: of a wrong number of axes). Images are (h, w) grey;
# what lies beyond their border is as its rim. A record without a comment is described where Python has one of its name.

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Grey = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Image = NDArray[np.float32] | NDArray[np.uint8]
Pixels = NDArray[np.integer]
Ids = NDArray[np.int64]
Mask = NDArray[np.bool_]
"""


class _OncePerSignature(StubGen):  # type: ignore[misc]
    """Overloads for pixels of several types have one signature, which is written once."""

    def put_nb_func(self, fn: Any, name: str | None = None, is_classmethod: bool = False) -> None:
        self.put_nb_overload(fn, fn.__nb_signature__[0], name, is_classmethod)


def stub(module: ModuleType) -> str:
    """Return the stub of the module."""
    generator = _OncePerSignature(module, include_docstrings=False)
    for name in sorted(vars(module)):
        if callable(value := vars(module)[name]) and not isinstance(value, type):
            generator.put(value, name)
    records = [_record(name, *described) for name, described in module.RECORDS.items()]
    functions = generator.output.replace("\n\n\n", "\n\n")
    said = "RECORDS: dict[str, tuple[bool, str, list[tuple[str, str]]]]  # is returned; help; fields, types"
    numbers = [
        f"{name}: {type(value).__name__}"
        for name, value in sorted(vars(module).items())
        if isinstance(value, int | float)
    ]
    return "\n".join([_HEAD, *numbers, "", *records, said, "", functions.strip(), ""])


def _record(name: str, is_returned: bool, meaning: str, fields: list[tuple[str, str]]) -> str:
    """Return the class of a record: a tuple with names, or whatever has its fields."""
    base = f"tuple[{', '.join(kind for _, kind in fields)}]" if is_returned else "Protocol"
    comment = textwrap.wrap(" ".join(meaning.split()), 116, initial_indent="    # ", subsequent_indent="    # ")
    # what is taken is only read
    field_of = "    {}: {}" if is_returned else "    @property\n    def {}(self) -> {}: ..."
    of_fields = [field_of.format(field, kind) for field, kind in fields]
    return "\n".join([f"class {name}({base}):", *comment, *of_fields, ""])


if __name__ == "__main__":
    sys.path.insert(0, str(STUB.parents[2]))
    from stream_sfm.core import _core

    STUB.write_text(stub(_core), encoding="utf-8")
    if (
        ruff := shutil.which("ruff", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    ) is not None:
        subprocess.run([ruff, "format", "--quiet", str(STUB)], check=True)
