"""Imports go one way, heavy packages stay in their rooms (docs/architecture.md), and files and functions are short."""

import ast
import re
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import stream_sfm

ROOT = Path(stream_sfm.__file__).parent

# From the ground up: a room imports from lines above its own, and from itself. Rooms of one line know nothing of each
# other. A new room needs a place here.
LAYERS = (
    ("errors", "record", "__version__"),
    ("system",),
    ("config",),
    ("core",),
    ("geometry", "methods"),
    ("inertial",),
    ("camera",),
    ("rig_model", "pictures"),
    ("types",),
    ("motion",),
    ("frontend", "estimators", "evaluation"),
    ("pipeline", "logs"),
    ("results", "places", "inspection", "simulation"),
    ("report",),
    ("viewer",),
    ("run",),
    ("batch", "dense"),
    ("cli",),
)
LEVEL = {room: level for level, rooms in enumerate(LAYERS) for room in rooms}
# Packages that cost time or memory to import, or that only one room should know: where they may be.
HOMES = {
    "cv2": ("camera", "pictures", "frontend", "dense", "logs", "inspection", "places", "viewer"),
    "mcap": ("logs/mcap_file", "logs/sources", "logs/recording", "results"),
    "mcap_protobuf": ("logs/sources", "logs/recording"),
    "google": ("logs/recording",),  # protobuf, which the two beside it need
    "foxglove_schemas_protobuf": ("logs/sources", "logs/recording"),
    "isal": ("system/deflate.py",),
    "rosbags": ("logs/recording", "logs/sources"),
    "ruamel": ("camera",),
    "pandas": ("results/run_results.py",),
    "gtsam": ("places/graph.py",),
    "filterpy": ("estimators/baselines/ekf.py",),
    "rerun": ("viewer",),
    "matplotlib": ("simulation/figure6.py", "report/svg.py"),
    "jinja2": ("report",),
    "markupsafe": ("report",),
    "rich": ("cli",),
    "cyclopts": ("cli",),
    "lz4": ("logs/mcap_file",),
    "zstandard": ("logs/mcap_file", "logs/sources"),
    "distributed": ("system/executors.py",),
    "threadpoolctl": ("system/blas.py",),
}
EVERYWHERE = {"stream_sfm", "numpy", "scipy", "msgspec"}


def imports(path: Path, types: bool = False) -> Iterator[str]:
    """Full names of what a file imports when it runs; with `types` also of what the type checker alone imports."""
    package = ("stream_sfm", *path.relative_to(ROOT).parts[:-1])
    todo: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while todo:
        node = todo.pop()
        if not types and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        todo += ast.iter_child_nodes(node)
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) + 1 - node.level]) if node.level else ""
            module = ".".join(name for name in (base, node.module) if name)
            yield from (f"{module}.{alias.name}" for alias in node.names)  # a name may be a module itself


def room(path: Path) -> str:
    return path.relative_to(ROOT).with_suffix("").parts[0]


FILES = sorted(path for path in ROOT.rglob("*.py") if room(path) not in ("__init__", "__main__"))
IMPORTS = [(path.relative_to(ROOT).as_posix(), room(path), module) for path in FILES for module in imports(path)]


def test_every_room_has_a_place():
    assert {room(path) for path in FILES} == set(LEVEL) - {"__version__"}


def test_imports_go_one_way():
    """Those of types, too."""
    found = [(p.relative_to(ROOT).as_posix(), room(p), module) for p in FILES for module in imports(p, types=True)]
    inside = [(name, me, module.split(".")[1]) for name, me, module in found if module.startswith("stream_sfm.")]
    up = [(name, me, other) for name, me, other in inside if other != me and LEVEL[other] >= LEVEL[me]]
    assert not up, [f"{name} imports {other}" for name, _, other in up]


def test_no_files_import_each_other_in_a_circle():
    """Files of one room, too; an import inside a function counts like one at the top."""
    files = {".".join(("stream_sfm", *p.relative_to(ROOT).with_suffix("").parts)): p for p in ROOT.rglob("*.py")}
    files = {name.removesuffix(".__init__"): path for name, path in files.items()}
    graph: dict[str, set[str]] = {}
    for name, path in files.items():
        parts = [module.split(".") for module in imports(path)]
        found = (next((n for k in (len(p), len(p) - 1) if (n := ".".join(p[:k])) in files), None) for p in parts)
        graph[name] = {other for other in found if other not in (None, name, "stream_sfm")}
    assert sum(map(len, graph.values())) > 2 * len(files)  # it does see imports
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the files


def test_heavy_packages_stay_in_their_rooms():
    for name, _, module in IMPORTS:
        package = module.split(".")[0]
        if package not in EVERYWHERE and package not in sys.stdlib_module_names:
            assert package in HOMES, f"{name} imports {package}: say here which rooms may"
            assert name.startswith(HOMES[package]), f"{name} imports {package}"
    assert set(HOMES) <= {module.split(".")[0] for _, _, module in IMPORTS}


def test_the_map_of_the_package_has_every_room_in_its_layer():
    page = (Path(__file__).parents[2] / "docs/architecture.md").read_text(encoding="utf-8")
    layers: list[set[str]] = []
    for layer, name in re.findall(r"^\|([^|]*)\| `([\w.]+)/?` \|", page, re.MULTILINE):
        if layer.strip():
            layers.append(set())
        layers[-1].add(name.removesuffix(".py"))
    assert layers == [set(rooms) - {"__version__"} for rooms in reversed(LAYERS)]


def test_every_file_begins_by_saying_what_it_is():
    for path in FILES:
        assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), path


def test_files_and_functions_are_short():
    """But for commands, whose docstrings are the help of their options."""
    for path in sorted(path for suffix in ("py", "cpp", "hpp") for path in ROOT.rglob(f"*.{suffix}")):
        text = path.read_text(encoding="utf-8")
        assert text.count("\n") <= 400, f"{path} has more than 400 lines: split it where the idea splits"
        if path.suffix == ".py" and room(path) != "cli":
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.FunctionDef):
                    lines = node.end_lineno - node.lineno + 1
                    assert lines <= 50, f"{node.name} in {path} has {lines} lines"
