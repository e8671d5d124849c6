"""A checkout finds the module of its sources, or reports that it compiles it, or names the command that does."""

import ast
import contextlib
import importlib.util
import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from stream_sfm.core import _core
from stream_sfm.core.checkout import is_current, mark_of, module_name
from tests.helpers.places import ROOT

TOOL = """\
import sys
print("stream-sfm: compiling up to 2 files", file=sys.stderr)
sys.exit("stream-sfm: building needs cmake")
"""


def checkout(folder: Path) -> Path:
    """A checkout with a source and no module, whose tool fails; returns the file that Python imports."""
    core, tools = folder / "stream_sfm/core", folder / "tools/build"
    for made in (core, tools):
        made.mkdir(parents=True)
    for name in ("CMakeLists.txt", "stage.cpp"):
        (core / name).touch()
    (tools / "in_place.py").write_text(TOOL)
    for name in ("checkout.py", "__init__.py"):
        (core / name).write_bytes((ROOT / "stream_sfm/core" / name).read_bytes())
    return core / "__init__.py"


def test_compilation_is_reported_where_python_writes_its_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a notebook, this is not the standard error of the process."""
    file = checkout(tmp_path)
    spec = importlib.util.spec_from_file_location("checkout_core", file, submodule_search_locations=[str(file.parent)])
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "checkout_core", module)
    with contextlib.redirect_stderr(io.StringIO()) as told, pytest.raises(ImportError) as refused:
        spec.loader.exec_module(module)
    assert told.getvalue().splitlines() == [
        "stream-sfm: compiling up to 2 files",
        "stream-sfm: building needs cmake",
    ]
    assert "python -m pip install" in str(refused.value)


def copy_sources(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    sources = ROOT / "stream_sfm/core"
    for path in (*sources.glob("*.?pp"), *sources.glob("*.py"), sources / "CMakeLists.txt"):
        shutil.copyfile(path, folder / path.name)


def test_a_module_of_other_sources_is_outdated_however_new_it_is(tmp_path: Path) -> None:
    copy_sources(tmp_path)
    shutil.copyfile(str(_core.__file__), tmp_path / module_name())
    assert is_current(str(tmp_path), mark_of(str(tmp_path)))
    with open(tmp_path / "rig.cpp", "a", encoding="utf-8") as source:
        source.write("// another branch\n")
    os.utime(tmp_path / module_name())
    assert not is_current(str(tmp_path), mark_of(str(tmp_path)))
    (tmp_path / module_name()).unlink()
    assert not is_current(str(tmp_path), mark_of(str(tmp_path)))


@pytest.mark.parametrize("beside", [None, b"a module of other sources"])
def test_a_checkout_uses_the_installed_module_of_the_same_sources(tmp_path: Path, beside: bytes | None) -> None:
    """After `pip install .` in a clone, where Python finds the clone first; nothing there can compile or be written."""
    clone, installed = tmp_path / "clone/stream_sfm", tmp_path / "site-packages/stream_sfm/core"
    copy_sources(clone / "core")
    (clone / "__init__.py").touch()
    if beside is not None:
        (clone / "core" / module_name()).write_bytes(beside)
    installed.mkdir(parents=True)
    shutil.copyfile(str(_core.__file__), installed / module_name())
    before = sorted(tmp_path.rglob("*"))
    program = "from stream_sfm.core import _core, pose_exp; print(_core.__file__, pose_exp.__name__)"
    environment = {**os.environ, "PYTHONPATH": str(installed.parents[1]), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", program]
    run = subprocess.run(command, cwd=clone.parent, env=environment, capture_output=True, text=True)
    assert (run.stdout, run.stderr) == (f"{installed / module_name()} pose_exp\n", "")
    assert sorted(tmp_path.rglob("*")) == before
    (clone / "core/rig.cpp").write_text("// another branch\n", encoding="utf-8")
    run = subprocess.run(command, cwd=clone.parent, env=environment, capture_output=True, text=True)
    assert "not that of its sources" in run.stderr and "pip install ." in run.stderr


def test_the_stub_matches_the_module() -> None:
    """`python tools/build/stub.py` regenerates it."""
    spec = importlib.util.spec_from_file_location("stub", ROOT / "tools/build/stub.py")
    assert spec and spec.loader
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    said = ast.dump(ast.parse(tool.stub(_core)))
    assert said == ast.dump(ast.parse((ROOT / "stream_sfm/core/_core.pyi").read_text(encoding="utf-8")))


def test_arguments_of_the_core_have_names_and_help() -> None:
    described = [value for value in vars(_core).values() if callable(value) and not isinstance(value, type)]
    assert len(described) > 50
    for function in described:
        signature, help_text, *_ = function.__nb_signature__[0]
        assert "arg0" not in signature and help_text, signature
    with pytest.raises(TypeError, match="xi: Array"):
        _core.pose_exp(xi="six numbers")
