"""Memory that the system refuses, at the start or in a frame, is reported in a sentence; written files are complete."""

import errno
import resource
import subprocess
import sys
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard

import stream_sfm as sfm
from stream_sfm.pipeline.observer import Observer
from stream_sfm.system import memory

MIB = 2**20


def limited(mib: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (mib * MIB, mib * MIB))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit address space")
@pytest.mark.parametrize("mib", [100, 200, 300, 340, 370, 390, 410, 450])
def test_a_limit_is_met_by_a_sentence(mib: int, wall_log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "stream_sfm", "replay", wall_log, "--out", out, "-q"]
    ended = subprocess.run(command, capture_output=True, preexec_fn=partial(limited, mib), timeout=1800)
    said = ended.stderr.decode()
    assert ended.returncode in (0, 3), said
    if ended.returncode:
        assert "the system refuses the memory that is needed" in said and said.count("\n") <= 2
    assert not list(tmp_path.rglob("*.part"))
    if (out / "estimates.mcap").exists():
        assert len(sfm.read_results(out))


def test_all_refusals_are_known() -> None:
    with pytest.raises(cv2.error) as refused:
        cv2.resize(np.zeros((9, 9), np.uint8), (2**24, 2**24))
    known = [
        refused.value, MemoryError(), OSError(errno.ENOMEM, "Cannot allocate memory"),
        ImportError("cv2.abi3.so: failed to map segment from shared object"), RuntimeError("can't start new thread"),
        zstandard.ZstdError("cannot compress: Allocation error : not enough memory"),
    ]  # fmt: skip
    assert all(map(memory.is_refused, known))
    others = [
        OSError(errno.ENOSPC, ""), ImportError("no module"), RuntimeError("x"), ValueError("x"),
        zstandard.ZstdError("x"),
    ]  # fmt: skip
    assert not any(map(memory.is_refused, others))


@pytest.mark.parametrize("error", [MemoryError(), cv2.error("no memory")])
def test_memory_that_is_refused_in_a_frame_costs_no_frame_before(
    error: Exception, wall_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli
) -> None:
    if isinstance(error, cv2.error):
        error.code = -4
    observe, seen = Observer.observe, []

    def observe_some(self: Observer, *given: object) -> object:
        seen.append(given)
        if len(seen) > 4:
            raise error
        return observe(self, *given)

    monkeypatch.setattr(Observer, "observe", observe_some)
    out = tmp_path / "out"
    assert "the system refuses the memory" in cli("replay", wall_log, "--out", out, code=3).err
    assert len(sfm.read_results(out)) == 4 and not list(out.glob("*.part"))
