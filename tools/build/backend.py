"""The build backend (PEP 517): scikit-build-core, on machines without a compiler too.

An editable install is a path to this folder, and the module is built in place (`in_place.py`), so that worktrees and
installs have it in the same way.
"""

import base64
import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from typing import Any

import scikit_build_core.build as scikit
from scikit_build_core.build import get_requires_for_build_sdist as get_requires_for_build_sdist
from scikit_build_core.build import prepare_metadata_for_build_wheel as prepare_metadata_for_build_wheel

sys.path.insert(0, str(Path(__file__).parent))
import in_place
import toolchain

Settings = dict[str, Any] | None
_FAILED = (
    "\nstream-sfm: the compiled core could not be built; the compiler's message is above. It needs a C++17 compiler "
    "(GCC 8, Clang 7 or newer), named by the variable CXX if there are several, or none at all: then that of the "
    "package ziglang is taken, which needs 1 GB of disk while it builds."
)


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return CMake and Ninja where they are missing, and a compiler."""
    toolchain.require_headers()
    return [*scikit.get_requires_for_build_wheel(config_settings), *toolchain.requirements()]


get_requires_for_build_editable = get_requires_for_build_wheel


def build_sdist(folder: str, config_settings: Settings = None) -> str:
    """Build the source archive from the files that git tracks; outside a repository, from all that are there."""
    target = os.path.abspath(folder)
    with tempfile.TemporaryDirectory() as copy:
        for name in (tracked := tracked_files()):
            place = Path(copy, name)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(in_place.ROOT / name, place)
        with chdir(copy if tracked else in_place.ROOT):
            return scikit.build_sdist(target, config_settings)


def tracked_files() -> list[str]:
    """Return the files of this repository that git tracks and that are there; none if it is no repository."""
    if not (in_place.ROOT / ".git").exists() or shutil.which("git") is None:
        return []
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=in_place.ROOT, check=True, capture_output=True, text=True)
    return [name for name in listed.stdout.split("\0") if name and (in_place.ROOT / name).is_file()]


def build_wheel(folder: str, config_settings: Settings = None, metadata: str | None = None) -> str:
    """Build a wheel."""
    with tempfile.TemporaryDirectory() as tools, _explained():
        arguments = [*toolchain.cmake_arguments(Path(tools)), in_place.mark_argument()]
        os.environ["CMAKE_ARGS"] = shlex.join([*shlex.split(os.environ.get("CMAKE_ARGS", "")), *arguments])
        return scikit.build_wheel(folder, config_settings, metadata)


def build_editable(folder: str, config_settings: Settings = None, metadata: str | None = None) -> str:
    """Build the module in place, and a wheel that only points here."""
    with _explained():
        in_place.build()
    name = scikit.build_editable(folder, _pointing_here(config_settings), metadata)
    _only_a_path(Path(folder, name))
    return name


def prepare_metadata_for_build_editable(folder: str, config_settings: Settings = None) -> str:
    """Write the metadata of an editable install."""
    return scikit.prepare_metadata_for_build_editable(folder, _pointing_here(config_settings))


def _pointing_here(config_settings: Settings) -> dict[str, Any]:
    only_path = {"wheel.cmake": "false", "wheel.py-api": "py3", "editable.mode": "inplace"}
    return {**(config_settings or {}), **only_path}


def _only_a_path(wheel: Path) -> None:
    """Leave a path to this folder in an editable wheel: an import hook would also come before PYTHONPATH."""
    with zipfile.ZipFile(wheel) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    (path,) = (name for name in files if name.endswith(".pth"))
    (record,) = (name for name in files if name.endswith(".dist-info/RECORD"))
    files = {name: files[name] for name in files if name not in (path.removesuffix(".pth") + ".py", record)}
    files[path] = f"{in_place.ROOT}\n".encode()
    rows = [f"{name},sha256={_digest(data)},{len(data)}\n" for name, data in files.items()]
    files[record] = "".join([*rows, f"{record},,\n"]).encode()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)


def _digest(data: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


@contextmanager
def _explained() -> Iterator[None]:
    try:
        yield
    except BaseException as error:
        if not isinstance(error, KeyboardInterrupt):
            print(_FAILED, file=sys.stderr, flush=True)
        raise
