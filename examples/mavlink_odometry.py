"""The odometry as MAVLink's message ODOMETRY, for PX4 and ArduPilot: north-east-down axes, and covariances in them.

python examples/mavlink_odometry.py logs/room.mcap --connect udpout:127.0.0.1:14550

Without --connect the messages are printed, and pymavlink is not needed. docs/fusion.md says which parameters of the
autopilot belong to them.
"""

import argparse
import os
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np

import stream_sfm as sfm

LOCAL_FRD, BODY_FRD, VISION = 20, 12, 2  # MAV_FRAME_LOCAL_FRD, MAV_FRAME_BODY_FRD, MAV_ESTIMATOR_TYPE_VISION
QUALITY = {sfm.Status.OK: 100, sfm.Status.DEGRADED: 50, sfm.Status.INITIALISING: 1, sfm.Status.LOST: -1}  # per cent
UPPER = np.triu_indices(6)  # of a covariance, row by row: 21 numbers
# Forward, right, down are z, x, y of a camera.
FRD_FROM_CAM = np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])


@dataclass
class MavlinkOdometry:
    """Makes the fields of ODOMETRY from estimates, one after the other.

    `body_from_cam` (4, 4): the left camera on the vehicle, whose axes are forward, right, down; metres.
    `local_from_body` (4, 4): the vehicle in the local frame at the first estimate, by the autopilot's attitude: its z
    is down, and where its x is north, the local frame is NED.
    """

    body_from_cam: np.ndarray = field(default_factory=lambda: FRD_FROM_CAM)
    local_from_body: np.ndarray = field(default_factory=lambda: np.eye(4))
    odometry: sfm.Odometry | None = None
    resets: int = 0
    _local_from_odom: np.ndarray = field(default_factory=lambda: np.eye(4))

    def fields(self, estimate: sfm.FrameEstimate) -> dict[str, Any]:
        """The fields of the message of the next estimate, by their names in MAVLink."""
        body_from_cam, cam_from_body = self.body_from_cam, sfm.se3_inverse(self.body_from_cam)
        if self.odometry is None:
            first = estimate.world_from_cam @ cam_from_body
            self._local_from_odom = self.local_from_body @ sfm.se3_inverse(first)
        elif estimate.status == sfm.Status.INITIALISING:  # a new map begins where the camera was predicted
            self.resets += 1
        self.odometry = now = sfm.Odometry.after(self.odometry, estimate)
        local_from_body = self._local_from_odom @ now.odom_from_cam @ cam_from_body
        turned, to_body = np.zeros((6, 6)), sfm.se3_adjoint(body_from_cam)
        turned[:3, :3] = turned[3:, 3:] = local_from_body[:3, :3]  # errors about the axes of the local frame
        cov = turned @ to_body @ now.cov @ to_body.T @ turned.T
        twist, cov_twist = np.full(6, np.nan), np.full((6, 6), np.nan)
        if now.twist is not None and now.cov_twist is not None:
            twist, cov_twist = to_body @ now.twist, to_body @ now.cov_twist @ to_body.T
        names = ("x", "y", "z", "vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed")
        return {
            "time_usec": estimate.stamp_ns // 1000,
            "frame_id": LOCAL_FRD,
            "child_frame_id": BODY_FRD,
            **dict(zip(names, [*local_from_body[:3, 3].tolist(), *twist.tolist()], strict=True)),
            "q": quat_wxyz(local_from_body[:3, :3]),
            "pose_covariance": cov[UPPER].tolist(),
            "velocity_covariance": cov_twist[UPPER].tolist(),
            "reset_counter": self.resets % 256,
            "estimator_type": VISION,
            "quality": QUALITY[estimate.status],
        }


def quat_wxyz(rotation: np.ndarray) -> list[float]:
    """The unit quaternion (4,), w first and not negative, of a rotation matrix (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation
    turn = sfm.se3_log(pose)[3:]
    half = np.linalg.norm(turn) / 2
    return [float(np.cos(half)), *(turn / 2 * np.sinc(half / np.pi)).tolist()]


def main() -> None:
    """Estimate a log as a vehicle would do live, and send or print every message."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log")
    parser.add_argument("--connect", metavar="ADDRESS", help="of the autopilot, as pymavlink takes it")
    parser.add_argument("--max-frames", type=int)
    args = parser.parse_args()
    log, messages, link = sfm.open_log(args.log), MavlinkOdometry(), None
    if args.connect:
        os.environ.setdefault("MAVLINK20", "1")  # ODOMETRY is of version 2
        mavutil = import_module("pymavlink.mavutil")
        link = mavutil.mavlink_connection(args.connect, source_component=197, dialect="common")  # visual odometry
    engine = sfm.Engine(log.rig)
    for frame in log.frames(sfm.Selection(max_frames=args.max_frames)):
        fields = messages.fields(engine.step(frame))
        if link is not None:
            link.mav.odometry_send(**fields)
        else:
            std_m = np.sqrt(np.array(fields["pose_covariance"])[[0, 6, 11]].sum())
            x, y, z = (fields[name] for name in "xyz")
            print(f"{fields['time_usec']} us  {x:8.3f} {y:8.3f} {z:8.3f} m, σ {std_m:.4f} m, {fields['quality']} %")


if __name__ == "__main__":
    main()
