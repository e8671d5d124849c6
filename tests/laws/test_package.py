"""The package: one version everywhere, types shipped, and messages in which only the command line names its options."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import stream_sfm
from stream_sfm.errors import STUDY
from tests.helpers.places import ROOM, ROOT

PACKAGE = Path(stream_sfm.__file__).parent
RUN_OTHER_PROGRAMS = ("batch/job.py", "viewer/recording.py")  # ours, and Rerun


@pytest.mark.parametrize(("page", "pattern"), [("CHANGELOG.md", r"^## (\S+)"), ("CITATION.cff", r"^version: (\S+)$")])
def test_the_version_is_the_same_everywhere(page, pattern):
    found = re.search(pattern, (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE)
    assert found and found[1] == stream_sfm.__version__ == version("stream-sfm")


def test_the_container_is_built_of_files_that_are_there():
    """Docker is not at hand: what it is given, and what the build needs, agree."""
    given = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    kept = {name.removeprefix("!") for name in given if name.startswith("!")}
    assert all((ROOT / name).exists() for name in kept)
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project, build = content["project"], content["build-system"]
    assert {"README.md", *project["license-files"], *build["backend-path"], "stream_sfm"} <= kept
    image = re.search(r"python:3\.(\d+)", (ROOT / "Dockerfile").read_text(encoding="utf-8"))
    versions = re.findall(r"Python :: 3\.(\d+)", " ".join(project["classifiers"]))
    assert image and image[1] in versions and project["requires-python"] == f">=3.{versions[0]}"


# The newest versions with known holes, of each series that is still supported.
HOLES = {"protobuf": ("5.29.5", "6.30.0", "6.33.4"), "distributed": ("2024.8.2",), "jinja2": ("3.1.5",)}
GPL = ("evo",)


def test_no_version_with_a_known_hole_is_allowed_and_what_is_under_the_gpl_is_for_tests():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    of_users = [
        *project["dependencies"],
        *(name for extra, names in extras.items() if extra != "test" for name in names),
    ]
    needed = {wanted.name: wanted for wanted in map(Requirement, of_users)}
    for name, versions in HOLES.items():
        assert not any(version in needed[name].specifier for version in versions), name
        assert "9999" in needed[name].specifier
    assert not set(GPL) & set(needed) and set(GPL) <= {Requirement(name).name for name in extras["test"]}
    for name in GPL:
        assert f"`{name}` is (GPL" in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_types_are_shipped():
    assert (PACKAGE / "py.typed").exists()


def messages(path: Path) -> Iterator[str]:
    """Literal texts of a file, except for its docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documentation = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documentation:
            yield node.value


def test_no_message_of_the_library_names_an_option():
    """It states facts and remedies in words."""
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        if not name.startswith("cli/") and name not in RUN_OTHER_PROGRAMS:
            for text in messages(path):
                assert not re.search(r"(^|[ `]|(?<!var)\()--[a-z]|stream-sfm [a-z]", text), f"{name}: {text}"


_PLAIN = """
import sys
for name in {missing}:
    sys.modules[name] = None  # as if it was not installed
import stream_sfm as sfm
run = sfm.replay({log!r}, {out!r}, selection=sfm.Selection(max_frames=4))
assert len(sfm.read_results({out!r})) == 4 and run.summary["ground_truth"]["nees_pose_mean"] is not None
"""


def test_a_plain_install_replays_and_reads_results(tmp_path: Path) -> None:
    program = _PLAIN.format(missing=(*STUDY, "rerun"), log=str(ROOM), out=str(tmp_path / "run"))
    ran = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr


def test_what_needs_the_extra_study_says_so_before_it_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stream_sfm.errors.find_spec", lambda name: None if name == "matplotlib" else name)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert {Requirement(name).name for name in extras["study"]} == set(STUDY)
    for begin in (
        lambda: stream_sfm.compare(ROOM, tmp_path / "a"),
        lambda: stream_sfm.replay_batch([ROOM], tmp_path / "a"),
        lambda: stream_sfm.simulate("rates", tmp_path / "a"),
        lambda: stream_sfm.replay(ROOM, tmp_path / "a", stream_sfm.Config(mono=True)),
    ):
        with pytest.raises(stream_sfm.ConfigError, match=r"needs matplotlib: pip install 'stream-sfm\[study\]'"):
            begin()
    assert not list(tmp_path.iterdir())
