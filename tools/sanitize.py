"""The core under sanitizers: `python -m tools.sanitize`. Exit code 1 on any report.

Builds the core with AddressSanitizer and UndefinedBehaviorSanitizer (GCC or Clang) in build/sanitized, in a copy of
the package, and runs there the tests of the core, the estimators and the front-end, two replays and calls of the core
with random arguments. What nanobind still holds at the end, a leaked reference, is a report, too.
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "build"))
import in_place

_ROOT = in_place.ROOT
_FLAGS = (
    "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-fno-omit-frame-pointer", "-g1", "-O1",
)  # fmt: skip
_REPORTS = ("ERROR: AddressSanitizer", "runtime error:", "nanobind: leaked")
_TESTS = ("tests/core", "tests/estimators", "tests/frontend")
_CALLS = """
import random, sys
from tests.core.calls import attack
for seed in range(int(sys.argv[1])):
    attack(random.Random(f"sanitized {seed}"))
"""


def main() -> int:
    """Build, run everything, and tell what was reported."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=20_000, metavar="N", help="calls with random arguments")
    parser.add_argument("--tests", nargs="*", default=_TESTS, metavar="PATH", help="which tests are run")
    parser.add_argument("--processes", default="auto", metavar="N", help="of pytest")
    arguments = parser.parse_args()
    tree = _tree()
    _build(tree)
    python = [sys.executable, "-P"]
    replays = [
        [*python, "-m", "stream_sfm", "replay", f"logs/{log}.mcap", "--out", f"runs/{log}", "--debug", *more]
        for log, more in (("room", ()), ("demo", ("--max-frames", "60", "--set", "mono=true")))
    ]
    tests = [*python, "-m", "pytest", "-p", "no:cacheprovider", "--numprocesses", arguments.processes]
    commands = [[*python, "-c", _CALLS, str(arguments.calls)], *replays]
    if arguments.tests:
        commands.append([*tests, *arguments.tests])
    reported = [_reports(tree, command) for command in commands]
    print("no report" if not any(reported) else f"{sum(reported)} of {len(commands)} commands with reports")
    return int(any(reported))


def _tree() -> Path:
    """Make the folder with a copy of the package but the built module, and links to the rest of this checkout."""
    tree = _ROOT / "build" / "sanitized" / "tree"
    shutil.rmtree(tree, ignore_errors=True)
    shutil.copytree(_ROOT / "stream_sfm", tree / "stream_sfm", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    for name in ("tests", "tools", "logs", "docs", "examples", "pyproject.toml"):
        (tree / name).symlink_to(_ROOT / name)
    return tree


def _build(tree: Path) -> None:
    folder = _ROOT / "build" / "sanitized" / "core"
    flags = " ".join(_FLAGS)
    in_place.configure_and_build(
        folder,
        "-DCMAKE_BUILD_TYPE=None",
        f"-DCMAKE_CXX_FLAGS={flags}",
        f"-DCMAKE_SHARED_LINKER_FLAGS={flags}",
        f"-DCMAKE_MODULE_LINKER_FLAGS={flags}",
    )
    name = in_place.module().name
    shutil.copyfile(folder / name, tree / "stream_sfm" / "core" / name)


def _reports(tree: Path, command: list[str]) -> bool:
    """Run a command on the sanitized core; whether it failed or something was reported."""
    compiler = shutil.which(os.environ.get("CXX", "g++")) or "c++"
    libraries = [
        subprocess.run([compiler, f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout
        for name in ("libasan.so", "libubsan.so", "libstdc++.so.6")
    ]
    environment = os.environ | {
        "PYTHONPATH": str(tree),
        "LD_PRELOAD": " ".join(library.strip() for library in libraries),
        # Python itself keeps memory to its end; the allocator must refuse as the system does
        "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    print("$", " ".join(command[1:])[:200], flush=True)
    ran = subprocess.run(command, cwd=tree, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    said = ran.stdout.decode(errors="replace")
    wrong = bool(ran.returncode) or any(report in said for report in _REPORTS)
    print(said if wrong else said.splitlines()[-1] if said else "", flush=True)
    return wrong


if __name__ == "__main__":
    sys.exit(main())
