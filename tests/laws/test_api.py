"""The public API: what it holds, that it is documented, that it costs nothing to import, and that pages use no more."""

import ast
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

import stream_sfm
from stream_sfm.cli.main import COMMANDS
from tests.helpers.places import ROOT
from tools.api_reference import write_reference

PACKAGE = Path(stream_sfm.__file__).parent
PUBLIC = [name for name in stream_sfm.__all__ if name != "__version__"]
# What a command does, Python can do.
OF_COMMAND = {
    "replay": {"replay"},
    "batch": {"replay_batch"},
    "compare": {"compare"},
    "surface": {"surface", "write_ply", "draw_mesh", "write_png", "write_surface_recording"},
    "simulate": {"simulate"},
    "inspect": {"inspect"},
    "import": {"import_kitti", "import_euroc", "import_images", "import_video"},
    "calibrate": {"calibrate"},
    "recover": {"recover"},
    "calibration": {"StereoRig"},
    "config": {"read_config", "config_to_toml"},
}
PROGRAMS = [
    *(ROOT / "examples").glob("*.py"),
    *(page for folder in (ROOT, ROOT / "docs") for page in folder.glob("*.md")),
]


def imported_for_the_type_checker() -> dict[str, set[str]]:
    """Module -> the names that `stream_sfm/__init__.py` imports under TYPE_CHECKING, written as in `_HOMES`."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If)]
    found: dict[str, set[str]] = {}
    for node in block.body:
        assert isinstance(node, ast.ImportFrom) and node.module
        names = {f"{a.name} as {a.asname}" if a.asname else a.name for a in node.names}
        found.setdefault(node.module, set()).update(names)
    return found


def test_names_resolve_and_type_checkers_see_the_same() -> None:
    homes = {module: set(names) for module, names in stream_sfm._HOMES.items()}
    assert imported_for_the_type_checker() == homes
    listed = {entry.rpartition(" ")[2] for names in homes.values() for entry in names}
    assert listed == set(PUBLIC)
    for name in PUBLIC:
        assert getattr(stream_sfm, name) is not None
    with pytest.raises(AttributeError, match="nothing_like_it"):
        stream_sfm.nothing_like_it  # noqa: B018


def test_no_public_name_is_that_of_a_module() -> None:
    """Importing the module would replace the name."""
    modules = {path.stem for path in PACKAGE.iterdir() if not path.name.startswith("_")}
    assert not modules & set(PUBLIC)


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_and_its_methods_are_documented(name: str) -> None:
    value = getattr(stream_sfm, name)
    assert inspect.getdoc(value), name
    for method, inside in vars(value).items() if inspect.isclass(value) else ():
        if inspect.isroutine(inside) and not method.startswith("_") and inside.__module__.startswith("stream_sfm"):
            assert inspect.getdoc(inside), f"{name}.{method}"


# Handed on as they are, or made by another public name; nobody needs to construct or to open them.
OPAQUE = {
    "Comparison": "what the report draws; its figures are in ComparisonResult.report",
    "StructureComparison": "filled during a replay",
    "PairChoice": "given to StereoLog by open_log",
    "Source": "given to StereoLog by open_log",
    "Survey": "given to StereoLog by open_log",
}


def classes_in(annotation: object) -> Iterator[type]:
    """The classes of this package that an annotation names."""
    if inspect.isclass(annotation) and annotation.__module__.startswith("stream_sfm"):
        yield annotation
    for inner in get_args(annotation):
        yield from classes_in(inner)


def annotations_of(name: str) -> Iterator[object]:
    """What a public function takes and returns, and what a public class holds and its methods take and return."""
    value = getattr(stream_sfm, name)
    if not inspect.isclass(value):
        yield from get_type_hints(value).values()
        return
    yield from get_type_hints(value).values()
    for member, inside in vars(value).items():
        if member.startswith("_") and member != "__init__":
            continue
        inside = inside.fget if isinstance(inside, property) else getattr(inside, "__func__", inside)
        if inspect.isfunction(inside):
            yield from get_type_hints(inside).values()


@pytest.mark.parametrize("name", PUBLIC)
def test_what_public_names_take_and_return_is_public(name: str) -> None:
    public = {getattr(stream_sfm, other) for other in PUBLIC}
    hidden = {kind.__name__ for annotation in annotations_of(name) for kind in classes_in(annotation)} - {
        kind.__name__ for kind in public
    }
    assert not hidden - set(OPAQUE)


def test_the_reference_page_lists_every_public_name_once() -> None:
    page = (ROOT / "docs/api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)", page, re.MULTILINE)
    assert sorted(listed) == sorted(PUBLIC)


def test_the_reference_is_made_without_a_warning(tmp_path: Path) -> None:
    page = write_reference(tmp_path).read_text(encoding="utf-8")
    assert all(f'id="{name}"' in page for name in PUBLIC)


def test_every_command_has_its_function() -> None:
    assert set(OF_COMMAND) == {command.__name__.rpartition(".")[2].rstrip("_") for command in COMMANDS}
    assert all(names <= set(PUBLIC) for names in OF_COMMAND.values())


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_examples_and_pages_use_public_names_only(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    programs = [text] if path.suffix == ".py" else re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    for program in programs:
        assert not re.findall(r"(?:from|import) (stream_sfm\.\S+)", program)
        used = set(re.findall(r"\bsfm\.(\w+)", program))
        assert used <= set(PUBLIC), used - set(PUBLIC)


def test_a_bare_import_loads_nothing_heavy() -> None:
    script = (
        "import sys, stream_sfm; dir(stream_sfm)\n"
        "print([m for m in sys.modules if m.startswith('stream_sfm.') or m in ('numpy', 'cv2', 'msgspec', 'mcap')])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "[]"
