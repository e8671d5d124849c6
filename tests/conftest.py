"""What tests of several rooms share. One BLAS thread, set before NumPy is imported: test processes share the cores."""

import os
import signal

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from pathlib import Path

import pytest

from tests.helpers.command_line import CommandLine
from tests.helpers.wall_log import write_wall_log

# Signals act on tests, and on the processes they start, even where whatever started them ignores these: nohup ignores
# a hang-up, and a script Ctrl-C in what it starts in the background.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where a test may write its log."""
    return tmp_path / "log.mcap"


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> CommandLine:
    """The commands, in this process."""
    return CommandLine(capsys)


@pytest.fixture(scope="session")
def wall_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of twelve frames with ground truth of pose and depth. Not to be changed."""
    return write_wall_log(tmp_path_factory.mktemp("logs") / "wall.mcap")
