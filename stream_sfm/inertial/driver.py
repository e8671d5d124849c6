"""Samples from a driver, one by one, until their frame comes."""

import threading
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..errors import FrameError
from ..system.inputs import INT64
from .samples import ImuSamples
from .settings import SETTINGS

T = TypeVar("T")


class DriverSamples:
    """Samples that no frame has yet; any thread may add to them."""

    def __init__(self) -> None:
        self._waiting: list[tuple[int, np.ndarray[Any, np.dtype[np.float64]]]] = []
        self._lock = threading.Lock()

    def __getstate__(self) -> list[Any]:
        """Return the samples, without the lock, which belongs to this process."""
        return self._waiting

    def __setstate__(self, state: list[Any]) -> None:
        self._waiting, self._lock = list(state), threading.Lock()

    def add(self, stamp_ns: int, gyro_rad_s: ArrayLike, accel_m_s2: ArrayLike) -> None:
        """Take one sample. Raises FrameError for an invalid one."""
        try:
            sample = np.concatenate([np.asarray(gyro_rad_s, float), np.asarray(accel_m_s2, float)])
        except (TypeError, ValueError):
            sample = np.empty(0)
        if sample.shape != (6,) or isinstance(stamp_ns, bool) or not isinstance(stamp_ns, int | np.integer):
            raise FrameError(
                f"an inertial sample at {stamp_ns!r} has {sample.size} numbers: give stamp_ns, an integer, and "
                "gyro_rad_s and accel_m_s2, three numbers each"
            )
        if not -INT64 <= stamp_ns < INT64:
            raise FrameError(f"the stamp of an inertial sample is {stamp_ns}: give nanoseconds that fit into 64 bits")
        with self._lock:
            self._waiting.append((int(stamp_ns), sample))
            del self._waiting[: -SETTINGS.waiting]

    def so_far(self) -> ImuSamples:
        return _samples_of(self._waiting.copy())

    def take_until(self, stamp_ns: int) -> ImuSamples | None:
        """Return and forget the samples up to a stamp and one beyond it; None if none wait.

        Later samples wait for the next frame, so that the data of an estimate depends on stamps alone.
        """
        with self._lock:
            if not self._waiting:
                return None
            # The last one up to it, so that a stamp that jumps ahead does not hold back later ones.
            beyond = max((i for i, (stamp, _) in enumerate(self._waiting, 1) if stamp <= stamp_ns), default=0)
            taken, self._waiting = self._waiting[: beyond + 1], self._waiting[beyond + 1 :]
        return _samples_of(taken)

    def joined_to(self, frame: T) -> T:
        """Return the frame with its samples, unless it has its own or there are none."""
        stamp_ns = getattr(frame, "stamp_ns", None)
        if not isinstance(stamp_ns, int | np.integer) or getattr(frame, "imu", frame) is not None:
            return frame
        samples = self.take_until(int(stamp_ns))
        return frame if samples is None else replace(frame, imu=samples)  # type: ignore[type-var]


def _samples_of(waiting: list[tuple[int, Any]]) -> ImuSamples:
    if not waiting:
        return ImuSamples.joined([])
    values = np.array([sample for _, sample in waiting])
    return ImuSamples(np.array([stamp for stamp, _ in waiting], np.int64), values[:, :3], values[:, 3:])
