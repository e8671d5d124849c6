"""The one loop: frames of a log, one observer, the estimators of all lanes, then sinks and checks.

Ctrl-C, SIGTERM and SIGHUP end a run after the current frame; a log that breaks off, a full disk or a defect end it
where they occur. In each case the estimates so far are written, and the `Course` says how it went.
"""

import os
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Protocol

from ..blas import one_thread
from ..camera.models import MANY_PIXELS
from ..camera.rig import MonoRig, StereoRig
from ..errors import FrameError, InputError, LogError
from ..frontend.prepared import PreparedImages
from ..interrupts import Interruption
from ..observer import Observed, Observer
from ..recording.frames import RecordedFrame
from ..recording.stereo_log import StereoLog
from ..results.folder import close_all
from ..types import Frame, FrameEstimate, Selection, Sink
from ..wording import counted
from .lane import Lane, without_rig_errors

# The first lane runs this many frames ahead, until its rig estimate settles. Lanes that use this estimate would
# otherwise jump from frame to frame, by up to 45 mm on the demo.
_AHEAD_FRAMES = 30

Frames = Generator[RecordedFrame, None, None]
PreparedFrames = Generator[tuple[RecordedFrame, PreparedImages | None], None, None]


class Check(Protocol):
    """Checks what all lanes share, frame by frame."""

    def add(self, observed: Observed, frame: Frame, estimates: Mapping[str, FrameEstimate]) -> None:
        """Take the next frame; `estimates`: by method, of the lanes that have not failed."""
        ...


@dataclass(slots=True)
class Course:
    """How a run went: the number of frames used, the warnings, and the error to raise once everything is written."""

    frames: int = 0
    complete: bool = True
    interrupted: bool = False
    warnings: list[str] = field(default_factory=list)
    error: BaseException | None = None

    def end(self, error: BaseException) -> None:
        """End the run early; a log that breaks off is no error if part of it was read."""
        self.complete = False
        if not isinstance(error, InputError):
            self.warnings.append(f"the run was ended by {type(error).__name__}: {error}")
        elif self.frames:
            self.warnings.append(str(error))
            return
        self.error = self.error or error


def run(
    log: StereoLog,
    lanes: Sequence[Lane],
    sinks: Sequence[Sink] = (),
    checks: Sequence[Check] = (),
    *,
    selection: Selection,
    interruption: Interruption,
    all_calibrations: bool = False,
) -> Course:
    """Feed the selected frames to all lanes, which share one observer, and say how it went; errors are in the result.

    `sinks` are given one estimate per frame, of the first lane that has not failed, and are closed at the end.
    `all_calibrations`: where the log has another one the lanes start anew with it; otherwise the run ends there.
    """
    course, held = Course(), _Held(lanes[0].finds_rig and len(lanes) > 1)
    try:
        recorded = log.frames(selection, all_calibrations=all_calibrations)
        pool = ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="lane")  # of lanes beside the first one
        with pool, closing(recorded), closing(_by_rig(lanes, log.rig, recorded)) as frames:
            try:
                for frame, prepared, waited_ms in interruption.until_requested(_timed(frames)):
                    estimates = _step(frame, prepared, waited_ms, lanes, checks, pool, held)
                    if estimates is None:
                        continue
                    course.frames += 1
                    for sink in sinks if estimates else ():
                        sink.write(next(iter(estimates.values())), frame)
                    if all(lane.error is not None for lane in lanes):
                        break
            finally:  # however it ends, what was observed is estimated
                _catch_up(lanes, pool, held)
    except BaseException as error:
        course.end(error)
    refusal = lanes[0].record.first_refusal
    if not course.frames and refusal is not None and course.error is None:
        course.error = LogError(f"{log.path}: no frame could be used: {refusal}")
    if interruption.requested:
        course.complete, course.interrupted = False, True
        course.warnings.append(f"interrupted after {counted(course.frames, 'frame')}")
    try:
        close_all([*(lane.folder for lane in lanes if lane.folder is not None), *sinks])
    except Exception as error:
        course.error = course.error or error
    return course


def _by_rig(lanes: Sequence[Lane], rig: StereoRig | MonoRig, frames: Frames) -> PreparedFrames:
    """Yield the frames as `prepared_ahead` does; where their rig changes, the lanes have begun anew with it."""
    for now, group in groupby(frames, key=lambda frame: frame.recorded.rig):
        if now is not None and now is not rig:
            rig = now
            with one_thread:
                observer = Observer(rig, lanes[0].config)
                for lane in lanes:
                    lane.begin_anew(observer)
        with closing(prepared_ahead(lanes[0].observer, (frame for frame in group))) as prepared:
            yield from prepared


def _step(
    frame: RecordedFrame,
    prepared: PreparedImages | None,
    waited_ms: float,
    lanes: Sequence[Lane],
    checks: Sequence[Check],
    pool: ThreadPoolExecutor,
    held: "_Held",
) -> dict[str, FrameEstimate] | None:
    """Pass one frame through the observer, and its observations through all lanes and checks.

    Returns the estimates by method; None where the front-end refuses the frame, which each record counts.
    """
    with one_thread:
        try:
            observed = lanes[0].observer.observe(frame, prepared, lanes[0].expect)
        except FrameError as error:
            for lane in lanes:
                lane.record.refuse(error)
            return None
        observed = replace(observed, timings_ms={"decode": waited_ms} | observed.timings_ms)
        found = _estimates(observed, lanes, pool, held)
        estimates = {lane.record.name: e for lane, e in zip(lanes, found, strict=True) if e is not None}
        taught = next((lane.solution for lane in lanes if lane.solution and lane.solution.rig), None)
        if taught is not None:  # by one lane only, so that it estimates as it would alone
            lanes[0].observer.learn(taught)
        for check in checks:
            check.add(observed, frame, estimates)
        return estimates


@dataclass(slots=True)
class _Held:
    """The `frames` that lanes have not taken yet which the first one is ahead of, as long as it `is_ahead`."""

    is_ahead: bool
    frames: list[Observed] = field(default_factory=list)


def _estimates(
    observed: Observed, lanes: Sequence[Lane], pool: ThreadPoolExecutor, held: _Held
) -> list[FrameEstimate | None]:
    """Return what each lane estimates: the first one by itself, as it may find what is wrong with the rig, then all
    others beside each other. They have no estimate while the first one is ahead."""
    found = lanes[0].take(without_rig_errors(lanes[0], lanes, observed))
    held.frames.append(observed)
    held.is_ahead = held.is_ahead and len(held.frames) < _AHEAD_FRAMES and lanes[0].error is None
    if held.is_ahead:
        return [found, *(None for _ in lanes[1:])]
    return [found, *_catch_up(lanes, pool, held)]


def _catch_up(lanes: Sequence[Lane], pool: ThreadPoolExecutor, held: _Held) -> list[FrameEstimate | None]:
    """Have all lanes but the first take the frames held, and return their last estimates."""
    frames, held.frames = held.frames, []

    def take(lane: Lane, seen: Sequence[Observed]) -> FrameEstimate | None:
        estimate = None
        for observed in seen:
            estimate = lane.take(observed)
        return estimate

    with one_thread:
        seen = [[without_rig_errors(lane, lanes, observed) for observed in frames] for lane in lanes[1:]]
        coming = [pool.submit(take, *of_lane) for of_lane in zip(lanes[1:], seen, strict=True)]
        wait(coming)  # all of them, whatever one of them raises
    return [future.result() for future in coming]


def prepared_ahead(observer: Observer, frames: Frames) -> PreparedFrames:
    """Yield each frame with what `Observer.prepare` returned for it, or None if that failed: `observe` says why.

    OpenCV works on the next images while NumPy works on the current ones. Very large images are not prepared ahead. If
    the log ends in an InputError, all frames that were read before it are yielded first.
    """
    if any(camera.width * camera.height > MANY_PIXELS for camera in observer.rig.cameras.values()):
        with closing(frames):
            yield from ((frame, None) for frame in frames)
        return
    coming: list[tuple[RecordedFrame, Future[PreparedImages]]] = []
    with ThreadPoolExecutor(1, thread_name_prefix="prepare") as pool, closing(frames):
        try:
            for index, frame in enumerate(frames):
                coming.append((frame, pool.submit(_prepare, observer, frame, index)))
                if len(coming) > 1:
                    yield _finished(*coming.pop(0))
        except InputError:
            yield from (_finished(*ahead) for ahead in coming)
            raise
        yield from (_finished(*ahead) for ahead in coming)


def _prepare(observer: Observer, frame: RecordedFrame, index: int) -> PreparedImages:
    with one_thread:
        return observer.prepare(frame, index)


def _finished(frame: RecordedFrame, future: Future[PreparedImages]) -> tuple[RecordedFrame, PreparedImages | None]:
    return frame, None if future.exception() else future.result()


def _timed(frames: PreparedFrames) -> Iterator[tuple[RecordedFrame, PreparedImages | None, float]]:
    """Yield each frame with the milliseconds that the run waited for it."""
    asked_s = time.perf_counter()
    for frame, prepared in frames:
        yield frame, prepared, 1e3 * (time.perf_counter() - asked_s)
        asked_s = time.perf_counter()
