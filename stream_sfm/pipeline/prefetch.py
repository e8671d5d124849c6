"""Prepares frames one ahead of the engine: OpenCV works on the next images while NumPy works on the current ones."""

from collections.abc import Generator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing

from ..camera.models import MANY_PIXELS
from ..engine import Engine
from ..errors import InputError
from ..frontend.prepared import PreparedImages
from ..observer import Observer
from ..recording import RecordedFrame

Frames = Generator[RecordedFrame, None, None]
PreparedFrames = Generator[tuple[RecordedFrame, PreparedImages | None], None, None]


def prepared_ahead(engine: Engine | Observer, frames: Frames) -> PreparedFrames:
    """Yield each frame with what `Engine.prepare` returned for it, or None if that failed: `Engine.step` says why.

    Very large images are not prepared ahead: `Engine.step` does it. If the log ends in an InputError, all frames that
    were read before it are yielded first.
    """
    if any(camera.width * camera.height > MANY_PIXELS for camera in engine.rig.cameras.values()):
        with closing(frames):
            yield from ((frame, None) for frame in frames)
        return
    current: tuple[RecordedFrame, Future[PreparedImages]] | None = None
    with ThreadPoolExecutor(1, thread_name_prefix="prepare") as pool, closing(frames):
        try:
            for index, frame in enumerate(frames):
                coming = frame, pool.submit(engine.prepare, frame, index)
                if current is not None:
                    yield _finished(*current)
                current = coming
        except InputError:
            if current is not None:
                yield _finished(*current)
            raise
        if current is not None:
            yield _finished(*current)


def _finished(frame: RecordedFrame, future: Future[PreparedImages]) -> tuple[RecordedFrame, PreparedImages | None]:
    return frame, None if future.exception() else future.result()
