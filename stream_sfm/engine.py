"""The page to read first: one stereo frame in, one estimate out. No I/O, no printing.

frame -> observer (rectification and front-end: observations) -> estimator (solution) -> observer (the estimate in axes
of the physical left camera).
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from .camera.rig import MonoRig, StereoRig
from .config import Config
from .errors import EngineBusyError
from .estimators import make_estimator
from .frontend.prepared import PreparedImages
from .observer import Observer
from .types import Frame, FrameEstimate


class Engine:
    """Stereo odometry, live: `step` takes bounded time and memory however long the run.

    One engine belongs to one thread: `step` refuses a second thread while another is in it. `prepare` may run in any
    thread. With `Config.mono` only the left camera of a rig is used. Raises ConfigError for a rig or configuration
    that cannot work.
    """

    def __init__(self, rig: StereoRig | MonoRig, config: Config | None = None) -> None:
        self.config = Config() if config is None else config
        self.observer = Observer(rig, self.config)
        self.estimator = make_estimator(self.config.method, self.observer.projection, self.config)
        self._stepping = threading.Lock()

    @property
    def rig(self) -> StereoRig | MonoRig:
        """The cameras that are used."""
        return self.observer.rig

    def prepare(self, frame: Frame, frame_index: int | None = None) -> PreparedImages:
        """Do what `step` does first with the images and needs no other frame for, so that another thread can do it
        one frame ahead.

        Pure: it may be called at any time, in any order, also for frames that are never stepped. Where the
        `frame_index` of the coming estimate is known (frames count from 0), more of the work is done here; the
        estimates are the same.
        """
        return self.observer.prepare(frame, frame_index)

    def step(self, frame: Frame, prepared: PreparedImages | None = None) -> FrameEstimate:
        """The estimate of the next frame; `prepared`: what `prepare` returned for it, if that was done already.

        Raises FrameError for images of the wrong kind or a stamp that does not advance; the engine is then
        unchanged and takes the next frame. Raises EngineBusyError while another thread is in `step`.
        """
        with self._exclusively():
            observed = self.observer.observe(frame, prepared)
            began = time.perf_counter()
            solution = self.estimator.step(observed.observations)
            return self.observer.estimate(observed, solution, 1e3 * (time.perf_counter() - began))

    @contextmanager
    def _exclusively(self) -> Iterator[None]:
        """Frames depend on each other: two at the same time would leave a wrong pose behind."""
        if not self._stepping.acquire(blocking=False):
            raise EngineBusyError(
                "step was called while another thread is in it: give all frames of a stream to its engine from one "
                "thread, and make one engine per stream"
            )
        try:
            yield
        finally:
            self._stepping.release()
