"""Every exception that this package raises deliberately, and the exit codes of the command line.

    StreamSfmError
    ├── ConfigError        a setting, a calibration file or an argument is wrong      (exit code 2)
    │   └── RigError       no image can be rectified with this calibration
    ├── InputError         a log or a frame cannot be used                            (exit code 3)
    │   ├── LogError       the file is not a log, is damaged, or holds no stereo pair
    │   └── FrameError     one frame is unusable: type, shape, stamp
    ├── OutputError        a result cannot be written                                 (exit code 3)
    └── EngineBusyError    two threads used one engine at the same time               (exit code 1)

Each message names the file, topic or frame, and says what to do. Lost tracking is not an error: it is a
`FrameEstimate` whose status is `lost`.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from importlib.util import find_spec

STUDY = ("scipy", "matplotlib", "filterpy")  # packages of the extra of this name


class ExitCode(IntEnum):
    """The exit code of a command."""

    DONE = 0
    DEFECT = 1  # a defect of stream_sfm itself
    USAGE = 2  # usage or configuration
    INPUT = 3  # input unreadable, unsuitable or only partly read; output that cannot be written
    INTERRUPTED = 130  # Ctrl-C, SIGTERM or SIGHUP; everything so far has been written


class StreamSfmError(Exception):
    """The base class of all errors of this package.

    `exit_code` is the exit code of the command line. `hint` names the arguments of the call, or functions of this
    package, that would help, such as "calibration" or "inspect"; the command line shows them as its own options and
    commands.
    """

    exit_code = ExitCode.DEFECT

    def __init__(self, message: str = "", *, hint: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.hint = tuple(hint)


class ConfigError(StreamSfmError):
    """A setting, a calibration file or an argument is wrong."""

    exit_code = ExitCode.USAGE


class RigError(ConfigError):
    """No image can be rectified with this calibration. If the calibration came with a log, it is a LogError."""


class InputError(StreamSfmError):
    """A log or a frame cannot be used."""

    exit_code = ExitCode.INPUT


class LogError(InputError):
    """The file is not a log, is damaged, or holds no stereo pair."""


class FrameError(InputError):
    """One frame is unusable; the engine that refused it is unchanged and takes the next one."""


class OutputError(StreamSfmError):
    """A result cannot be written."""

    exit_code = ExitCode.INPUT


class EngineBusyError(StreamSfmError):
    """`Engine.step` was called while another thread was in it; the other call is not affected."""


@contextmanager
def as_error(kind: type[StreamSfmError], what: str, *caught: type[Exception]) -> Iterator[None]:
    """Within the context, an exception of the kinds `caught` becomes a `kind` that says what failed, and why."""
    try:
        yield
    except caught as error:
        why = getattr(error, "strerror", None) or str(error)
        raise kind(f"{what}: {why}" if what else why, hint=getattr(error, "hint", ())) from None


def require_study(what: str) -> None:
    """Raise ConfigError before the work begins if packages of the extra `study` are missing, which `what` needs."""
    if missing := [name for name in STUDY if find_spec(name) is None]:
        raise ConfigError(f"{what} needs {' and '.join(missing)}: pip install 'stream-sfm[study]'")
