"""A run notices a signal between two frames; a second one ends it at once."""

import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path

import pytest
from mcap.opcode import Opcode

from stream_sfm.system.interrupts import deferred_interrupts, termination_as_interrupt


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_is_a_request_and_the_second_acts(number: signal.Signals) -> None:
    def act(*_: object) -> None:
        raise InterruptedError("acted")

    before = signal.signal(number, act)
    try:
        with deferred_interrupts() as interruption:
            assert not interruption.requested
            os.kill(os.getpid(), number)
            assert interruption.requested
            with pytest.raises(InterruptedError, match="acted"):
                os.kill(os.getpid(), number)
        assert signal.getsignal(number) is act
    finally:
        signal.signal(number, before)


def test_in_another_thread_signals_are_left_alone() -> None:
    handlers = []

    def run() -> None:
        with deferred_interrupts() as interruption:
            handlers.append((signal.getsignal(signal.SIGINT), interruption.requested))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert handlers == [(signal.getsignal(signal.SIGINT), False)]


@pytest.mark.parametrize("frames_before", [1, 0])
def test_a_frame_that_does_not_come_is_not_waited_for(frames_before: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where not even the first one comes the run is interrupted."""
    monkeypatch.setattr("stream_sfm.system.interrupts.GRACE_S", 0.05)

    def frames() -> Iterator[int]:
        yield from range(frames_before)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60)
        yield frames_before

    with deferred_interrupts() as interruption:
        with nullcontext() if frames_before else pytest.raises(KeyboardInterrupt):
            assert list(interruption.until_requested(frames())) == [0]  # had it been waited for, 1 would be there
        assert interruption.requested
    assert signal.getitimer(signal.ITIMER_REAL) == (0, 0)


def test_the_frame_in_hand_is_finished_however_long_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stream_sfm.system.interrupts.GRACE_S", 0.05)
    taken = []
    with deferred_interrupts() as interruption:
        for item in interruption.until_requested([1, 2]):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.2)
            taken.append(item)
    assert taken == [1]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_termination_cleans_up_like_ctrl_c(number: signal.Signals) -> None:
    assert signal.getsignal(number) is signal.SIG_DFL
    with pytest.raises(KeyboardInterrupt), termination_as_interrupt():
        os.kill(os.getpid(), number)
        time.sleep(60)
    assert signal.getsignal(number) is signal.SIG_DFL


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_that_is_ignored_stays_ignored(number: signal.Signals) -> None:
    """As nohup starts a program, or a script one in its background."""
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with termination_as_interrupt(), deferred_interrupts() as interruption:
            os.kill(os.getpid(), number)
            assert not interruption.requested
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, before)


@pytest.fixture(scope="module")
def endless_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log without an index whose two million messages are all of another topic: opening it takes seconds."""
    body = struct.pack("<HH", 9, 0) + struct.pack("<I", 2) + b"/x" + struct.pack("<II", 0, 0)
    head = struct.pack("<BQII", Opcode.HEADER, 8, 0, 0) + struct.pack("<BQ", Opcode.CHANNEL, len(body)) + body
    message = struct.pack("<BQ", Opcode.MESSAGE, 22) + struct.pack("<HIQQ", 9, 0, 0, 0)
    log = tmp_path_factory.mktemp("endless") / "long.mcap"
    log.write_bytes(b"\x89MCAP0\r\n" + head + message * 2_000_000)
    return log


def _has_open(pid: int, path: Path) -> bool:
    for file in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # closed meanwhile
            if os.readlink(file) == os.path.realpath(path):
                return True
    return False


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="this system does not list the files of a process")
@pytest.mark.parametrize("command", ["replay", "inspect"])
def test_a_run_ends_while_its_log_is_opened(command: str, endless_log: Path, tmp_path: Path) -> None:
    arguments = [command, str(endless_log), *([] if command == "inspect" else ["--out", str(tmp_path / "out")])]
    with subprocess.Popen([sys.executable, "-m", "stream_sfm", *arguments], stderr=subprocess.PIPE) as run:
        while run.poll() is None and not _has_open(run.pid, endless_log):
            time.sleep(0.01)
        run.send_signal(signal.SIGTERM)
        _, errors = run.communicate()
    assert run.returncode == 130 and errors.splitlines()[-1] == b"stream-sfm: interrupted"
