"""Whatever topics, encodings and files are called: what is printed has no character that a terminal would obey."""

from typing import Any

import pytest

from stream_sfm.wording import printable
from tests.helpers.stereo_logs import START_NS, LogWriter, Spec, write_log

ESCAPES = "\x1b]0;owned\x07\x1b[2J\x00\x9b31m\u202e\r\n"
CAMERAS = Spec(topics=(f"/left{ESCAPES}/image", f"/right{ESCAPES}/image"))


def obeyed(text: str) -> set[str]:
    return {c for c in text if not c.isprintable() and c != "\n"}


@pytest.fixture
def log(tmp_path):
    """A log whose name and topics are commands for a terminal."""
    path = tmp_path / "...[bold]{0}%s\x1b[31m\nb.mcap"
    writer = LogWriter(tmp_path / "odd.mcap")
    writer.add(f"/odd{ESCAPES}", f"odd/msg/{ESCAPES}", ("cdr", "ros2msg"), b"uint8 x\n", START_NS, b"\0")
    writer.close()
    write_log(path, CAMERAS)
    return path


def test_printable():
    assert printable("plain – σ ° ✓") == "plain – σ ° ✓"
    assert not obeyed(printable(ESCAPES)) and "\n" not in printable(ESCAPES)
    assert printable("a\nb\x1b") == r"a\nb\x1b"


COMMANDS = [
    "inspect {log}", "inspect {odd}", "inspect {log} --json", "recover {log} {dir}/o{esc}.mcap",
    "replay {log} --out {dir}/o{esc} --method frame-to-frame -v",
    "replay {log} --left {esc} --right {esc} --out {dir}/o",
    "replay {log} --out {dir}/o --json --method frame-to-frame", "replay {dir}/missing{esc} --out {dir}/o",
    "replay {log} --{esc}", "replay {log} --config {esc}", "batch {log} --out {dir}/o{esc} --method frame-to-frame",
    "batch {dir}/missing{esc} --out {dir}/o{esc}", "surface {log} --out {dir}/s{esc}.ply --frame 2",
]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_a_terminal_is_told_nothing(command, log, tmp_path, cli):
    names: dict[str, Any] = {"log": log, "dir": tmp_path, "odd": tmp_path / "odd.mcap", "esc": "\x1b[2J\x9b31m"}
    said = cli(*(word.format(**names) for word in command.split()), code=(0, 2, 3))
    assert said.out or said.err
    assert not obeyed(said.out + said.err)
    if "--json" in command:  # the names themselves, not what is shown of them
        assert said.json["log"] in (str(log), log.name)
