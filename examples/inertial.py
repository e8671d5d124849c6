"""Darkness bridged by gyroscope and accelerometer: a log with an inertial unit, whose images go black for a second.

    python examples/inertial.py LOG

Samples come one by one, as from a driver, and the pose is predicted at their rate.
"""

import argparse
from collections.abc import Iterable

import numpy as np

import stream_sfm as sfm


def run(frames: Iterable[sfm.StereoFrame], engine: sfm.Engine, dark: range) -> None:
    """Step the engine, and print the estimates of every tenth frame and of those in the dark."""
    for k, frame in enumerate(frames):
        given = frame.imu if frame.imu is not None else sfm.ImuSamples(np.empty(0, np.int64), *np.empty((2, 0, 3)))
        for stamp_ns, rate, force in zip(given.stamps_ns, given.gyro_rad_s, given.accel_m_s2, strict=True):
            engine.add_imu(int(stamp_ns), rate, force)
            ahead = engine.predict(int(stamp_ns))  # at the rate of the samples: None before the first estimate
        left, right = (0 * image if k in dark else image for image in (frame.left, frame.right))
        estimate = engine.step(sfm.StereoFrame(frame.stamp_ns, left, right))
        if estimate.inertial is None or not (k in dark or k % 10 == 0):
            continue
        tilt_mrad, std_m = 1e3 * estimate.inertial.std_tilt_rad, np.sqrt(np.trace(estimate.cov_pose[:3, :3]))
        speed = np.linalg.norm(estimate.inertial.velocity)
        print(f"{k:5d} {estimate.status}: {speed:.2f} m/s, σ {std_m:.3f} m, tilt σ {tilt_mrad:.1f} mrad", end="")
        print(f"; {estimate.reason}" if estimate.reason else "", "" if ahead is None else "(predicted)")


def main() -> None:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log", help="a log with sensor_msgs/msg/Imu")
    parser.add_argument("--dark", type=int, nargs=2, default=(100, 120), metavar=("FIRST", "END"), help="frames")
    arguments = parser.parse_args()
    log = sfm.open_log(arguments.log)
    if log.imu_topics is None:
        parser.error(log.imu_problem or f"{arguments.log} has no inertial samples")
    run(log.frames(), sfm.Engine(log.rig), range(*arguments.dark))


if __name__ == "__main__":
    main()
