"""One world for a run whose calibration changes: each new map is placed at the predicted pose of the camera."""

from dataclasses import fields, replace

import numpy as np

from ..config import MotionConfig
from ..estimators.lifecycle import lost_solution
from ..estimators.motion_model import MotionModel
from ..geometry import Array
from ..motion import in_world
from ..record import Kind, with_changes
from ..types import FrameEstimate, Observations, Solution, Status

_REASON = "the calibration has changed: a new map begins at the predicted pose"


class World:
    """Places estimates in order. Those of the first calibration are unchanged.

    The first frame of each further calibration is lost, with the pose that the previous motion predicts. All later
    frames are relative to it and include its uncertainty.
    """

    def __init__(self, config: MotionConfig) -> None:
        self._motion = MotionModel(config)
        self._begins = False
        self._from_map: Array | None = None  # world_from_map: the pose of the first camera of the latest map
        self._cov = np.zeros((6, 6))  # of the perturbation on its right
        self._first_frame = self._first_id = self._next_id = 0

    def restart(self, frames: int) -> None:
        """Expect the first estimate of a new estimator, after `frames` of the previous one."""
        self._begins = self._motion.started
        self._first_frame, self._first_id = self._first_frame + frames, self._next_id

    def place(self, estimate: FrameEstimate, observations: Observations) -> FrameEstimate:
        """Return the estimate in this world, with frame and track numbers continued."""
        if self._begins:
            self._begins = False
            self._from_map, self._cov = self._motion.predict(estimate.stamp_ns)
            lost = lost_solution(observations, _REASON, np.eye(4), np.zeros((6, 6)))
            estimate = replace(estimate, **{field.name: getattr(lost, field.name) for field in fields(Solution)})
        if self._from_map is not None:
            estimate = self._moved(estimate, self._from_map)
        self._next_id = max(self._next_id, self._first_id + 1 + int(observations.track_ids.max(initial=-1)))
        if estimate.status is not Status.LOST:
            self._motion.add(estimate.stamp_ns, estimate.world_from_cam, estimate.cov_pose)
        return estimate

    def _moved(self, estimate: FrameEstimate, from_map: Array) -> FrameEstimate:
        """Return an estimate of the latest map in this world; `stream_sfm.types` says how each field transforms."""
        return with_changes(
            in_world(estimate, from_map, self._cov),
            {
                Kind.FRAMES: lambda frames, _: frames + self._first_frame,
                Kind.TRACKS: lambda ids, _: ids + self._first_id,
            },
        )
