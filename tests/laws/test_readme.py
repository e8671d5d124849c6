"""Every command and every program of the README and of docs/ runs, in a folder that looks like a user's."""

import json
import re
import shlex
from collections.abc import Iterator
from typing import Any

import cv2
import pytest

import stream_sfm as sfm
from stream_sfm.cli.main import main
from stream_sfm.cli.tables import COMMANDS
from stream_sfm.evaluation.figures import NEES_INTERVAL
from tests.helpers.data_sets import kalibr
from tests.helpers.places import ROOM, ROOT

pytestmark = pytest.mark.slow

PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
}
FRAMES = 4
NOT_RUN = {
    "--world gravity": "the sample log has no inertial unit",
    "--mask": "needs masks of these images; tests/camera/test_masks.py has some",
    "python3 -m venv": "makes the environment that this test runs in",
    "activate": "enters it",
    "pip install": "fills it",
    "pip uninstall": "the same",
    "python -m pytest": "is this",
    "dask": "needs a cluster; tests/batch/test_cluster.py has one",
    "--scheduler": "needs a cluster",
    "--view": "needs a display; tests/viewer/test_viewer.py has one",
    "view runs/latest": "the same",
    "docker": "needs Docker",
    "stream-sfm live": "needs a camera; tests/recording/test_cameras.py has stand-ins",
    "--install-completion": "changes the files of the shell",
    "simulate": "takes a minute; tests/simulation/test_command.py runs it on shorter sequences",
    "tools/benchmark.py": "needs the data sets; tests/test_benchmark.py runs it on a log",
    "import kitti": "needs a recording; tests/importers/ makes one",
    "import euroc": "needs a recording; tests/importers/ makes one",
}
NEEDS_GTSAM = ("--loops", "PlaceMap", "fuse_gtsam")
MENTION = re.compile(r"stream-sfm (replay|batch|compare|simulate|surface|inspect|import( \w+)?)")  # in a sentence
# A few frames show as well that a command runs.
SHORT = dict.fromkeys(("replay", "surface", "compare", "refine", "batch"), f"--max-frames={FRAMES}")
# What the placeholders of the pages stand for.
PLACES = {
    "LOG": "logs/room.mcap",
    "LOG…": "logs/room.mcap",
    "logs/demo.mcap": "logs/room.mcap",
    "DIR": "out",
    "FILE": "out.rrd",
    "FILE.ply": "room.ply",
    "K": "2",
    "RUN": "runs/latest",
    "RUN…": "runs/latest",
    "results": "a",
}


def commands() -> list[str]:
    """Lines of the blocks marked sh, and what the text names in backticks, placeholders filled in.

    Not those of `NOT_RUN`; and of commands of which one has words more than the other, the longer one.
    """
    lines = []
    for text in PAGES.values():
        blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
        lines += [part for block in blocks for line in block.splitlines() for part in line.split("&&")]
        lines += re.findall(r"`(stream-sfm [^`]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    plain = (line.partition("#")[0].replace(".venv/bin/", "").split() for line in lines)
    whole = (words for words in plain if not MENTION.fullmatch(" ".join(words)))
    room = {"mine.mcap": "logs/room.mcap"}  # the same log by another name, which `import` makes
    known = ((words, PLACES if "import" in words else PLACES | room) for words in whole)
    filled = dict.fromkeys(" ".join(places.get(word, word) for word in words) for words, places in known)
    run = [command for command in filled if not re.search(rf"(?<![\w-])({'|'.join(NOT_RUN)})(?!\S)", command)]
    return [command for command in run if not any(set(command.split()) < set(other.split()) for other in run)]


def programs() -> Iterator[tuple[str, int, str]]:
    """Page, number and text of every block marked python."""
    for page, text in PAGES.items():
        for number, program in enumerate(re.findall(r"```python\n(.*?)```", text, re.DOTALL)):
            yield page, number, program


@pytest.fixture(scope="module")
def user(tmp_path_factory):
    """A folder with the sample log, images, their calibration and their log, and the results of a replay."""
    folder = tmp_path_factory.mktemp("user")
    (folder / "logs").symlink_to(ROOT / "logs")
    (folder / "recordings").mkdir()
    (folder / "recordings/room.mcap").symlink_to(ROOM)
    log = sfm.open_log(ROOM)
    rig = log.stereo_rig
    for name in ("left", "right", "l", "r"):
        (folder / name).mkdir()
    for frame in log.frames(sfm.Selection(max_frames=FRAMES)):
        for name, image in (("left", frame.left), ("right", frame.right)):
            cv2.imwrite(str(folder / name / f"{frame.stamp_ns}.png"), image)
            cv2.imwrite(str(folder / name[0] / f"{frame.stamp_ns}.png"), image)
    for name in ("calibration.toml", "c.toml", "refined.toml"):
        (folder / name).write_text(rig.to_toml(), encoding="utf-8")
    (folder / "camchain.yaml").write_text(kalibr((rig.left, rig.right), rig.right_from_left), encoding="utf-8")
    sfm.replay(log, folder / "runs/latest", selection=sfm.Selection(max_frames=FRAMES))
    for batch in ("a", "b"):  # as from other commands, which may run in another process
        (folder / batch).mkdir()
        (folder / batch / "latest").symlink_to(folder / "runs/latest")
    (folder / "mine.mcap").symlink_to(ROOM)
    return folder


def skip_without_gtsam(text: str) -> None:
    if any(name in text for name in NEEDS_GTSAM):
        pytest.importorskip("gtsam", reason="GTSAM is not installed: the extra [map]")


@pytest.mark.parametrize("command", commands())
def test_command_runs(command, user, monkeypatch, capsys):
    skip_without_gtsam(command)
    program, name, *rest = shlex.split(command)
    assert program == "stream-sfm"
    if name == "import":
        (user / rest[-1]).unlink(missing_ok=True)  # not through the link into the checkout
    if name in SHORT:
        rest.append(SHORT[name])
    monkeypatch.chdir(user)
    assert main([name, *rest]) == 0, capsys.readouterr().err


def test_the_first_command_prints_what_the_quickstart_shows(user, monkeypatch, capsys):
    """Apart from the numbers, which depend on the machine and on the version."""
    monkeypatch.chdir(user)
    shown = re.search(r"```sh\nstream-sfm (replay \S+)\n```\n\n```\n(.*?)```", PAGES["docs/quickstart.md"], re.DOTALL)
    assert shown
    before = set(user.glob("runs/demo-*"))
    assert main(shown[1].split()) == 0
    assert without_numbers(capsys.readouterr().out) == without_numbers(shown[2])
    (run,) = set(user.glob("runs/demo-*")) - before
    summary = json.loads((run / "summary.json").read_bytes())
    low, high = NEES_INTERVAL
    assert low < summary["ground_truth"]["nees_pose_mean"] < high  # errors and their σ are of one size


def without_numbers(table: str) -> list[str]:
    """The words of a table, whatever its width."""
    return re.sub(r"[-+\d.]+", "0", re.sub(r"[─┌┐└┘│]", " ", table)).split()


def test_every_command_has_a_row_and_every_row_is_a_command():
    rows = set(re.findall(r"^\| `stream-sfm ([\w-]+)", PAGES["docs/commands.md"], re.MULTILINE))
    assert rows == set(COMMANDS)


@pytest.mark.parametrize(("page", "number", "program"), programs())
def test_program_runs(page, number, program, user, monkeypatch):
    skip_without_gtsam(program)
    monkeypatch.chdir(user)
    log = sfm.open_log(ROOM)

    def my_cameras() -> Iterator[tuple[int, Any, Any]]:
        for frame in log.frames(sfm.Selection(max_frames=FRAMES)):
            yield frame.stamp_ns, frame.left, frame.right

    # a window needs a display; the program names the other way itself
    program = program.replace("view=True", 'rrd="run.rrd"')
    scope: dict[str, Any] = {"sfm": sfm, "my_cameras": my_cameras}
    exec(compile(program, f"{page}, program {number}", "exec"), scope)
    if "estimate" in scope and "my_cameras" in program:  # estimates from files come without points
        assert scope["estimate"].status == "ok" and len(scope["estimate"].points_in_cam)
