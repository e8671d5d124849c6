"""The inertial unit of a log: its topics, its mounting, and the samples of each frame."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...camera.rig import MonoRig, StereoRig
from ...errors import ConfigError, LogError, as_error
from ...geometry import Array
from ...inertial.samples import ImuCalibration, ImuSamples
from ...record import record
from ..mcap_file.message import Source
from .frames import RecordedFrame
from .messages import ImuMessage, MessageDecoder, decoded
from .survey import Survey
from .transforms import fixed_transform

_BEFORE_NS = 200_000_000  # the first frame gets the samples of this time before it
_MOST = 20_000  # samples per frame; more mean a clock that jumped


@record
class ImuTopics:
    """The topics of inertial samples: `gyro` and `accel`, which may be the same."""

    gyro: str
    accel: str

    @property
    def names(self) -> tuple[str, ...]:
        """Each topic once."""
        return (self.gyro,) if self.gyro == self.accel else (self.gyro, self.accel)


def find_topics(survey: Survey) -> ImuTopics | None:
    """Return the topics of the inertial unit; of several units the first by name. None if there is none.

    RealSense sends gyroscope and accelerometer on separate topics.
    """
    topics = sorted(t for t, count in survey.of_kind("imu").items() if count != 0)
    gyro = next((t for t in topics if "gyro" in t.lower()), None)
    accel = next((t for t in topics if "accel" in t.lower()), None)
    both = [t for t in topics if t not in (gyro, accel)]
    if both:
        return ImuTopics(both[0], both[0])
    if gyro is None or accel is None:
        return None
    return ImuTopics(gyro, accel)


def mounted(source: Source, survey: Survey, topics: ImuTopics, rig: StereoRig, left_frame: str) -> StereoRig:
    """Return the rig with its inertial unit, mounted as its calibration or transforms say. Raises LogError."""
    if rig.imu is not None:
        return rig
    if source.imu is not None:
        return replace(rig, imu=source.imu)
    first = next(decoded(source, [topics.gyro], MessageDecoder.imu), None)
    if first is None:
        raise LogError(f"no sample on topic {topics.gyro} can be read")
    pose = fixed_transform(source, survey, left_frame, first.frame_id) if left_frame else None
    if pose is None:
        frames = f"frame {first.frame_id!r} of {topics.gyro} to the left camera, {left_frame!r}"
        raise LogError(f"no fixed transform leads from {frames}: give [imu] in the calibration")
    with as_error(LogError, "", ConfigError):
        return replace(rig, imu=ImuCalibration(pose))


def with_imu(rig: StereoRig | MonoRig, imu: ImuCalibration | None) -> StereoRig | MonoRig:
    """Return a rig with a unit, unless it already has one."""
    if imu is None or not isinstance(rig, StereoRig) or rig.imu is not None:
        return rig
    return replace(rig, imu=imu)


class SamplesOfFrames:
    """Distributes the samples of one reading of a log to its frames."""

    def __init__(self, source: Source, topics: ImuTopics) -> None:
        self._samples = samples_of(source, topics)
        self._coming: ImuMessage | None = None
        self._given_ns: int | None = None  # the stamp of the latest sample that a frame got
        self._begun = False

    def added_to(self, frame: RecordedFrame) -> RecordedFrame:
        """Return the next frame with its samples: all since the previous frame, and one after it."""
        taken: deque[ImuMessage] = deque(maxlen=_MOST)
        coming, given_ns = self._coming if self._begun else next(self._samples, None), self._given_ns
        # The next stamp is compared as well, so that a stamp that jumps ahead does not hold back later samples.
        while coming is not None and (given_ns is None or min(given_ns, coming.stamp_ns) <= frame.stamp_ns):
            if self._begun or coming.stamp_ns > frame.stamp_ns - _BEFORE_NS:
                taken.append(coming)
            given_ns, coming = coming.stamp_ns, next(self._samples, None)
        self._begun, self._coming, self._given_ns = True, coming, given_ns
        return replace(frame, imu=joined_samples(taken))


def joined_samples(taken: Sequence[ImuMessage]) -> ImuSamples:
    """Return the content of messages as arrays."""
    if not taken:
        return ImuSamples.joined([])
    return ImuSamples(
        np.array([m.stamp_ns for m in taken], np.int64),
        np.array([m.gyro_rad_s for m in taken]),
        np.array([m.accel_m_s2 for m in taken]),
    )


def samples_of(source: Source, topics: ImuTopics) -> Iterator[ImuMessage]:
    """Yield the samples of a unit; with two topics, those of the gyroscope with interpolated accelerations."""
    messages = decoded(source, topics.names, MessageDecoder.imu)
    if topics.gyro == topics.accel:
        yield from messages
        return
    waiting: deque[ImuMessage] = deque(maxlen=_MOST)  # of the gyroscope
    before: ImuMessage | None = None
    for message in messages:
        if message.topic == topics.gyro:
            waiting.append(message)
            continue
        for _ in range(len(waiting)):
            sample = waiting.popleft()
            if sample.stamp_ns > message.stamp_ns:
                waiting.append(sample)
            else:
                yield replace(sample, accel_m_s2=_between(before or message, message, sample.stamp_ns))
        before = message
    if before is not None:
        for sample in waiting:
            yield replace(sample, accel_m_s2=before.accel_m_s2)


def _between(first: ImuMessage, then: ImuMessage, stamp_ns: int) -> Array:
    apart = then.stamp_ns - first.stamp_ns
    part = min(max((stamp_ns - first.stamp_ns) / apart, 0.0), 1.0) if apart > 0 else 1.0
    return (1 - part) * first.accel_m_s2 + part * then.accel_m_s2
