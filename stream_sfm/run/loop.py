"""The one loop: frames of a log, an observer, the estimator of a lane, then sinks and checks.

Ctrl-C, SIGTERM and SIGHUP end a run after the current frame; a broken log, a full disk or a defect end it
at once. In each case the estimates so far are written, and the `RunOutcome` says how the run went.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from itertools import groupby
from typing import Protocol

import msgspec

from ..errors import FrameError, InputError, LogError
from ..logs.recording.frames import RecordedFrame
from ..logs.recording.stereo_log import StereoLog
from ..pipeline.observer import Observed, Observer
from ..results.folder import close_all
from ..system.blas import one_thread
from ..system.interrupts import Interruption
from ..system.wording import counted
from ..types import FrameEstimate, Selection, Sink
from .ahead import ObservedFrames, observed_ahead
from .lane import Lane


class Check(Protocol):
    """Takes the observations and the estimates of all frames."""

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Take the next frame; `estimates`: by method, without failed ones."""
        ...


class RunOutcome(msgspec.Struct):
    """How a run went: the number of frames used, the warnings, and the error to raise when everything is written."""

    frames: int = 0
    complete: bool = True
    interrupted: bool = False
    warnings: list[str] = msgspec.field(default_factory=list)
    error: BaseException | None = None

    def interrupt(self) -> None:
        """Note that the run was interrupted."""
        self.complete, self.interrupted = False, True
        self.warnings.append(f"interrupted after {counted(self.frames, 'frame')}")

    def end(self, error: BaseException) -> None:
        """End the run early; a log that breaks off is not an error if part of it was read."""
        self.complete = False
        if not isinstance(error, InputError):
            self.warnings.append(f"the run was ended by {type(error).__name__}: {error}")
        elif self.frames:
            self.warnings.append(str(error))
            return
        self.error = self.error or error

    @contextmanager
    def deferred_error(self) -> Iterator[None]:
        """Keep an error in the final steps, unless there is one already, so that the other steps are still done."""
        try:
            yield
        except Exception as error:
            self.error = self.error or error


def run(
    log: StereoLog,
    lane: Lane,
    sinks: Sequence[Sink] = (),
    checks: Sequence[Check] = (),
    *,
    selection: Selection,
    interruption: Interruption,
    all_calibrations: bool = False,
    to_end: bool = False,
) -> RunOutcome:
    """Feed the selected frames to a lane through its observer, and say how it went; errors are in the result.

    `sinks` get the estimate of each frame, and are closed at the end. `all_calibrations`: if the calibration of the
    log changes, the lane starts over with the new one; otherwise the run ends there. `to_end`: the checks get all
    frames, even if the lane fails.
    """
    outcome = RunOutcome()
    try:
        recorded = log.frames(selection, all_calibrations=all_calibrations)
        with closing(recorded), closing(_by_rig(lane, log, recorded)) as frames:
            for frame, observed in interruption.until_requested(frames):
                if isinstance(observed, FrameError):
                    lane.record.refuse(observed)
                    continue
                estimate = _take(observed, lane, checks)
                outcome.frames += 1
                if estimate is None:
                    if to_end:
                        continue
                    break
                for sink in sinks:
                    sink.write(estimate, frame)
    except BaseException as error:
        outcome.end(error)
    refusal = lane.record.first_refusal
    if not outcome.frames and refusal is not None and outcome.error is None:
        outcome.error = LogError(f"{log.path}: no frame could be used: {refusal}")
    if interruption.requested:
        outcome.interrupt()
    with outcome.deferred_error():
        close_all([*([] if lane.folder is None else [lane.folder]), *sinks])
    return outcome


def _by_rig(lane: Lane, log: StereoLog, frames: Iterator[RecordedFrame]) -> ObservedFrames:
    """Yield the frames as `observed_ahead` does; when their rig changes, the lane starts over with it."""
    rig = log.rig
    for now, group in groupby(frames, key=lambda frame: frame.recorded.rig):
        if now is not None and now is not rig:
            rig = now
            with one_thread:
                lane.restart(Observer(rig, lane.config))
        with closing(observed_ahead(lane, group, log.is_next_here)) as observed:
            yield from observed


def _take(observed: Observed, lane: Lane, checks: Sequence[Check]) -> FrameEstimate | None:
    """Pass the observations of a frame through the lane and all checks; None if the lane has failed."""
    with one_thread:
        estimate = lane.take(observed)
        for check in checks:
            check.add(observed, {} if estimate is None else {lane.record.name: estimate})
        return estimate
