"""Every command and every program of the README runs, in a folder that looks like a user's."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest

import stream_sfm as sfm
from stream_sfm.cli.main import COMMANDS, build_parser, main
from tests.helpers.places import ROOT

PAGES = {name: (ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/formats.md")}
FRAMES = 6

NOT_RUN = {
    "python3 -m venv": "makes the environment that this test runs in",
    "pip install": "fills it",
    "python -m pytest": "is this",
    "dask": "needs a cluster; tests/batch/test_cluster.py has one",
    "--scheduler": "needs a cluster",
    "--view": "needs a display; tests/viewer/ writes files instead",
    "simulate efficiency": "takes a minute; tests/simulation/test_command.py runs it on shorter sequences",
}
# a few frames and trials show as well that a command runs
SHORT = {
    **dict.fromkeys(("replay", "surface", "compare", "batch"), f"--max-frames={FRAMES}"),
    "simulate": "--trials=1",
}
# what the README's placeholders stand for
PLACES = {
    "LOG": "logs/room.mcap",
    "LOG…": "logs/room.mcap",
    "DIR": "out",
    "FILE": "out.rrd",
    "FILE.ply": "room.ply",
}


def commands() -> Iterator[str]:
    """Lines of the blocks marked sh, and what the text names in backticks, each once."""
    text = PAGES["README.md"]
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    lines = [part for block in blocks for line in block.splitlines() for part in line.split("&&")]
    lines += re.findall(r"`(stream-sfm [^`]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    plain = (line.partition("#")[0].replace(".venv/bin/", "") for line in lines)
    yield from dict.fromkeys(" ".join(line.split()) for line in plain)


@pytest.fixture(scope="module")
def user(tmp_path_factory) -> Path:
    """A folder with logs/room.mcap, images of it in left/ and right/, l/ and r/, and their calibration."""
    folder = tmp_path_factory.mktemp("user")
    (folder / "logs").symlink_to(ROOT / "logs")
    log = sfm.open_log(ROOT / "logs/room.mcap")
    for name in ("left", "right", "l", "r"):
        (folder / name).mkdir()
    for frame in log.frames(sfm.Selection(max_frames=FRAMES)):
        for name, image in (("left", frame.left), ("right", frame.right)):
            cv2.imwrite(str(folder / name / f"{frame.stamp_ns}.png"), image)
            cv2.imwrite(str(folder / name[0] / f"{frame.stamp_ns}.png"), image)
    for name in ("calibration.toml", "c.toml"):
        (folder / name).write_text(log.rig.to_toml(), encoding="utf-8")
    return folder


@pytest.mark.parametrize("command", commands())
def test_command_runs(command: str, user: Path, monkeypatch, capsys) -> None:
    reason = next((why for part, why in NOT_RUN.items() if re.search(rf"(?<!\S){part}(?!\S)", command)), None)
    if reason:
        pytest.skip(f"{command}: {reason}")
    program, name, *rest = (PLACES.get(word, word) for word in shlex.split(command))
    assert program == "stream-sfm"
    monkeypatch.chdir(user)
    if name in SHORT:
        rest.append(SHORT[name])
    assert main([name, *rest]) == 0, capsys.readouterr().err


def test_every_command_has_a_row_and_every_row_is_a_command() -> None:
    rows = set(re.findall(r"^\| `stream-sfm (\w+)", PAGES["README.md"], re.MULTILINE))
    assert len(rows) == len(COMMANDS)
    for name in rows:
        assert f"    {name} " in build_parser().format_help()


@pytest.mark.parametrize(
    ("page", "number"),
    [(page, n) for page, text in PAGES.items() for n in range(text.count("```python\n"))],
)
def test_program_runs(page: str, number: int, user: Path, monkeypatch) -> None:
    program = re.findall(r"```python\n(.*?)```", PAGES[page], re.DOTALL)[number]
    monkeypatch.chdir(user)
    log = sfm.open_log("logs/room.mcap")

    def my_cameras():
        for frame in log.frames(sfm.Selection(max_frames=FRAMES)):
            yield frame.stamp_ns, frame.left, frame.right

    if not Path("estimates.mcap").exists():
        sfm.replay(log, ".", selection=sfm.Selection(max_frames=FRAMES))
    # a window needs a display; the program names the other way itself
    program = program.replace("view=True", 'rrd="run.rrd"')
    scope: dict[str, Any] = {"sfm": sfm, "my_cameras": my_cameras}
    exec(compile(program, page, "exec"), scope)
    if "estimate" in scope:
        assert scope["estimate"].status == "ok" and len(scope["estimate"].points_in_cam)
