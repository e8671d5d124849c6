"""Seven logs, and one batch over them in which a process is killed."""

import contextlib
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from stream_sfm.system.executors import ONE_THREAD
from tests.batch.running import GOOD, batch, in_the_midst, meanwhile, outcomes
from tests.helpers.wall_log import write_wall_log


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three short logs, one that is no log, one that takes some seconds."""
    folder = tmp_path_factory.mktemp("logs")
    for k, name in enumerate(GOOD):
        write_wall_log(folder / f"{name}.mcap", n=3 + k % 3, truth=k % 2 == 0)
    (folder / "corrupt.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(range(256)) * 40)
    write_wall_log(folder / "victim.mcap", n=8, times=6, truth=False)
    return folder


@pytest.fixture(scope="session")
def first(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, dict[str, Any]], str]:
    """The results of the first run, during which the victim's process is killed."""
    out = tmp_path_factory.mktemp("out")

    def kill() -> None:
        process = in_the_midst(logs / "victim.mcap", out / "victim")
        assert process is not None
        environment = Path(f"/proc/{process}/environ").read_bytes().split(b"\0")
        os.kill(process, signal.SIGKILL)
        assert {f"{name}=1".encode() for name in ONE_THREAD} <= set(environment)

    present = tmp_path_factory.mktemp("present")  # a folder in which lies something else of the same name
    (present / "stream_sfm.py").write_text("raise ImportError\n")
    with meanwhile(kill), contextlib.chdir(present):
        assert batch(logs, "--out", out, "--workers", 2) == 3
    return out, outcomes(out), (out / "report.html").read_text()
