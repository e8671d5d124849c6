"""Whatever the names of topics, encodings and files: printed text has no control characters for the terminal."""

import os
import subprocess
import sys
from typing import Any

import cv2
import numpy as np
import pytest

from stream_sfm.system.wording import printable
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


PRINTING = """
import os, sys, warnings
from stream_sfm.cli.library_messages import filtered

with filtered(quiet=sys.argv[1] == "quiet"):
    os.write(2, b"\\x1b[2J\\x9b31m\\n" + b"x" * 3000 + b"\\n" + b"again\\n" * 100_000)  # more than a pipe holds
    warnings.warn("of a library", RuntimeWarning)
    os.write(1, b"of a driver\\x1b\\n")
    print("{}", flush=True)
    print("ours", file=sys.stderr)
    if sys.argv[1] == "killed":
        os.kill(os.getpid(), 9)
os.write(2, b"at the end")
os.write(1, b" and the end")
"""


@pytest.mark.parametrize(("how", "code", "shown"), [("quiet", 0, 0), ("normal", 0, 18), ("killed", -9, 18)])
def test_what_libraries_print_is_filtered(how: str, code: int, shown: int) -> None:
    """Past Python, and where the process is killed."""
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", PRINTING, how], **piped) as running:
        out, said = (text.decode() for text in running.communicate(timeout=1800))
    assert out == "{}\n" + " and the end" * (code == 0)  # nothing of libraries
    assert running.returncode == code
    assert not obeyed(said) and "ours\n" in said and "RuntimeWarning" not in said and len(said) < 2000
    assert said.count("library: again\n") == shown
    assert (r"library: \x1b[2J\x9b31m" in said) == ("not shown; --debug" in said) == (how != "quiet")
    assert ("at the end" in said) == (code == 0)


def test_a_hostile_video_says_nothing_to_the_terminal(tmp_path):
    """The name of a codec is four bytes of the file, which OpenCV prints."""
    path = tmp_path / "left.avi"
    writer = cv2.VideoWriter(os.fspath(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for _ in range(5):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    path.write_bytes(path.read_bytes().replace(b"MJPG", b"\x1b[2J"))
    (tmp_path / "right.avi").write_bytes(path.read_bytes())
    for more in ([], ["-q"]):
        command = [sys.executable, "-m", "stream_sfm", "replay", tmp_path, "--out", tmp_path / "o", *more]
        ended = subprocess.run(command, capture_output=True, timeout=1800)
        assert ended.returncode == 3 and not obeyed(ended.stderr.decode())


COMMANDS = [
    "inspect {log}", "inspect {odd}", "inspect {log} --json", "recover {log} {dir}/o{esc}.mcap",
    "replay {log} --out {dir}/o{esc} --method frame-to-frame -v",
    "replay {log} --left {esc} --right {esc} --out {dir}/o",
    "replay {log} --out {dir}/o --json --method frame-to-frame", "replay {dir}/missing{esc} --out {dir}/o",
    "replay {log} --{esc}", "replay {log} --config {esc}", "batch {log} --out {dir}/o{esc} --method frame-to-frame",
    "batch {dir}/missing{esc} --out {dir}/o{esc}", "surface {log} --out {dir}/s{esc}.ply --frame 2",
]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_sent_to_a_terminal(command, log, tmp_path, cli):
    names: dict[str, Any] = {"log": log, "dir": tmp_path, "odd": tmp_path / "odd.mcap", "esc": "\x1b[2J\x9b31m"}
    said = cli(*(word.format(**names) for word in command.split()), code=(0, 2, 3))
    assert said.out or said.err
    assert not obeyed(said.out + said.err)
    if "--json" in command:  # the names themselves, not what is shown of them
        assert said.json["log"] in (str(log), log.name)
