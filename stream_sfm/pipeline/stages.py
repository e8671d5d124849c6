"""An engine on two threads: the front-end follows a frame while the estimator is at the one before."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

from ..pictures.prepared import PreparedImages
from ..system.blas import one_thread
from ..types import Frame, FrameEstimate
from .engine import Engine
from .observer import Observed


class Pipeline:
    """The estimates of `Engine.step`, to the byte and in order, each one frame later, and more of them a second.

        with sfm.Pipeline(engine) as pipeline:
            for frame in frames:
                if (estimate := pipeline.push(frame)) is not None:
                    ...                                     # that of the frame before
            estimate = pipeline.finish()                    # that of the last frame

    The engine takes no other call until the pipeline is closed, as `with` does; a frame without an estimate is then
    lost. Frames come from one thread, in which the estimator works, too. Frames with inertial samples take turns, as
    the front-end starts from the motion that the estimator predicts from them.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine, self._open = engine, ExitStack()
        self._open.enter_context(engine._exclusively())
        self._pool = self._open.enter_context(ThreadPoolExecutor(1, "front-end"))
        self._observed: Observed | None = None
        self._estimates: list[FrameEstimate] = []  # not returned yet: of a frame before a refused one

    def push(self, frame: Frame, prepared: PreparedImages | None = None) -> FrameEstimate | None:
        """Take the next frame, and return the estimate of the one before; None for the first.

        `prepared`: as in `Engine.step`. Raises FrameError as that does; the engine is then unchanged, and the next call
        returns the estimate of the frame before.
        """
        engine = self._engine
        with one_thread:
            frame = engine._samples.joined_to(frame)
            if engine.lane.predicts(frame):
                self._estimate()
            coming = self._pool.submit(engine.observer.observe, frame, prepared, engine.lane.expect)
            self._estimate()
            self._observed = coming.result()
            engine.observer.learn(engine.lane.solution)
        return self._next()

    def finish(self) -> FrameEstimate | None:
        """Return the estimate of the last frame; None if it has been returned, or there is none."""
        with one_thread:
            self._estimate()
        return self._next()

    def close(self) -> None:
        """Give the engine back."""
        self._open.close()

    def _estimate(self) -> None:
        """Estimate the frame that has been followed, if there is one."""
        if self._observed is not None:
            observed, self._observed = self._observed, None
            self._estimates.append(self._engine._estimated(observed))

    def _next(self) -> FrameEstimate | None:
        return self._estimates.pop(0) if self._estimates else None

    def __enter__(self) -> "Pipeline":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
