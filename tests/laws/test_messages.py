"""The library states facts and remedies in words; only the command line speaks of its own options."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import stream_sfm

ROOT = Path(stream_sfm.__file__).parent
RUN_OTHER_PROGRAMS = ("batch/job.py", "viewer/recording.py")  # ours, and Rerun


def messages(path: Path) -> Iterator[str]:
    """Literal texts of a file, but for its docstrings."""
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
    for path in sorted(ROOT.rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if not name.startswith("cli/") and name not in RUN_OTHER_PROGRAMS:
            for text in messages(path):
                assert not re.search(r"(^|[ (`])--[a-z]|stream-sfm [a-z]", text), f"{name}: {text}"
