"""The compiled core: stages of the front-end and the estimators as functions of arrays, in C++.

One file per stage, whose head says what it does; `_core.pyi` has the functions as Python calls them. The stages know
nothing of Python: `bind_*.cpp` name and describe their arguments, `binding.hpp` checks arrays and reads records by the
names of their fields, and stages run without Python's lock. The same arrays give the same bytes on every machine of one
kind, in one thread or in several.
"""

import os
import sys
import sysconfig


def _build_if_older(folder: str) -> None:
    """Build the module of a checkout, in place, where a source is newer; standard error says so, also in a notebook."""
    suffix = ".abi3.so" if sys.version_info >= (3, 12) else sysconfig.get_config_var("EXT_SUFFIX")
    changed = {entry.name: entry.stat().st_mtime for entry in os.scandir(folder)}
    module = changed.get(f"_core{suffix}", 0.0)
    if all(at <= module for name, at in changed.items() if name.endswith((".cpp", ".hpp", ".txt"))):
        return
    import subprocess

    tool = os.path.join(folder, "..", "..", "tools", "build", "in_place.py")
    with subprocess.Popen(
        [sys.executable, tool], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, encoding="utf-8"
    ) as building:
        for line in building.stderr or ():
            sys.stderr.write(line)
            sys.stderr.flush()
    if building.returncode:
        raise ImportError(
            f"{folder}: the compiled core is older than its sources and could not be built, for the reason above: "
            'python -m pip install -e ".[test]"; a package that is installed is found from any other folder'
        )


if os.path.exists(os.path.join(os.path.dirname(__file__), "CMakeLists.txt")):  # a wheel has no sources
    _build_if_older(os.path.dirname(__file__))

from ._core import *  # noqa: F403 `help` describes each
