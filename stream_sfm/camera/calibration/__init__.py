"""Calibration files: one module per format, from the bytes of a file to cameras.

Each module has `parse_pair` and `parse_left`, which raise ConfigErrors that name file and key. Rigs are made of what
they return in `camera/rig.py`.
"""

from pathlib import Path

from ...errors import ConfigError


def read_file(path: str | Path) -> bytes:
    """The content of a calibration file. Raises ConfigError where it cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f"cannot read calibration {path}: {error.strerror}") from None
