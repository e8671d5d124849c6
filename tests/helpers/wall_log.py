"""A small stereo log that the engine can work on: a textured wall with ground truth of pose and depth."""

from pathlib import Path

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from stream_sfm.geometry import se3
from tests.helpers.stereo_logs import Calib, LogWriter, write_image, write_info
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig

START_NS = 1_700_000_000_000_000_000
LEFT, RIGHT = "/camera/left/image", "/camera/right/image"


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
    size = {"width": stereo.left.width, "height": stereo.left.height, "K": k, "D": ()}
    log = LogWriter(file, chunk_size=300_000)
    for i, source in enumerate(order):
        time = START_NS + i * PERIOD_NS
        if i == 0:
            for side, offset in (("left", 0.0), ("right", -k[0, 0] * stereo.baseline_m)):
                calib = Calib(P=np.c_[k, [offset, 0, 0]], **size)
                if right or side == "left":
                    write_info(log, "foxglove", f"/camera/{side}/calibration", time, calib)
        write_image(log, "foxglove", LEFT, time, frames[source].left, "mono8")
        if right and i not in without_right:
            write_image(log, "foxglove", RIGHT, time, frames[source].right, "mono8")
        if truth:
            _write_truth(log, time, poses[source], stereo.left.K, wall)
    log.close()
    return file


def _write_truth(log: LogWriter, time: int, world_from_cam: np.ndarray, k: np.ndarray, wall: Wall) -> None:
    message = PoseInFrame(frame_id="world")
    message.timestamp.FromNanoseconds(time)
    p, o = message.pose.position, message.pose.orientation
    p.x, p.y, p.z = world_from_cam[:3, 3]
    o.x, o.y, o.z, o.w = se3.quat_xyzw_from_matrix(world_from_cam[:3, :3])
    log.protobuf("/ground_truth/pose", message, time)
    cam_from_wall = se3.inverse(world_from_cam) @ wall.world_from_wall
    normal, offset = cam_from_wall[:3, 2], cam_from_wall[:3, 2] @ cam_from_wall[:3, 3]
    u, v = np.meshgrid(np.arange(320), np.arange(240))
    rays = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(u.shape)], axis=-1)
    depth = np.rint(1e4 * offset / (rays @ normal)).astype(np.uint16)
    image = CompressedImage(frame_id="left", format="png", data=cv2.imencode(".png", depth)[1].tobytes())
    image.timestamp.FromNanoseconds(time)
    log.protobuf("/ground_truth/depth", image, time)
