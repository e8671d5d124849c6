"""Three frames in work at a time: one is estimated, the front-end follows the next, and the one after is prepared.

What the front-end knows of the rig when it follows a frame is from the frame before the last one, as in `Engine.step`.
So estimates do not depend on timing. The caller's thread has the estimator, files and sinks.
"""

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

from ..camera.models import MANY_PIXELS
from ..errors import FrameError, InputError
from ..logs.recording.frames import RecordedFrame
from ..pictures.prepared import PreparedImages
from ..pipeline.lane import BareLane
from ..pipeline.observer import Observed, Observer
from ..record import changed
from ..system.blas import one_thread

ObservedFrames = Generator[tuple[RecordedFrame, Observed | FrameError], None, None]


def observed_ahead(
    lane: BareLane, frames: Iterator[RecordedFrame], is_next_here: Callable[[], bool] = lambda: True
) -> ObservedFrames:
    """Yield each frame with its observations, or with the error for which the front-end refuses it.

    The estimator of `lane` is expected to have each frame before the next one is asked for. Where it predicts the
    motion of the next frame, from inertial samples, the front-end waits for it. `is_next_here`: whether the next frame
    can be read at once; if not, it is not read before it is asked for, so that no live frame waits for another one.
    Very large images are not prepared ahead. If the log ends in an InputError, all earlier frames are yielded first.
    """
    observer = lane.observer
    large = any(camera.width * camera.height > MANY_PIXELS for camera in observer.rig.cameras.values())
    coming: deque[_Coming] = deque()
    current: tuple[RecordedFrame, Callable[[], Observed]] | None = None
    index, more, broken = 0, True, None
    with ThreadPoolExecutor(1, "prepare") as preparing, ThreadPoolExecutor(1, "front-end") as following:
        while True:
            while more and (not (coming or current) or (not large and len(coming) < 2 and is_next_here())):
                asked_s = time.perf_counter()
                try:
                    frame = next(frames, None)
                except InputError as error:
                    frame, broken = None, error
                more = frame is not None
                if frame is not None:
                    prepared = None if large else preparing.submit(_prepared, observer, frame, index)
                    coming.append((frame, prepared, 1e3 * (time.perf_counter() - asked_s)))
                    index += 1
            done = None if current is None else (current[0], _finished(lane, current[1]))
            current = None
            if coming:
                frame, prepared, read_ms = coming.popleft()
                observe = partial(_observed, lane, frame, prepared, read_ms)
                current = frame, observe if lane.predicts(frame) else following.submit(observe).result
            if done is not None:
                yield done
            elif current is None:
                break
    if broken is not None:
        raise broken


_Coming = tuple[RecordedFrame, Future[PreparedImages | None] | None, float]


def _prepared(observer: Observer, frame: RecordedFrame, index: int) -> PreparedImages | None:
    """Return the prepared images of a frame; None if that fails: `observe` says why."""
    try:
        with one_thread:
            return observer.prepare(frame, index)
    except FrameError:
        return None


def _observed(
    lane: BareLane, frame: RecordedFrame, coming: Future[PreparedImages | None] | None, read_ms: float
) -> Observed:
    """Return the observations of a frame. Raises FrameError if the front-end refuses it."""
    began_s = time.perf_counter()
    prepared = None if coming is None else coming.result()
    waited_ms = read_ms + 1e3 * (time.perf_counter() - began_s)
    with one_thread:
        observed = lane.observer.observe(frame, prepared, lane.expect)
    return changed(observed, timings_ms={"decode": waited_ms} | observed.timings_ms)


def _finished(lane: BareLane, observe: Callable[[], Observed]) -> Observed | FrameError:
    """Return the observations of a frame, or why it is refused; the front-end then learns from the frame before."""
    try:
        observed = observe()
    except FrameError as error:
        return error
    with one_thread:
        lane.observer.learn(lane.solution)
    return observed
