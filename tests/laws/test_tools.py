"""Every tool runs as a script and as a module: `python tools/X.py`, `python -m tools.X`."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from stream_sfm.rig_model.terms import TERMS
from tests.helpers.places import ROOT

TOOLS = sorted(path for path in (ROOT / "tools").glob("*.py") if "ArgumentParser" in path.read_text(encoding="utf-8"))


_RUNNING = """
import runpy, sys
elsewhere = sys.argv[1] == "scripts"
for tool in sys.argv[2:]:
    folder, _, name = tool.rpartition("/")
    known, path, sys.argv = set(sys.modules), list(sys.path), [tool, "--help"]
    try:
        if elsewhere:
            sys.path[0] = folder
            runpy.run_path(tool, run_name="__main__")
        else:
            runpy.run_module(f"tools.{name.removesuffix('.py')}", run_name="__main__", alter_sys=True)
    except SystemExit as ended:
        assert not ended.code, tool
    sys.path[:] = path
    for module in set(sys.modules) - known:  # the next one imports the tools that it needs anew
        if str(getattr(sys.modules[module], "__file__", "")).startswith(folder):
            del sys.modules[module]
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", ["scripts", "modules"])
def test_tools_run_as_scripts_and_as_modules(how: str, tmp_path: Path) -> None:
    """As scripts they run anywhere: only the package itself is found there, not the folder of the tools."""
    (tmp_path / "stream_sfm").symlink_to(ROOT / "stream_sfm")
    folder = ROOT if how == "modules" else tmp_path
    command = [sys.executable, "-c", _RUNNING, how, *map(str, TOOLS)]
    environment = os.environ | {"PYTHONPATH": str(folder)}
    ran = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert ran.returncode == 0 and ran.stdout.count("usage:") == len(TOOLS), ran.stderr


def test_tools_import_each_other_where_they_start() -> None:
    """Not within a function, where only the run that gets there would find out."""
    names = "|".join(["render", *(path.stem for path in (ROOT / "tools").glob("*.py"))])
    for path in (ROOT / "tools").glob("*.py"):
        late = re.findall(
            rf"^ +(?:from|import) (?:tools\.)?(?:{names})\b", path.read_text(encoding="utf-8"), re.MULTILINE
        )
        assert not late, f"{path.name}: {late}"


def test_the_budget_of_a_step_adds_up() -> None:
    """Times by language are those of a step, and the unknowns those of a full window with its prior and its rig."""
    command = [sys.executable, str(ROOT / "tools/bench_jobs.py"), "budget", str(ROOT / "logs/room.mcap")]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ran = subprocess.run([*command, "frontend.max_tracks=50"], capture_output=True, text=True, env=environment)
    assert ran.returncode == 0, ran.stderr
    found = json.loads(ran.stdout)
    assert set(found["ms"]) == {"core", "OpenCV", "Python and NumPy"} and min(found["ms"].values()) > 0
    unknowns = found["unknowns"]
    assert unknowns["of frames"] == 8 * (6 + 3) and unknowns["of the rig"] == len(TERMS)
    assert unknowns["modes"] >= 6 and unknowns["all"] == pytest.approx(72 + unknowns["modes"] + len(TERMS))
