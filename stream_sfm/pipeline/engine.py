"""The page to read first: one stereo frame in, one estimate out. Nothing is read, written or printed here.

frame -> observer (rectification and front-end) -> observations -> estimator -> solution -> the estimate in the axes of
the physical left camera. A run takes the same steps, with record and files (`run/loop.py`).
"""

from __future__ import annotations  # `help` shows `ArrayLike`, not the six lines that it stands for

import copy
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from numpy.typing import ArrayLike

from ..camera.rig import MonoRig, StereoRig, baseline_warnings, checked_pose
from ..config import Config
from ..errors import EngineBusyError
from ..estimators import make_estimator
from ..geometry import Array, se3
from ..geometry.stereo import StereoProjection
from ..inertial.driver import DriverSamples
from ..motion import in_world
from ..pictures.prepared import PreparedImages
from ..system.blas import one_thread
from ..types import Estimator, Frame, FrameEstimate, InertialEstimator, Observations, Prediction
from .lane import BareLane
from .observer import Observed, Observer


class Engine:
    """Estimates the camera's motion and the structure in view, frame by frame, in bounded time and memory.

    One engine belongs to one thread: `step` refuses a second thread while another is in it. `prepare` may run in
    any thread. Linear algebra runs in one thread meanwhile (`blas.py`), so that estimates are the same, to the
    byte, whatever the environment sets. With `Config.mono` only the left camera of a rig is used. Raises
    ConfigError for a rig or configuration that cannot work; the logger `stream_sfm` warns if a baseline is probably
    not in metres.

    An engine can be copied (`copy.copy`, `copy.deepcopy`) and pickled between two steps; the copy continues with
    the same estimates, to the byte.

    `estimator` makes your own method from the rectified pair and the configuration, in place of `config.method`. It
    is kept for `reset`. To be pickled with the engine, it must be a class or a function of a module.
    """

    def __init__(
        self,
        rig: StereoRig | MonoRig,
        config: Config | None = None,
        estimator: Callable[[StereoProjection, Config], Estimator] | None = None,
    ) -> None:
        self.config = Config() if config is None else config
        with one_thread:
            self.observer = Observer(rig, self.config)
            self._make = partial(make_estimator, self.config.method) if estimator is None else estimator
            self.lane = BareLane(self.observer, self._make(self.observer.projection, self.config))
        self._samples = DriverSamples()
        # The pose of the first frame since a reset; None: that frame is the world.
        self._world_from_first: Array | None = None
        self.observations: Observations | None = None  # of the latest frame, in axes of the rectified pair
        self._stepping = threading.Lock()
        for question in baseline_warnings(self.rig):
            logging.getLogger("stream_sfm").warning(question)

    @property
    def rig(self) -> StereoRig | MonoRig:
        """The cameras from which the estimates are made."""
        return self.observer.rig

    def prepare(self, frame: Frame, frame_index: int | None = None) -> PreparedImages:
        """Do the work on the images that depends on no other frame, for `step` to use.

        Another thread can do this one frame ahead: it changes nothing, and may be called at any time, in any order,
        also for frames that are never stepped. With the `frame_index` of the coming estimate (counted from 0), more
        of the work is done here; the estimates are the same. Raises FrameError for images of the wrong kind.
        """
        with one_thread:
            return self.observer.prepare(frame, frame_index)

    def step(self, frame: Frame, prepared: PreparedImages | None = None) -> FrameEstimate:
        """Return the estimate of the next frame; `prepared` is what `prepare` returned for it, if it was called.

        Raises FrameError for images of the wrong kind or a stamp that does not increase; the engine is then unchanged
        and takes the next frame. Raises EngineBusyError while another thread or a `Pipeline` has the engine.
        """
        with self._exclusively(), one_thread:
            observed = self.observer.observe(self._samples.joined_to(frame), prepared, self.lane.expect)
            self.observer.learn(self.lane.solution)  # of the frame before: `Pipeline` has that of this one too late
            return self._estimated(observed)

    def _estimated(self, observed: Observed) -> FrameEstimate:
        """Return the estimate of a frame that has been observed, in the world of this engine."""
        self.observations = observed.observations
        estimate = self.lane.estimate(observed)
        return estimate if self._world_from_first is None else in_world(estimate, self._world_from_first)

    def reset(self, world_from_cam: ArrayLike | None = None) -> None:
        """Start over: the next frame is the first one, as for a new engine, whatever its stamp is.

        `world_from_cam` (4, 4): the pose of the camera then, known from elsewhere; None: that frame is the world.
        Raises ConfigError for an invalid pose, and EngineBusyError while another thread is in `step`.
        """
        pose = None if world_from_cam is None else checked_pose(world_from_cam, "world_from_cam")
        with self._exclusively(), one_thread:
            self.observer.reset()
            self.lane = BareLane(self.observer, self._make(self.observer.projection, self.config))
            self._samples = DriverSamples()
            self.observations, self._world_from_first = None, pose

    def __repr__(self) -> str:
        return f"<Engine {self.lane.estimator.name}, {self.observer.state.frame_index} frames, {self.rig!r}>"

    def add_imu(self, stamp_ns: int, gyro_rad_s: ArrayLike, accel_m_s2: ArrayLike) -> None:
        """Take one inertial sample (3,) and (3,) from a driver, and keep it for the frame to which it belongs.

        Samples must come in order of time; any thread may call this. `step` gives a frame all samples so far, and does
        not wait for more. A frame with its own samples needs no others. Raises FrameError for invalid samples.
        """
        self._samples.add(stamp_ns, gyro_rad_s, accel_m_s2)

    def predict(self, stamp_ns: int) -> Prediction | None:
        """Predict pose, velocity and covariance at a time after the latest frame from the inertial samples so far.

        It may be called for every sample; those of `add_imu` count at once. None if no samples reach this time.
        """
        if not isinstance(self.lane.estimator, InertialEstimator):
            return None
        with self._exclusively(), one_thread:
            found = self.lane.estimator.predict(stamp_ns, self.observer.view_of(self._samples.so_far()))
            if found is None:
                return None
            found = self.observer.physical.prediction(found)
            if self._world_from_first is None:
                return found
            return replace(found, world_from_cam=se3.orthonormalise(self._world_from_first @ found.world_from_cam))

    def __copy__(self) -> Engine:
        """Return an engine that continues independently from here, as `copy.deepcopy` does."""
        other = type(self).__new__(type(self))
        other.__setstate__(self.__getstate__())
        return other

    def __deepcopy__(self, _: dict[int, Any]) -> Engine:
        return self.__copy__()

    def __getstate__(self) -> dict[str, Any]:
        """Return copies of everything but the lock of this process, as a step may begin before they are written.

        Raises EngineBusyError within a step, when a copy would be inconsistent.
        """
        with self._exclusively("copied"):
            return copy.deepcopy({name: value for name, value in vars(self).items() if name != "_stepping"})

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _stepping=threading.Lock())

    @contextmanager
    def _exclusively(self, wanted: str = "") -> Iterator[None]:
        """Refuse a second thread: two frames at the same time would leave a wrong pose."""
        if not self._stepping.acquire(blocking=False):
            raise EngineBusyError(
                f"the engine was {wanted} within a step: copy and pickle it between two steps"
                if wanted
                else "step was called while another thread is in it, or a pipeline has the engine: give all frames of "
                "a stream to its engine from one thread, and make one engine per stream"
            )
        try:
            yield
        finally:
            self._stepping.release()
