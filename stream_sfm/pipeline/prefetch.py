"""Frames prepared one ahead of the engine: OpenCV works on the next images while NumPy is at the present ones."""

from collections.abc import Generator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing

from ..engine import Engine
from ..errors import InputError
from ..frontend.prepared import PreparedImages
from ..recording import StereoPair
from ..types import StereoFrame

Frames = Generator[tuple[StereoPair, StereoFrame], None, None]
Ahead = Generator[tuple[StereoPair, StereoFrame, PreparedImages | None], None, None]


def prepared(engine: Engine, frames: Frames) -> Ahead:
    """Each frame with what `Engine.prepare` makes of it; None where that fails, so that `Engine.step` meets the cause.

    The last frame before the log ends in an InputError comes before that error.
    """

    def delivered(
        pair: StereoPair, frame: StereoFrame, future: Future[PreparedImages]
    ) -> tuple[StereoPair, StereoFrame, PreparedImages | None]:
        return pair, frame, None if future.exception() else future.result()

    ahead: tuple[StereoPair, StereoFrame, Future[PreparedImages]] | None = None
    with ThreadPoolExecutor(1, thread_name_prefix="prepare") as pool, closing(frames):
        try:
            for index, (pair, frame) in enumerate(frames):
                submitted = pair, frame, pool.submit(engine.prepare, frame, index)
                if ahead is not None:
                    yield delivered(*ahead)
                ahead = submitted
        except InputError:
            if ahead is not None:
                yield delivered(*ahead)
            raise
        if ahead is not None:
            yield delivered(*ahead)
