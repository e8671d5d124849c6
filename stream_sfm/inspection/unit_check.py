"""The samples of an inertial unit on their own: rate, gaps, magnitudes, and whether they can be used."""

from dataclasses import dataclass
from itertools import islice

import numpy as np

from ..geometry import Array
from ..inertial.buffer import SampleBuffer
from ..inertial.samples import ImuCalibration
from ..inertial.settings import SETTINGS
from ..logs.mcap_file.message import Source
from ..logs.recording.inertial import find_topics, joined_samples, samples_of
from ..logs.recording.survey import Survey
from ..system.wording import counted


@dataclass(frozen=True, slots=True)
class UnitCheck:
    """The first `samples` of a unit on its `topics`: their rate, and gaps of more than three periods.

    `specific_force_m_s2`, `turn_rad_s`: median magnitudes of both sensors; 9.81 and 0 at rest. `saturated`: samples
    at the end of the range. `problem`: why they cannot be used; empty if they can.
    """

    topics: list[str]
    samples: int
    rate_hz: float | None
    gap_count: int
    longest_gap_s: float | None
    specific_force_m_s2: float | None
    turn_rad_s: float | None
    saturated: int
    problem: str

    def warnings(self) -> list[str]:
        """Say what is wrong with the samples on their own."""
        found = [f"the IMU is not used: {self.problem}"] if self.problem else []
        if self.gap_count and self.longest_gap_s is not None:
            gaps = counted(self.gap_count, "gap")
            found.append(f"{gaps} between the samples of the IMU, the longest {self.longest_gap_s:.3f} s")
        if self.saturated:
            found.append(f"{counted(self.saturated, 'sample')} of the IMU at the end of its range")
        return found


def check_unit(source: Source, survey: Survey) -> UnitCheck | None:
    """Check the first samples of the unit that a replay would use; None if the log has none.

    Raises LogError if a topic cannot be read.
    """
    topics = find_topics(survey)
    if topics is None:
        return None
    messages = list(islice(samples_of(source, topics), 20_000))  # a hundred seconds at 200 Hz
    if len(messages) < 2:
        problem = f"{len(messages)} samples on {' and '.join(topics.names)} can be read: give a log with more"
        return UnitCheck(list(topics.names), len(messages), None, 0, None, None, None, 0, problem)
    samples = joined_samples(messages)
    buffer = SampleBuffer(ImuCalibration())
    at_once = 200  # as many as a frame might have
    for first in range(0, len(samples), at_once):
        buffer.add(samples[first : first + at_once])
    stamps_s: Array = (np.sort(samples.stamps_ns) - samples.stamps_ns.min()) / 1e9
    steps_s = np.diff(stamps_s)
    period_s = float(np.median(steps_s))
    gaps = steps_s[steps_s > SETTINGS.gap_periods * period_s]
    force, turn = (float(np.nanmedian(np.linalg.norm(a, axis=1))) for a in (samples.accel_m_s2, samples.gyro_rad_s))
    return UnitCheck(
        topics=list(topics.names),
        samples=len(samples),
        rate_hz=1 / period_s if period_s > 0 else None,
        gap_count=len(gaps),
        longest_gap_s=float(gaps.max()) if len(gaps) else None,
        specific_force_m_s2=force if np.isfinite(force) else None,
        turn_rad_s=turn if np.isfinite(turn) else None,
        saturated=buffer.counts["saturated"],
        problem=buffer.problem,
    )
