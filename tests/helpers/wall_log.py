"""A small stereo log that the engine can work on: a textured wall with ground truth of pose and depth."""

from pathlib import Path

import numpy as np

from stream_sfm.geometry import se3
from tests.helpers.stereo_logs import LogWriter, Spec, infos_of, write_info, write_pair, write_truth
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig

START_NS = 1_700_000_000_000_000_000
LEFT, RIGHT = Spec.topics


def write_wall_log(
    file: Path,
    n: int = 12,
    times: int = 1,
    truth: bool = True,
    without_right: tuple[int, ...] = (),
    right: bool = True,
) -> Path:
    """`n` frames along `path`, there and back again `times` times over (so that it can be of any length).

    Without `right` the log is of one camera, calibration and all.
    """
    wall, stereo = Wall(5), rig()
    poses = camera_path(n)
    frames = wall.frames(stereo, poses)
    order = [k for turn in range(times) for k in (range(n) if turn % 2 == 0 else range(n - 2, 0, -1))]
    k = stereo.left.K
    log = LogWriter(file, chunk_size=300_000)
    for i, source in enumerate(order):
        time = START_NS + i * PERIOD_NS
        if i == 0:
            for topic, info in zip(Spec.info_topics[: 1 + right], infos_of(stereo), strict=False):
                write_info(log, "foxglove", topic, time, info)
        sides = 1 + (right and i not in without_right)
        write_pair(log, "foxglove", time, frames[source].images[:sides], encoding="mono8")
        if truth:
            write_truth(log, time, poses[source], _depth(poses[source], k, wall))
    log.close()
    return file


def _depth(world_from_cam: np.ndarray, k: np.ndarray, wall: Wall) -> np.ndarray:
    """The depth image (240, 320) of the wall, uint16 in tenths of millimetres."""
    cam_from_wall = se3.inverse(world_from_cam) @ wall.world_from_wall
    normal, offset = cam_from_wall[:3, 2], cam_from_wall[:3, 2] @ cam_from_wall[:3, 3]
    u, v = np.meshgrid(np.arange(320), np.arange(240))
    rays = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(u.shape)], axis=-1)
    return np.rint(1e4 * offset / (rays @ normal)).astype(np.uint16)
