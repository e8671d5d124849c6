"""Notices cameras and calibrations that do not belong together while a replay starts, not after hours."""

import logging
from collections.abc import Sequence

import numpy as np

from ..inspection.calibration_check import Images, quick_problems
from ..recording.stereo_log import StereoLog
from ..recording.topics import PairChoice
from ..types import Frame, FrameEstimate

_CONFIRMED_BY = 4  # frames: a problem in the first one must be there in all of these together


def images_of(frame: Frame) -> Images:
    """The first and the last image of a frame of a log, which have 8 bits."""
    images = [np.asarray(image, np.uint8) for image in frame.images]
    return images[0], images[-1]


def log_problems(log: StereoLog, frames: Sequence[Images]) -> list[str]:
    """Return what, as far as these images show, prevents a replay of a log with its calibration."""
    choice = PairChoice(log.left_topic, log.right_topic, log.choice_reason)
    return [f"{log.path}: {problem}" for problem in quick_problems(log.stereo_rig, choice, frames)]


class CalibrationSink:
    """A sink that checks the calibration of a log against its first frames; `problems` is what it found.

    A problem is logged as a warning as soon as it is certain; the run goes on.
    """

    def __init__(self, log: StereoLog) -> None:
        self._log = log
        self._frames: list[Images] | None = []  # None once it is decided
        self.problems: list[str] = []

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Check the first frame, and a few more if something is wrong with it."""
        if self._frames is None:
            return
        self._frames.append(images_of(frame))
        if len(self._frames) == 1 and not log_problems(self._log, self._frames):
            self._frames = None
        elif len(self._frames) == _CONFIRMED_BY:
            self.close()

    def close(self) -> None:
        """Decide by the frames seen so far."""
        frames, self._frames = self._frames, None
        if frames:
            self.problems = log_problems(self._log, frames)
        for problem in self.problems if frames else ():
            logging.getLogger("stream_sfm").warning(problem)
