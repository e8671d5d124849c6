"""Notices cameras and calibrations that do not belong together while a replay starts, not after hours."""

import logging

import numpy as np

from ..inspection.calibration_check import Images
from ..inspection.findings import quick_problems
from ..recording.stereo_log import StereoLog
from ..recording.topics import PairChoice
from ..types import Frame, FrameEstimate

_CONFIRMED_BY = 4  # frames: a problem in the first one must be there in all of these together


class CalibrationSink:
    """A sink that checks the calibration of a log against its first frames; `problems` is what it found.

    A problem is logged as a warning as soon as it is certain; the run goes on.
    """

    def __init__(self, log: StereoLog) -> None:
        self._log = log
        self._choice = PairChoice(log.left_topic, log.right_topic, log.choice_reason)
        self._frames: list[Images] = []
        self._done = False
        self.problems: list[str] = []

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Check the first frame, and a few more if something is wrong with it."""
        if self._done:
            return
        images = [np.asarray(image, np.uint8) for image in frame.images]  # as a log's frames are
        self._frames.append((images[0], images[-1]))
        if len(self._frames) == 1:
            self._done = not self._check()
        elif len(self._frames) == _CONFIRMED_BY:
            self._conclude()

    def close(self) -> None:
        """Decide with the frames there are."""
        if not self._done and self._frames:
            self._conclude()

    def _check(self) -> list[str]:
        problems = quick_problems(self._log.stereo_rig, self._choice, self._frames)
        return [f"{self._log.path}: {problem}" for problem in problems]

    def _conclude(self) -> None:
        self.problems = self._check()
        self._frames.clear()
        self._done = True
        for problem in self.problems:
            logging.getLogger("stream_sfm").warning(problem)
