"""A stereo log: its rig and its frames, streamed in bounded memory."""

import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...camera.calibration.document import Where
from ...camera.rig import MonoRig, StereoRig, baseline_warnings
from ...errors import ConfigError, InputError, LogError
from ...record import changed
from ...system.outputs import refuse_existing
from ...system.wording import counted
from ...types import Selection, Trajectory
from ..mcap_file.message import Damage, Source
from ..sources.recognise import open_source
from .beside import calibration_beside, note_of
from .frames import FrameDecoder, RecordedFrame
from .ground_truth import Depth, DepthImages, depth_topic, read_depths, read_truth, std_of_truth, truth_topic
from .inertial import SamplesOfFrames, find_topics, mounted, with_imu
from .messages import CalibrationMessage, MessageDecoder, decoded
from .pair_reader import PairReader, ReadStats, StereoPair
from .rig import FoundRig, check_rig, find_rig, rig_of_messages
from .survey import Survey, survey_log
from .topics import PairChoice, choose_one, choose_pair, is_rectified
from .truth_file import GroundTruthFile, load_truth, time_warning
from .video_topics import with_videos


def open_log(
    path: str | Path,
    left: str | None = None,
    right: str | None = None,
    calibration: Where | StereoRig | MonoRig | None = None,
    mono: bool = False,
    ground_truth: str | Path | GroundTruthFile | Trajectory | None = None,
    rate_hz: float | None = None,
) -> "StereoLog":
    """Open a recording as a stereo log.

    `left`, `right`: topics, found by schema and name if not given. `calibration`, instead of that in the log: a
    rig, or any calibration that `StereoRig.from_calibration` reads. `mono`: use the left camera alone.
    `ground_truth`, instead of that in the log: a trajectory of the left camera, or its file. `rate_hz`: for a
    folder of images without stamps; 10 if not given. Raises LogError if the log cannot be used, ConfigError for the
    calibration.
    """
    source = open_source(path, calibration is not None, rate_hz, mono)
    try:
        log = _open(source, left, right, calibration, mono)
    except LogError:
        if not source.drop_unverified_index():
            raise
        log = _open(source, left, right, calibration, mono)
    if ground_truth is not None:
        log.use_ground_truth(ground_truth)
    return log


def open_camera(
    *names: str,
    calibration: Where | StereoRig | None = None,
    record: str | Path | None = None,
    size: tuple[int, int] | None = None,
    rate_hz: float | None = None,
    serial: str | None = None,
    exposure_ms: float | None = None,
    overwrite: bool = False,
) -> "StereoLog":
    """Open a stereo camera as a log whose frames are the images that it delivers from now on.

    `names`: `realsense`, `oak` or `zed`; for OpenCV, one camera that delivers both images side by side or stacked, or
    left and right: numbers, device files, stream addresses; or a recording, played at its own pace. `calibration` as in
    `open_log`; the default is the factory calibration, which OpenCV cameras lack. `record`: a log of every image, in
    grey, whether or not it is estimated; it is complete when the frames end, however they end. `overwrite`: it may
    replace a file. `size`, `rate_hz`, `serial` and `exposure_ms` default to those of the camera. Close the log at the
    end. Raises LogError if the camera cannot be opened, ConfigError, OutputError.
    """
    from ..mcap_file.log_writer import MessageWriter
    from ..sources.camera import CameraSource
    from ..sources.devices import CameraOptions, Device, open_device

    if record is not None:
        refuse_existing(record, overwrite)
    options = CameraOptions(size, rate_hz, serial, exposure_ms)
    if len(names) == 1 and (os.path.isfile(names[0]) or os.path.isdir(names[0])):
        if any(option is not None for option in options):
            raise ConfigError(f"{names[0]} is a recording: its size, rate and exposure are what they were")
        recorded = open_log(names[0], calibration=calibration)
        calibration, device = recorded.stereo_rig, Device(recorded.stereo_rig, paced(recorded), recorded.close)
    else:
        if calibration is not None and not isinstance(calibration, StereoRig):
            calibration = StereoRig.from_calibration(calibration)
        device = open_device(names, calibration, options)
    rig = calibration or device.rig
    if rig is None:
        device.close()
        problem = f"camera {' '.join(names)} has no factory calibration: give one"
        raise ConfigError(problem, hint=("calibration",))
    recorder = None if record is None else MessageWriter(record, keep=True, compressed=True)
    return _open(CameraSource(" ".join(names), device, rig, recorder), None, None, rig, mono=False)


def paced(log: "StereoLog") -> Callable[[], tuple[int, NDArray[np.uint8], NDArray[np.uint8]] | None]:
    """Return a function that waits until the next frame of a log is due, as with a camera; None at the end."""
    frames, began = log.frames(), list[float]()

    def grab() -> tuple[int, NDArray[np.uint8], NDArray[np.uint8]] | None:
        if (frame := next(frames, None)) is None:
            return None
        since_s = frame.stamp_ns / 1e9
        began.append(time.monotonic() - since_s)
        time.sleep(max(0.0, began[0] + since_s - time.monotonic()))
        del began[1:]
        return frame.stamp_ns, np.asarray(frame.left, np.uint8), np.asarray(frame.right, np.uint8)

    return grab


def _open(
    source: Source, left: str | None, right: str | None, calibration: Where | StereoRig | MonoRig | None, mono: bool
) -> "StereoLog":
    damage = Damage()
    source, survey = with_videos(source, survey_log(source, damage))
    beside = None if calibration is not None else calibration_beside(source, survey, mono)
    calibration = calibration if beside is None else beside
    if mono:
        choice = choose_one(source.path, _image_topics(source, survey, left, None, damage.notes), left)
    elif isinstance(calibration, MonoRig):
        raise ConfigError("the calibration is of one camera: a pair is needed, or mono")
    else:
        if calibration is not None:  # needed only here, and slow to import (some milliseconds)
            from .both_sides import both_sides

            source, survey, calibration = both_sides(source, survey, calibration)
        choice = choose_cameras(source, survey, left, right, damage.notes)
    found = find_rig(source, survey, choice, calibration, mono)
    check_rig(source, found.rig)
    return StereoLog(source, survey, choice, found, "" if beside is None else note_of(beside))


def choose_cameras(
    source: Source, survey: Survey, left: str | None, right: str | None, notes: Sequence[str] = ()
) -> PairChoice:
    """Choose the two camera topics. Raises LogError, with the `notes` of the survey if it found nothing."""
    if source.format == "video" and len(survey.of_kind("image")) == 1:
        raise LogError(
            f"{source.path} is a video: give the calibration of its images, if each frame holds both; if it is of one "
            "camera, say so; of two videos, left.mp4 and right.mp4, give their folder",
            hint=("calibration", "mono"),
        )
    return choose_pair(source.path, _image_topics(source, survey, left, right, notes), left, right)


def _image_topics(
    source: Source, survey: Survey, left: str | None, right: str | None, notes: Sequence[str]
) -> dict[str, int | None]:
    """Image topic -> number of messages. Raises LogError if there can be no images."""
    videos = survey.of_kind("video")
    images = survey.of_kind("image")
    if any(t in videos for t in (left, right)) or (not images and videos):
        what = f"topic {next(iter(videos))} is compressed video, neither H.264 nor H.265"
        cure = "record or convert to one of these, to CompressedImage (jpeg, png) or to raw images"
        raise LogError(f"{source.path}: {what}: {cure}")
    if not survey.topics:
        more = "".join(f"; {note}" for note in notes)
        raise LogError(f"{source.path} holds no message that can be read ({source.size_bytes} bytes){more}")
    return images


class StereoLog:
    """A recording with known cameras and calibration. Each reading starts from the beginning and resets `stats`.

    `rig`: its cameras, two or one. `expected_frames`: images on the left topic, `duration_s`: span of the recorder's
    clock; both None without an index.
    """

    def __init__(self, source: Source, survey: Survey, choice: PairChoice, found: FoundRig, note: str = "") -> None:
        self._source = source
        self.survey = survey
        self.path = source.path
        self.rig: StereoRig | MonoRig = found.rig
        self.left_topic, self.right_topic, self.choice_reason = choice.left, choice.right, choice.reason
        self._sent = found.sent
        self._reader = PairReader(source, choice.left, choice.right)
        self.expected_frames = survey.topics[choice.left].count if survey.whole else None
        self.duration_s = (survey.end_ns - survey.start_ns) / 1e9 if survey.whole else None
        self.imu_topics = find_topics(survey) if isinstance(found.rig, StereoRig) else None
        self._note = note  # where the calibration was found
        self.imu_problem = ""  # why the inertial unit of the log is not used
        self._mount_imu()
        self._given_truth: Trajectory | None = None
        self._given_truth_name = ""
        self._read_span_ns: tuple[int, int] | None = None  # span of the latest reading

    def __repr__(self) -> str:
        frames = "" if self.expected_frames is None else f", {counted(self.expected_frames, 'frame')}"
        span = "" if self.duration_s is None else f" in {self.duration_s:.2f} s"
        return f"<StereoLog {self.path.name}{frames}{span}, {self.rig!r}>"

    def _mount_imu(self) -> None:
        """Add the inertial unit of the log to the rig; without a known mounting, its samples are not used."""
        if self.imu_topics is None or not isinstance(self.rig, StereoRig):
            return
        try:
            self.rig = mounted(self._source, self.survey, self.imu_topics, self.rig, self._left_frame)
        except LogError as error:
            self.imu_problem = f"{self.path}: the IMU is not used: {error}"
            self.imu_topics = None

    @property
    def stereo_rig(self) -> StereoRig:
        """The rig of both cameras. Raises ConfigError if the log was opened for one."""
        if not isinstance(self.rig, StereoRig):
            raise ConfigError(f"{self.path} was opened for one camera (mono): what is asked for needs two")
        return self.rig

    @property
    def stats(self) -> ReadStats:
        """Statistics of the latest reading; final when its iterator has ended."""
        return self._reader.stats

    def pairs(self) -> Generator[StereoPair, None, None]:
        """Yield all pairs, not decoded; see `PairReader.pairs`."""
        self._reader = PairReader(self._source, self.left_topic, self.right_topic, self._sent)
        return self._reader.pairs()

    def frames(
        self, selection: Selection | None = None, *, all_calibrations: bool = False
    ) -> Generator[RecordedFrame, None, None]:
        """Yield the selected frames, in ascending order of stamps. Raises as `pairs`, and LogError if there is none.

        They end if the clock is set back: the rest is another recording, which a later start selects. They also end
        if a camera sends another calibration; with `all_calibrations` they continue with it if the image size stays,
        and `recorded.rig` of a frame is the rig at that time.
        """
        selection = selection or Selection()
        decoder = FrameDecoder(self.path, self.rig, ahead=self._source.waiting() is None)
        delivered = 0
        pairs = self._selected(selection, all_calibrations)
        try:
            with closing(decoder.frames(pairs)) as decoded_frames:
                frames: Iterator[RecordedFrame] = decoded_frames
                if self.imu_topics is not None:
                    frames = map(SamplesOfFrames(self._source, self.imu_topics).added_to, frames)
                for delivered, frame in enumerate(frames, start=1):
                    yield frame
                    if delivered == selection.max_frames:
                        break
        finally:
            pairs.close()  # first, as it completes `stats`
            stats = self.stats
            stats.warnings += [*baseline_warnings(self.rig), *filter(None, [self._note, self.imu_problem])]
            stats.undecodable += decoder.skipped
            if decoder.skipped:
                stats.complete = False
                skipped = f"{counted(stats.undecodable, 'frame')} skipped that could not be decoded"
                stats.warnings.append(f"{skipped}, the first: {decoder.problem}")
        if not delivered:
            raise LogError(f"{self.path}: no image could be decoded: {decoder.problem}")

    def _selected(self, selection: Selection, all_calibrations: bool) -> Generator[StereoPair, None, None]:
        start_s, end_s = selection.start_s, selection.end_s
        start_ns = 0 if start_s is None else round(start_s * 1e9)
        end_ns = None if end_s is None else round(end_s * 1e9)
        zero_ns = last_ns = None  # the stamp at 0 s, and that of the last pair
        since_ns = 0
        count = 0
        rig, sent = self.rig, self._sent
        ended = ""
        with closing(self.pairs()) as pairs:
            for pair in pairs:
                if zero_ns is None or last_ns is None:
                    zero_ns = pair.stamp_ns
                elif pair.stamp_ns <= last_ns:
                    if count:
                        ended = "the clock was set back there; start there to read the rest"
                        break
                    zero_ns = pair.stamp_ns - since_ns
                if any(now.calibration is not before for now, before in zip(pair.images, sent, strict=False)):
                    images = pair.images[: len(sent)]
                    sent = [image.calibration for image in images if image.calibration is not None]
                    try:
                        rig = self._changed_rig(sent, all_calibrations)
                    except InputError as error:
                        ended = str(error).removeprefix(f"{self.path}: ")
                        break
                last_ns = pair.stamp_ns
                self._read_span_ns = zero_ns, last_ns
                since_ns = last_ns - zero_ns
                if end_ns is not None and since_ns > end_ns:
                    break
                if since_ns >= start_ns:
                    if count % selection.stride == 0:
                        yield changed(pair, rig=rig)
                    count += 1
        if ended:
            self.stats.complete = False
            self.stats.warnings.append(f"{self.path}: reading stopped at {since_ns / 1e9:.2f} s: {ended}")
        if not count:
            until = "" if end_s is None else f" and before {end_s:g} s"
            read = "; ".join([f"the frames read span {since_ns / 1e9:.2f} s", *self.stats.warnings[:2]])
            raise LogError(f"{self.path}: no frame lies after {start_s or 0:g} s{until}; {read}")

    def _changed_rig(self, sent: Sequence[CalibrationMessage], usable: bool) -> StereoRig | MonoRig:
        """Return the rig after a change of calibration. Raises InputError if frames with it must not be read."""
        if not usable:
            raise LogError("their calibration is another one: start there, and give it")
        for message, camera in zip(sent, self.rig.cameras.values(), strict=True):
            if (message.width, message.height) != (camera.width, camera.height):
                raise LogError(f"another camera took them, of {message.width}×{message.height} pixels")
        rig = rig_of_messages(self._source, self.survey, sent, is_rectified(self.left_topic)).rig
        check_rig(self._source, rig)
        return with_imu(rig, self.rig.imu if isinstance(self.rig, StereoRig) else None)

    def ground_truth(self, until_ns: int | None = None) -> Trajectory | None:
        """Return `world_from_cam` of the physical left camera, given or from the log; None if none can be used.

        Of the log the poses up to `until_ns` are read, and some later ones.
        """
        if self._given_truth is not None:
            if self._read_span_ns is not None:
                warning = time_warning(self._given_truth, self._given_truth_name, *self._read_span_ns)
                self.stats.warnings += [warning] if warning is not None else []
            return self._given_truth
        topic = truth_topic(self.survey)
        if topic is None:
            return None
        return read_truth(self._source, topic, self._left_frame, self.stats.warnings, until_ns)

    @property
    def std_truth(self) -> tuple[float, float]:
        """σ of the ground truth, m and rad, that the log carries; zeros where it carries none, or truth is given."""
        return std_of_truth(self.survey) if self._given_truth is None else (0.0, 0.0)

    def is_next_here(self) -> bool:
        """Whether the next frame can be read without waiting for a live camera."""
        return self._source.waiting() != 0

    def age_s(self, stamp_ns: int) -> float | None:
        """Return the seconds since a live camera delivered the pair of a stamp; None for recordings and old pairs."""
        return self._source.age_s(stamp_ns)

    @property
    def left_out(self) -> int:
        """The number of pairs of a live camera that were dropped because others waited."""
        return self._source.left_out

    def close(self) -> None:
        """Release a camera and finish its recording; a file needs no closing."""
        self._source.close()

    def use_ground_truth(self, truth: str | Path | GroundTruthFile | Trajectory) -> None:
        """Use this ground truth from now on. Raises ConfigError, or LogError if the file cannot be read."""
        if isinstance(truth, Trajectory):
            self._given_truth, self._given_truth_name = truth, "given by the caller"
            return
        file = truth if isinstance(truth, GroundTruthFile) else GroundTruthFile(truth)
        self._given_truth = load_truth(file, self._source, self.survey, self._left_frame)
        self._given_truth_name = str(file.path)

    @cached_property
    def _left_frame(self) -> str:
        """The coordinate frame named by the left images."""
        images = decoded(self._source, [self.left_topic], MessageDecoder.image)
        return next((image.frame_id for image in images), "")

    def depths(self) -> Iterator[tuple[int, Depth]]:
        """Yield the ground-truth depths, if any: (stamp_ns, depth (h, w) float32 in metres, NaN where unknown)."""
        if (topic := depth_topic(self.survey)) is not None:
            yield from read_depths(self._source, topic, self.stats.warnings)

    def depth_images(self) -> DepthImages:
        """Return the images of `depths`, looked up by the stamps of frames."""
        return DepthImages(self.depths())
