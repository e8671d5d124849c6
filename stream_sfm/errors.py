"""Every exception this package raises on purpose.

    StreamSfmError
    ├── ConfigError        a setting, a calibration file or an argument is wrong      (exit code 2)
    │   └── RigError       no image can be rectified by this calibration
    ├── InputError         a log or a frame cannot be used                            (exit code 3)
    │   ├── LogError       the file is not a log, is damaged, or holds no stereo pair
    │   └── FrameError     one frame is unusable: type, shape, stamp
    └── OutputError        a result cannot be written                                 (exit code 3)

Each message names the file, topic or frame, and says what to do. Lost tracking is not an error: it is a
`FrameEstimate` whose status is `lost`.
"""


class StreamSfmError(Exception):
    """Base of all; `exit_code` is what the command line returns."""

    exit_code = 1


class ConfigError(StreamSfmError):
    """A setting, a calibration file or an argument is wrong."""

    exit_code = 2


class RigError(ConfigError):
    """No image can be rectified by this calibration; of a log's own one the log is told (LogError)."""


class InputError(StreamSfmError):
    """A log or a frame cannot be used."""

    exit_code = 3


class LogError(InputError):
    """The file is not a log, is damaged, or holds no stereo pair."""


class FrameError(InputError):
    """One frame is unusable; the engine that refused it is unchanged and usable."""


class OutputError(StreamSfmError):
    """A result cannot be written."""

    exit_code = 3
