"""The public API is complete, documented and cheap to import, and pages use nothing else."""

import inspect
import pydoc
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

import stream_sfm
from stream_sfm.cli.tables import COMMANDS
from tests.helpers.places import ROOT
from tools.api_reference import write_reference

PACKAGE = Path(stream_sfm.__file__).parent
PUBLIC = [name for name in stream_sfm.__all__ if name != "__version__"]
# What a command does, Python can do: by a function of the same name, or by these.
OF_COMMAND = {
    "live": {"open_camera"}, "batch": {"replay_batch"}, "evaluate": {"read_results", "evaluate"},
    "view": {"open_viewer"}, "surface": {"surface", "write_ply"},
    "import": {"import_kitti", "import_euroc", "import_images"}, "convert-calibration": {"StereoRig"},
    "config": {"read_config", "config_to_toml"},
}  # fmt: skip
# Parameters that are attributes of what public names return, or given to a caller's function: they need no name.
HANDED_ON = {
    "Ambiguity", "InertialView", "JobResult", "KnownTiming", "LastingErrors", "MapStart", "PreparedImages",
    "Refinement", "RigChange", "RigEstimate", "RigModel", "RigView", "StereoPair", "StructureComparison",
}  # fmt: skip
PROGRAMS = [
    *(ROOT / "examples").glob("*.py"),
    *(page for folder in (ROOT, ROOT / "docs") for page in folder.glob("*.md")),
]


def test_names_resolve():
    assert sorted(stream_sfm.__all__) == stream_sfm.__all__ == dir(stream_sfm)
    with pytest.raises(AttributeError, match="nothing_like_it"):
        stream_sfm.nothing_like_it  # noqa: B018


def test_no_public_name_is_that_of_a_module():
    """Importing the module would replace the name."""
    modules = {path.stem for path in PACKAGE.iterdir() if not path.name.startswith("_")}
    assert not modules & set(PUBLIC)


def classes_in(annotation: object) -> Iterator[type]:
    """The classes of this package that an annotation names."""
    if inspect.isclass(annotation) and annotation.__module__.startswith("stream_sfm"):
        yield annotation
    for inner in get_args(annotation):
        yield from classes_in(inner)


def functions_of(name: str) -> Iterator[Callable[..., object]]:
    """A public function, or the methods of a public class; its constructor, too, unless a function makes it."""
    value = getattr(stream_sfm, name)
    if not inspect.isclass(value):
        yield value
        return
    made = {kind for other in PUBLIC for kind in classes_in(returned(getattr(stream_sfm, other)))}
    for member, inside in vars(value).items():
        if member.startswith("_") and (member != "__init__" or value in made):
            continue
        inside = inside.fget if isinstance(inside, property) else getattr(inside, "__func__", inside)
        if inspect.isfunction(inside):
            yield inside


def returned(function: object) -> object:
    return get_type_hints(function).get("return") if inspect.isfunction(function) else None


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_and_what_they_return_are_documented_and_what_they_take_is_public(name):
    """What is returned need not be named: attributes lead to it."""
    public = {getattr(stream_sfm, other) for other in PUBLIC}
    assert inspect.getdoc(getattr(stream_sfm, name))
    for function in functions_of(name):
        assert function.__name__.startswith("_") or inspect.getdoc(function), f"{name}.{function.__name__}"
        hints = get_type_hints(function)
        for kind in classes_in(hints.pop("return", None)):
            assert inspect.getdoc(kind), kind
        taken = {kind for hint in hints.values() for kind in classes_in(hint)}
        assert not {kind.__name__ for kind in taken - public} - HANDED_ON


def test_the_reference_page_lists_every_public_name_once():
    page = (ROOT / "docs/api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)", page, re.MULTILINE)
    assert sorted(listed) == sorted(PUBLIC)


def test_the_reference_is_made_without_a_warning(tmp_path):
    page = write_reference(tmp_path).read_text(encoding="utf-8")
    assert all(f'id="{name}"' in page for name in PUBLIC)
    assert "typing.Annotated" not in page and "msgspec.Meta" not in page
    assert "most points tracked at the same time (20 to 2000)" in page  # what a setting means is in words


def test_every_command_has_its_function():
    assert set(OF_COMMAND) <= set(COMMANDS)
    assert all(OF_COMMAND.get(command, {command}) <= set(PUBLIC) for command in COMMANDS)


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_examples_and_pages_use_public_names_only(path):
    text = path.read_text(encoding="utf-8")
    programs = [text] if path.suffix == ".py" else re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    for program in programs:
        assert not re.findall(r"(?:from|import) (stream_sfm\.\S+)", program)
        used = set(re.findall(r"\bsfm\.(\w+)", program))
        assert used <= set(PUBLIC), used - set(PUBLIC)


def test_a_bare_import_loads_nothing_heavy():
    script = (
        "import sys, stream_sfm; dir(stream_sfm)\n"
        "print([m for m in sys.modules if m.startswith('stream_sfm.') or m in ('numpy', 'cv2', 'msgspec', 'mcap')])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=1800)
    assert done.stdout.strip() == "[]"


def test_help_of_the_engine_shows_types_by_their_names() -> None:
    shown = pydoc.render_doc(stream_sfm.Engine, renderer=pydoc.plaintext)
    assert "gyro_rad_s: 'ArrayLike'" in shown and "_array_like" not in shown
