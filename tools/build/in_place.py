"""Build the compiled core beside its sources: `python tools/build/in_place.py`.

Needs the package `nanobind`, and `cmake` and `ninja` where the machine has none (the extra `test` brings them). What
is compiled stays in build/, so that the next time only what has changed is compiled. Does nothing if nothing has.
"""

import fcntl
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "stream_sfm" / "core"))
sys.path.insert(0, str(Path(__file__).parent))
import checkout
import toolchain

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "stream_sfm" / "core"
_SECONDS_PER_FILE = 4.0  # measured: 79 s of CPU for 25 files, with some reserve


def build() -> None:
    """Build the module of this Python, if it is not that of its sources; other processes wait for the first."""
    toolchain.require_headers()
    folder = ROOT / "build" / f"core-{sys.implementation.cache_tag}"
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "w", encoding="utf-8") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            _say("another process builds the compiled core: waiting for it")
            fcntl.flock(lock, fcntl.LOCK_EX)
        if checkout.is_current(str(SOURCES), checkout.mark_of(str(SOURCES))):
            return
        began_s = time.monotonic()
        _say(f"the compiled core is {'not that of its sources' if module().exists() else 'not built yet'}: {_plan()}")
        configure_and_build(folder)
        built = folder / module().name
        part = module().with_suffix(f".{os.getpid()}")
        shutil.copyfile(built, part)
        part.chmod(0o755)
        part.replace(module())  # at once: a process that has the old one open keeps it
        _say(f"built in {time.monotonic() - began_s:.0f} s: {module()}")


def configure_and_build(folder: Path, *options: str) -> None:
    """Build the module into a folder, with further options of CMake."""
    cmake = _program("cmake")
    _run(
        cmake, "-S", str(SOURCES), "-B", str(folder), "-G", "Ninja", f"-DCMAKE_MAKE_PROGRAM={_program('ninja')}",
        f"-DPython_EXECUTABLE={sys.executable}", mark_argument(),
        *toolchain.cmake_arguments(folder / "compiler"), *options,
    )  # fmt: skip
    _run(cmake, "--build", str(folder))


def mark_argument() -> str:
    """The argument of CMake that puts the mark of the sources into the module."""
    return f"-DSOURCES={checkout.mark_of(str(SOURCES))}"


def module() -> Path:
    """The module's file for this Python."""
    return SOURCES / checkout.module_name()


def _plan() -> str:
    """How much is compiled at most, and how long that takes."""
    files, cores = len(list(SOURCES.glob("*.cpp"))), os.cpu_count() or 1
    seconds = files * _SECONDS_PER_FILE / cores
    return f"compiling up to {files} files on {cores} core{'s' * (cores > 1)}, about {seconds:.0f} s at most"


def _say(text: str) -> None:
    print(f"stream-sfm: {text}", file=sys.stderr, flush=True)


def _program(name: str) -> str:
    """A program of this machine, or of the environment of this Python."""
    found = shutil.which(name) or shutil.which(name, path=str(Path(sys.executable).parent))
    if not found:
        raise SystemExit(f"stream-sfm: building needs {name}: python -m pip install {name}")
    return found


def _run(*command: str) -> None:
    ran = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if ran.returncode:
        raise SystemExit(f"{ran.stdout}\nstream-sfm: failed: {' '.join(command[:3])}")


if __name__ == "__main__":
    build()
