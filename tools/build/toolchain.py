"""What a build of the core needs: a C++ compiler, and where there is none, that of `ziglang` from the package index."""

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

_PROGRAM = "#include <vector>\nint main() { return static_cast<int>(std::vector<int>(1, 0)[0]); }\n"


def compiler() -> list[str] | None:
    """The command of a C++17 compiler of this machine that works, or None."""
    named = os.environ.get("CXX", "")
    for command in [named] if named else ["c++", "g++", "clang++"]:
        words = shlex.split(command)
        if words and shutil.which(words[0]) and _works(words):
            return words
    return None


def _works(command: list[str]) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "program.cpp")
        source.write_text(_PROGRAM, encoding="utf-8")
        words = [*command, "-std=c++17", str(source), "-o", str(source.with_suffix(""))]
        try:
            return subprocess.run(words, capture_output=True, timeout=120).returncode == 0
        except (OSError, subprocess.TimeoutExpired):
            return False


def requirements() -> list[str]:
    """What the build needs beyond a compiler of this machine."""
    return [] if compiler() else ["ziglang>=0.13"]


def cmake_arguments(folder: Path) -> list[str]:
    """How CMake finds the compiler; `folder` (made) takes what is needed for that and has to stay during the build."""
    if compiler():
        return []
    import ziglang

    zig = Path(ziglang.__file__).with_name("zig")
    folder.mkdir(parents=True, exist_ok=True)
    # Its own defaults are this processor's instructions, and traps at undefined behaviour.
    commands = {"c++": "c++ -mcpu=baseline -fno-sanitize=undefined", "ar": "ar", "ranlib": "ranlib"}
    cache = shlex.quote(os.environ.get("ZIG_GLOBAL_CACHE_DIR", str(folder / "cache")))
    kept = f"export ZIG_GLOBAL_CACHE_DIR={cache} ZIG_LOCAL_CACHE_DIR={cache}"
    for name, words in commands.items():
        script = folder / name
        script.write_text(f'#!/bin/sh\n{kept}\nexec {shlex.quote(str(zig))} {words} "$@"\n', encoding="utf-8")
        script.chmod(0o755)
    variables = {"CMAKE_CXX_COMPILER": "c++", "CMAKE_AR": "ar", "CMAKE_RANLIB": "ranlib"}
    return [f"-D{variable}={folder / name}" for variable, name in variables.items()]


def require_headers() -> None:
    """Exit with a sentence where Python's headers are missing."""
    import sysconfig

    header = Path(sysconfig.get_path("include"), "Python.h")
    if not header.is_file():
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        raise SystemExit(
            f"stream-sfm: {header} is missing, which building needs: install the headers of Python {version} "
            f"(Debian and Ubuntu: apt install python{version}-dev; Fedora: dnf install python3-devel)"
        )
