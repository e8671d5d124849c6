"""docs/walks.md leads along functions that exist, and names the sinks in the order in which they are called."""

import ast
import re
from pathlib import Path

import pytest

import stream_sfm
from stream_sfm.pipeline import replay
from tests.helpers.places import ROOM, ROOT

PACKAGE = Path(stream_sfm.__file__).parent
STEPS = re.findall(
    r"^\| \d+ \| `([\w/.]+)` \| `([\w.]+)` \|", (ROOT / "docs/walks.md").read_text(encoding="utf-8"), re.MULTILINE
)


def functions(file: Path) -> set[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{part.name}" for part in node.body if isinstance(part, ast.FunctionDef)}
    return names


def test_both_walks_are_read() -> None:
    assert [name for _, name in STEPS].count("run") == 2 and len(STEPS) > 30


@pytest.mark.parametrize("file,name", sorted(set(STEPS)))
def test_every_step_exists(file: str, name: str) -> None:
    assert name in functions(PACKAGE / file), f"docs/walks.md leads to {name} in {file}"


def test_the_sinks_of_a_replay_come_in_the_order_of_the_walk(tmp_path: Path) -> None:
    log = stream_sfm.open_log(ROOM)
    run = replay._Run(log, log.rig, stream_sfm.Config(), stream_sfm.Selection(), tmp_path, [])
    written = [name.removesuffix(".write") for _, name in STEPS if name.endswith(".write")]
    assert [type(sink).__name__ for sink in run.sinks] == written[:4]
