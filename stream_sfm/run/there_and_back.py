"""Drift without ground truth: a second engine estimates the frames again, from the last to the first.

The way back ends where the way there began. The distance between both ends is drift that the two ways do not share: a
wrong scale or baseline cancels, as does everything else that shortens both alike. Each way estimates the rig errors
itself, because a delay of the right camera changes its sign when time runs backwards.
"""

from collections.abc import Iterator
from contextlib import closing
from copy import copy
from typing import Any

import numpy as np

from ..config import Config
from ..errors import ConfigError, FrameError
from ..evaluation.trajectory import path_length_m
from ..geometry import se3
from ..logs.recording.frames import FrameDecoder
from ..logs.recording.pair_reader import StereoPair
from ..logs.recording.stereo_log import StereoLog
from ..pipeline.engine import Engine
from ..system.interrupts import Interruption
from ..types import FrameEstimate, Selection, Status, StereoFrame, Trajectory

_MOST_BYTES = 2**30  # recorded images that are kept for reading backwards


def drift_there_and_back(
    log: StereoLog, config: Config, selection: Selection, there: Trajectory, interruption: Interruption
) -> dict[str, Any] | None:
    """Return the distance between start and end of the way there and back; None if it was interrupted.

    `there`: the poses of the way there. `over_sigma` is 1 if the covariances of both ways are consistent. Raises
    ConfigError if the frames take too much memory.
    """
    engine, lost = Engine(log.rig, config), 0
    last: FrameEstimate | None = None
    for frame in _backwards(log, selection):
        if interruption.requested:
            return None
        try:
            last = engine.step(frame)
        except FrameError:  # also refused on the way there
            continue
        lost += last.status is Status.LOST
    if last is None or there.cov_pose is None or len(there) < 2:
        return None
    begin_from_end = there.world_from_cam[-1] @ last.world_from_cam
    xi = se3.log(se3.inverse(there.world_from_cam[0]) @ begin_from_end)
    carried = se3.adjoint(se3.inverse(last.world_from_cam))
    cov = carried @ there.cov_pose[-1] @ carried.T + last.cov_pose
    distance_m = float(np.linalg.norm(xi[:3]))
    length_m = 2 * path_length_m(there.world_from_cam)
    return {
        "apart_m": distance_m,
        "apart_percent": 100 * distance_m / length_m if length_m > 0 else None,
        "apart_deg": float(np.degrees(np.linalg.norm(xi[3:]))),
        "over_sigma": float(np.sqrt(xi @ np.linalg.solve(cov, xi) / 6)),
        "lost": lost,
    }


def _backwards(log: StereoLog, selection: Selection) -> Iterator[StereoFrame]:
    """Yield the frames from the last to the first, with time mirrored at the last one."""
    log = copy(log)  # a separate reading, which does not change `stats`
    pairs, size_bytes = list[StereoPair](), 0
    with closing(log.frames(selection)) as frames:
        for frame in frames:
            pairs.append(frame.recorded)
            size_bytes += sum(len(image.data) for image in frame.recorded.images)
            if size_bytes > _MOST_BYTES:
                raise ConfigError(
                    f"{log.path}: its frames take more than {_MOST_BYTES // 2**30} GiB, which there and back has to "
                    "keep: choose fewer of them",
                    hint=("end", "max_frames"),
                )
    turn_ns = pairs[-1].stamp_ns
    for frame in FrameDecoder(log.path, log.rig).frames(reversed(pairs)):
        yield StereoFrame(2 * turn_ns - frame.stamp_ns, frame.left, frame.right)
