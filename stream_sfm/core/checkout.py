"""The compiled module of a checkout: finds the one that was built from the checkout's sources, or builds it.

The module contains a checksum of its sources. So one that was copied, or left by another branch, is recognised as
outdated, however new it is. A module that lies beside the sources comes first. After `pip install .` there is none, and
Python finds the checkout before the installed package in the checkout's own folder: then the module of the installed
package is used, if it was built from the same sources. `tools/build/in_place.py` imports this file without the package
around it.
"""

import os
import sys
import zlib
from importlib.machinery import EXTENSION_SUFFIXES


def module_name() -> str:
    """Return the file name of the module for this Python."""
    return f"_core{'.abi3.so' if sys.version_info >= (3, 12) else EXTENSION_SUFFIXES[0]}"


def mark_of(folder: str) -> str:
    """Return the mark inside a module that was built from the sources in a folder."""
    checksum = 0
    for name in sorted(os.listdir(folder)):
        if name.endswith((".cpp", ".hpp", ".txt")):
            with open(os.path.join(folder, name), "rb") as source:
                checksum = zlib.crc32(source.read(), zlib.crc32(name.encode(), checksum))
    return f"stream_sfm-sources-{checksum:08x}"


def is_current(folder: str, mark: str) -> bool:
    """Whether the module in a folder was built from the sources with this mark."""
    try:
        with open(os.path.join(folder, module_name()), "rb") as module:
            return mark.encode() in module.read()
    except OSError:
        return False


def folder_of_module(sources: str) -> str:
    """Return the folder of the module of these sources; if there is none, build it beside them."""
    mark = mark_of(sources)
    for folder in (sources, *(os.path.join(entry, "stream_sfm", "core") for entry in sys.path)):
        if is_current(folder, mark):
            return folder
    _build(sources)
    return sources


def _build(folder: str) -> None:
    """Build the module in place; standard error shows it, even in a notebook."""
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
            f"{folder}: the compiled core is not that of its sources and could not be built, for the reason above: "
            'python -m pip install . or, to change the sources, python -m pip install -e ".[test]"'
        )
