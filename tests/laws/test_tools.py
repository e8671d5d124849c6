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

TOOLS = sorted(
    path for path in (ROOT / "tools").glob("*.py") if "ArgumentParser" in path.read_text(encoding="utf-8")
)


@pytest.mark.slow
@pytest.mark.parametrize("tool", TOOLS, ids=lambda path: path.stem)
def test_a_tool_runs_as_a_script_and_as_a_module(tool: Path, tmp_path: Path) -> None:
    """As a script it runs anywhere: only the package itself is found there, not the folder of the tools."""
    (tmp_path / "stream_sfm").symlink_to(ROOT / "stream_sfm")
    elsewhere = os.environ | {"PYTHONPATH": str(tmp_path)}
    for command, folder, environment in ((str(tool), tmp_path, elsewhere), (f"-mtools.{tool.stem}", ROOT, None)):
        ran = subprocess.run(
            [sys.executable, command, "--help"], cwd=folder, env=environment, capture_output=True, text=True
        )
        assert ran.returncode == 0 and "usage:" in ran.stdout, ran.stderr


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
