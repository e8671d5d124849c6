"""A stereo log: its rig and its frames, streamed in bounded memory."""

from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..camera.rig import MonoRig, StereoRig
from ..errors import ConfigError, LogError
from ..mcap_file.log_file import Damage, LogFile
from ..types import StereoFrame, Trajectory
from .ground_truth import DepthImages, depth_topic, read_depths, read_truth, truth_topic
from .images import Grey, GreyScaler, UndecodableImage, decode_grey, image_size
from .messages import MessageDecoder, UndecodableMessage
from .pair_reader import PairReader, ReadStats, StereoPair
from .rig import check_rig
from .rig_finder import find_camera, find_rig
from .survey import Survey, survey_log
from .topics import PairChoice, choose_one, choose_pair


def open_log(
    path: str | Path,
    left: str | None = None,
    right: str | None = None,
    calibration: str | Path | StereoRig | MonoRig | None = None,
    mono: bool = False,
) -> "StereoLog":
    """Open an MCAP file for reading as a stereo log.

    `left`, `right`: topics, found by schema and name if not given. `calibration`: a calibration file or a rig,
    instead of the one in the log. `mono`: the left camera alone; the log need not have another. Raises LogError where
    the log cannot be used, ConfigError for the calibration.
    """
    file = LogFile(path)
    try:
        return _open(file, left, right, calibration, mono)
    except LogError:
        if file.index is None or file.index.checksummed:
            raise
    # Without a checksum the index may be what is wrong: let the file speak for itself.
    file.index, file.index_problem = None, "it carries no checksum, and by it the log cannot be used"
    return _open(file, left, right, calibration, mono)


def _open(
    file: LogFile,
    left: str | None,
    right: str | None,
    calibration: str | Path | StereoRig | MonoRig | None,
    mono: bool,
) -> "StereoLog":
    damage = Damage()
    survey = survey_log(file, damage)
    if mono:
        one = choose_one(file.path, _images(file, survey, left, None, damage.notes), left)
        camera = find_camera(file, survey, one.left, calibration)
        check_rig(file.path, camera)
        return StereoLog(file, survey, one, camera)
    if isinstance(calibration, MonoRig):
        raise ConfigError("the calibration is of one camera; a pair is needed, or mono")
    choice = choose_cameras(file, survey, left, right, damage.notes)
    rig = find_rig(file, survey, choice, calibration).rig
    check_rig(file.path, rig)
    return StereoLog(file, survey, choice, rig)


def choose_cameras(
    file: LogFile, survey: Survey, left: str | None, right: str | None, notes: Sequence[str] = ()
) -> PairChoice:
    """The two camera topics. Raises LogError, with the `notes` of the survey where it found nothing."""
    return choose_pair(file.path, _images(file, survey, left, right, notes), left, right)


def _images(
    file: LogFile, survey: Survey, left: str | None, right: str | None, notes: Sequence[str]
) -> dict[str, int | None]:
    """The image topics. Raises LogError where there can be none."""
    videos = survey.of_kind("video")
    images = survey.of_kind("image")
    if any(t in videos for t in (left, right)) or (not images and videos):
        raise LogError(
            f"{file.path}: topic {next(iter(videos))} is compressed video (H.264 or the like), which is not read: "
            "its frames depend on each other; record or convert to CompressedImage (jpeg, png) or raw images"
        )
    if not survey.topics:
        raise LogError(
            f"{file.path} holds no message that can be read ({file.size} bytes){''.join(f'; {n}' for n in notes)}"
        )
    return images


class StereoLog:
    """A log whose cameras and calibration are known. Each reading opens the file anew and renews `stats`.

    `path`; `rig`: the cameras it is read with, one or two; `left_topic`, `right_topic` and
    `choice_reason`; `expected_frames`: images on the left topic by the index, None where there is none; `duration_s`:
    span of the recording's own clock, None where not known.
    """

    def __init__(self, file: LogFile, survey: Survey, choice: PairChoice, rig: StereoRig | MonoRig) -> None:
        self._file = file
        self.survey = survey
        self.path = file.path
        self.rig = rig
        self.left_topic, self.right_topic, self.choice_reason = choice.left, choice.right, choice.reason
        self._reader = PairReader(file, choice.left, choice.right)
        self.expected_frames = survey.topics[choice.left].count if survey.whole else None
        self.duration_s = (survey.end_ns - survey.start_ns) / 1e9 if survey.whole else None
        self._camera_frame = ""

    @property
    def stereo_rig(self) -> StereoRig:
        """The rig of both cameras. Raises ConfigError where the log was opened for one."""
        if not isinstance(self.rig, StereoRig):
            raise ConfigError(f"{self.path} was opened for one camera (mono): what is asked for needs two")
        return self.rig

    @property
    def stats(self) -> ReadStats:
        """What the latest reading met; final when its iterator has ended."""
        return self._reader.stats

    def pairs(self) -> Generator[StereoPair, None, None]:
        """All pairs in ascending order of stamps, not decoded; see `PairReader.pairs`."""
        return self._reader.pairs()

    def frames(
        self,
        start_s: float | None = None,
        end_s: float | None = None,
        max_frames: int | None = None,
        stride: int = 1,
    ) -> Iterator[StereoFrame]:
        """The frames between `start_s` and `end_s` (seconds from the first pair, both included), every
        `stride`-th pair, at most `max_frames`. Raises as `pairs`, and LogError where no frame can be delivered.
        """
        for _, frame in self.decoded(start_s, end_s, max_frames, stride):
            yield frame

    def decoded(
        self,
        start_s: float | None = None,
        end_s: float | None = None,
        max_frames: int | None = None,
        stride: int = 1,
    ) -> Generator[tuple[StereoPair, StereoFrame], None, None]:
        """As `frames`, each with the recorded bytes it came from.

        Left and right are decoded at the same time, one frame ahead of the consumer; of one camera they are the same.
        """
        if stride < 1:
            raise ValueError(f"stride must be at least 1, got {stride}")
        if max_frames is not None and max_frames < 1:
            raise ValueError(f"max_frames must be at least 1, got {max_frames}")
        reading = _Decoding(self)
        pairs = self._selected(start_s, end_s, stride)
        delivered = 0
        try:
            with ThreadPoolExecutor(2, thread_name_prefix="decode") as pool:
                for item in reading.run(pairs, pool):
                    delivered += 1
                    yield item
                    if delivered == max_frames:
                        break
        finally:
            pairs.close()
            if reading.problem:
                self.stats.warnings.append(
                    f"{self.stats.undecodable} frames were skipped as undecodable, the first: {reading.problem}"
                )
        if not delivered:
            if reading.problem:
                raise LogError(f"{self.path}: no image could be decoded: {reading.problem}")
            raise LogError(
                f"{self.path}: none of {self.stats.paired} frames lies between start {start_s} s and end {end_s} s"
            )

    def _selected(
        self, start_s: float | None, end_s: float | None, stride: int
    ) -> Generator[StereoPair, None, None]:
        start_ns = 0 if start_s is None else round(start_s * 1e9)
        end_ns = None if end_s is None else round(end_s * 1e9)
        first: int | None = None
        count = 0
        pairs = self.pairs()
        try:
            for pair in pairs:
                first = pair.stamp_ns if first is None else first
                since_ns = pair.stamp_ns - first
                if end_ns is not None and since_ns > end_ns:
                    return
                if since_ns >= start_ns:
                    if count % stride == 0:
                        yield pair
                    count += 1
        finally:
            pairs.close()

    def ground_truth(self) -> Trajectory | None:
        """`world_from_cam` of the physical left camera, None where the log has none that can be used."""
        topic = truth_topic(self.survey)
        if topic is None:
            return None
        if not self._camera_frame:
            for message in self._file.messages(Damage(), frozenset([self.left_topic])):
                try:
                    self._camera_frame = MessageDecoder(self.path).image(message).frame_id
                except UndecodableMessage:
                    continue
                break
        return read_truth(self._file, topic, self._camera_frame, self.stats.warnings)

    def depths(self) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """(stamp_ns, depth (h, w) float32 in metres, NaN where unknown) from ground truth, if any."""
        if (topic := depth_topic(self.survey)) is not None:
            yield from read_depths(self._file, topic, self.stats.warnings)

    def depth_images(self) -> DepthImages:
        """The same images, looked up by the stamps of frames."""
        return DepthImages(self.depths())


class _Decoding:
    """Pairs to frames, one ahead; the first images decide whether the sizes fit the calibration at all."""

    def __init__(self, log: StereoLog) -> None:
        self._log = log
        self._cameras = list(log.rig.cameras.values())
        self._scaler = GreyScaler()
        self._delivered = False
        self.problem = ""

    def run(
        self, pairs: Iterator[StereoPair], pool: ThreadPoolExecutor
    ) -> Iterator[tuple[StereoPair, StereoFrame]]:
        ahead: tuple[StereoPair, list[Future[Grey]]] | None = None
        for pair in pairs:
            if not self._fits(pair):
                continue
            submitted = (pair, [pool.submit(decode_grey, m) for m in pair.images[: len(self._cameras)]])
            if ahead is not None and (frame := self._frame(*ahead)) is not None:
                yield ahead[0], frame
            ahead = submitted
        if ahead is not None and (frame := self._frame(*ahead)) is not None:
            yield ahead[0], frame

    def _fits(self, pair: StereoPair) -> bool:
        """Before decoding, so that a damaged header cannot ask for gigabytes."""
        for message, camera in zip(pair.images, self._cameras, strict=False):
            size = image_size(message)
            if size is None:
                self._skip(f"{message.topic}: the header of an image is damaged")
                return False
            if size != (camera.width, camera.height):
                text = (
                    f"topic {message.topic}: images are {size[0]}×{size[1]}, the calibration is for "
                    f"{camera.width}×{camera.height}"
                )
                if not self._delivered:
                    raise LogError(
                        f"{self._log.path}: {text}: give the calibration of these images", hint=("calibration",)
                    )
                self._skip(text)
                return False
        self._delivered = True
        return True

    def _frame(self, pair: StereoPair, futures: list[Future[Grey]]) -> StereoFrame | None:
        try:
            images = self._scaler.to_uint8(*[f.result() for f in futures])
        except UndecodableImage as error:
            self._skip(str(error))
            return None
        return StereoFrame(pair.stamp_ns, images[0], images[-1])

    def _skip(self, problem: str) -> None:
        self._log.stats.undecodable += 1
        self.problem = self.problem or problem
