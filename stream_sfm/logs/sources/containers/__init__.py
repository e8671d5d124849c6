"""Recordings in a single file, other than MCAP: one module each, whose `CONTAINER` says how to recognise and open them.

To add a kind, add a file: `containers()` finds the modules of this folder.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from ...mcap_file.message import Source


class Container(NamedTuple):
    """A kind of recording in a single file: how to open it, its first bytes, and its name.

    `start`: a regular expression. `suffix`: marks such files in a folder; `name`: used in messages.
    """

    open: Callable[[Path], Source]
    start: bytes
    suffix: str = ""
    name: str = ""


@cache
def containers() -> tuple[Container, ...]:
    """Return the kinds of this folder, in the order of the names of their modules; the first call takes 20 ms."""
    import pkgutil

    modules = [import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__)]
    return tuple(module.CONTAINER for module in modules)
