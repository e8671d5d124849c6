"""The one loop: frames of a log, an observer, the estimator of a lane, then sinks and checks.

Ctrl-C, SIGTERM and SIGHUP end a run after the current frame; a broken log, a full disk or a defect end it
at once. In each case the estimates so far are written, and the `RunOutcome` says how the run went.
"""

import time
from collections import deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from itertools import count, groupby
from typing import Protocol

from ..blas import one_thread
from ..camera.models import MANY_PIXELS
from ..camera.rig import MonoRig, StereoRig
from ..errors import FrameError, InputError, LogError
from ..interrupts import Interruption
from ..observer import Observed, Observer
from ..pictures.prepared import PreparedImages
from ..record import changed
from ..recording.frames import RecordedFrame
from ..recording.stereo_log import StereoLog
from ..results.folder import close_all
from ..types import FrameEstimate, Selection, Sink
from ..wording import counted
from .lane import Lane

PreparedFrames = Generator[tuple[RecordedFrame, PreparedImages | None, float], None, None]


class Check(Protocol):
    """Takes the observations and the estimates of all frames."""

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Take the next frame; `estimates`: by method, without failed ones."""
        ...


@dataclass(slots=True)
class RunOutcome:
    """How a run went: the number of frames used, the warnings, and the error to raise when everything is written."""

    frames: int = 0
    complete: bool = True
    interrupted: bool = False
    warnings: list[str] = field(default_factory=list)
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
        with closing(recorded), closing(_by_rig(lane, log.rig, recorded)) as frames:
            for frame, prepared, waited_ms in interruption.until_requested(frames):
                try:
                    estimate = _step(frame, prepared, waited_ms, lane, checks)
                except FrameError as error:
                    lane.record.refuse(error)
                    continue
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


def _by_rig(lane: Lane, rig: StereoRig | MonoRig, frames: Iterator[RecordedFrame]) -> PreparedFrames:
    """Yield the frames as `prepared_ahead` does; when their rig changes, the lane starts over with it."""
    for now, group in groupby(frames, key=lambda frame: frame.recorded.rig):
        if now is not None and now is not rig:
            rig = now
            with one_thread:
                lane.begin_anew(Observer(rig, lane.config))
        with closing(prepared_ahead(lane.observer, group)) as prepared:
            yield from prepared


def _step(
    frame: RecordedFrame, prepared: PreparedImages | None, waited_ms: float, lane: Lane, checks: Sequence[Check]
) -> FrameEstimate | None:
    """Pass one frame through the observer, and its observations through the lane and all checks.

    Returns None if the lane has failed. Raises FrameError if the front-end refuses the frame.
    """
    with one_thread:
        observed = lane.observer.observe(frame, prepared, lane.expect)
        observed = changed(observed, timings_ms={"decode": waited_ms} | observed.timings_ms)
        estimate = lane.take(observed)
        if lane.solution is not None:
            lane.observer.learn(lane.solution)
        for check in checks:
            check.add(observed, {} if estimate is None else {lane.record.name: estimate})
        return estimate


def prepared_ahead(observer: Observer, frames: Iterator[RecordedFrame]) -> PreparedFrames:
    """Yield each frame with what `Observer.prepare` returned for it, or None if that failed: `observe` says why.

    OpenCV works on the next images while NumPy works on the current ones. Very large images are not prepared ahead.
    If the log ends in an InputError, all earlier frames are yielded first. The third value is the time that the run
    waited for the frame, milliseconds.
    """
    large = any(camera.width * camera.height > MANY_PIXELS for camera in observer.rig.cameras.values())
    coming: deque[tuple[RecordedFrame, Future[PreparedImages] | None]] = deque()
    more, broken = True, None
    asked_s = time.perf_counter()
    with ThreadPoolExecutor(1, thread_name_prefix="prepare") as pool:
        for index in count():
            try:
                frame = next(frames, None) if more else None
            except InputError as error:
                frame, broken = None, error
            more = frame is not None
            if frame is not None:
                coming.append((frame, None if large else pool.submit(_prepare, observer, frame, index)))
            if more and len(coming) == 1 and not large:
                continue
            if not coming:
                break
            frame, future = coming.popleft()
            prepared = None if future is None or future.exception() else future.result()
            yield frame, prepared, 1e3 * (time.perf_counter() - asked_s)
            asked_s = time.perf_counter()
    if broken is not None:
        raise broken


def _prepare(observer: Observer, frame: RecordedFrame, index: int) -> PreparedImages:
    with one_thread:
        return observer.prepare(frame, index)
