"""A Rerun stream to a file, to a viewer that it starts, or to both; failures raise errors of this package."""

import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO

import rerun as rr
import rerun.blueprint as rrb

from ..errors import ConfigError, OutputError, as_error

_LOCAL = "127.0.0.1"  # by default a viewer would listen on every interface
_WAIT_S = 30.0  # until a viewer listens (seconds on a loaded machine), and for the last data on a slow disk
_FOR_FILES = rr.ChunkBatcherConfig(flush_tick=10.0, flush_num_bytes=16 * 2**20)  # seconds; bytes held in memory


class Recording:
    """A stream of the displayed data, named `name`: to the file `rrd`, to a viewer window (`view`), or to both.

    Raises ConfigError if neither is requested or no viewer starts, OutputError if the file cannot be opened.
    """

    def __init__(self, rrd: str | Path | None, view: bool, blueprint: rrb.Blueprint, name: str) -> None:
        if rrd is None and not view:
            raise ConfigError("a viewer needs a file to write (rrd) or a window (view=True)")
        # A window shows a frame at once; a file alone is written in few large pieces, which open faster.
        batches = rr.ChunkBatcherConfig() if view else _FOR_FILES
        self.stream = rr.RecordingStream("stream_sfm", recording_id=None, batcher_config=batches)
        self._file = None if rrd is None else _File(rrd)
        self.viewer: subprocess.Popen[bytes] | None = None
        self.url = ""  # of the viewer
        sinks: list[rr.FileSink | rr.GrpcSink] = []
        if view:
            self.viewer, port = _start_viewer()
            self.url = f"rerun+http://{_LOCAL}:{port}/proxy"
            sinks.append(rr.GrpcSink(self.url))
        if self._file is not None:
            sinks.append(rr.FileSink(f"/dev/fd/{self._file.sink_fd}"))
        self.stream.set_sinks(*sinks, default_blueprint=blueprint)
        if self._file is not None:
            os.close(self._file.sink_fd)  # Rerun has opened it
        self.stream.set_log_time_enabled(False)
        self.stream.send_recording_name(name)

    @property
    def watched(self) -> bool:
        """Whether the data has a destination: False once the window, if it is the only one, has been closed."""
        return self._file is not None or self.viewer is None or self.viewer.poll() is None

    def close(self) -> None:
        """Write all buffered data. Raises OutputError if the file is incomplete."""
        problem = ""
        try:
            if self.watched:
                self.stream.flush(timeout_sec=_WAIT_S)
        except Exception as error:  # Rerun raises its own exceptions
            problem = str(error).partition("\n")[0]
        self.stream.disconnect()
        if self._file is not None:
            problem = self._file.close() or (problem if self.viewer is None else "")
            if problem:
                raise OutputError(f"the recording {self._file.path} is incomplete: {problem}")


class _File:
    """A file that our own thread writes, from a pipe whose end `sink_fd` Rerun opens as a file.

    Rerun's own file sink may wait forever for a full disk, without reacting to signals.
    """

    def __init__(self, path: str | Path) -> None:
        self.path, self._problem = path, ""
        with as_error(OutputError, f"cannot write {path}", OSError):
            file = open(path, "wb", buffering=0)  # noqa: SIM115 the thread closes it
        source, self.sink_fd = os.pipe()
        self._thread = threading.Thread(target=self._copy, args=(source, file), daemon=True)
        self._thread.start()

    def close(self) -> str:
        """Wait for the last data; return why the file is incomplete, if it is."""
        self._thread.join(_WAIT_S)
        return "the disk is too slow" if self._thread.is_alive() else self._problem

    def _copy(self, source: int, file: IO[bytes]) -> None:
        with open(source, "rb", buffering=0) as pipe, file:
            while data := memoryview(pipe.read(2**20)):
                try:
                    while data and not self._problem:
                        data = data[file.write(data) :]
                except OSError as error:  # the pipe is still emptied, so that Rerun never waits
                    self._problem = error.strerror or str(error)


def _start_viewer() -> tuple["subprocess.Popen[bytes]", int]:
    """Start the installed viewer on a free port of this computer only; return it once it listens.

    It is a separate process that stays open after the run, as with `rerun.spawn`, which offers no address.
    """
    if sys.platform.startswith("linux") and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))):
        raise ConfigError(
            "there is no display for a viewer: write a recording to a file and open it on another computer",
            hint=("rrd",),
        )
    with socket.socket() as free:
        free.bind((_LOCAL, 0))
        port = free.getsockname()[1]
    # not `-m rerun`, because RERUN_APP_ONLY, which skips the questions of a first start, switches the SDK off
    command = [sys.executable, "-m", "rerun_cli", "--bind", _LOCAL, "--port", str(port), "--hide-welcome-screen"]
    viewer = subprocess.Popen(
        command,
        env=os.environ | {"RERUN_APP_ONLY": "true", "RUST_LOG": "error", "NO_COLOR": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C ends the run, not the window
    )
    deadline_s = time.monotonic() + _WAIT_S
    while viewer.poll() is None and time.monotonic() < deadline_s:
        with socket.socket() as trial:
            if trial.connect_ex((_LOCAL, port)) == 0:
                return viewer, port
        time.sleep(0.05)
    why = "it takes too long" if viewer.poll() is None else f"it ended with code {viewer.returncode}"
    if viewer.poll() is None:
        viewer.terminate()
    raise ConfigError(
        f"the viewer could not be started ({why}; `rerun` shows more): write a recording to a file instead",
        hint=("rrd",),
    )
