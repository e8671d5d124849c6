"""Your own method in the engine: dead reckoning by the front-end's motion, beside the default method.

    python examples/custom_estimator.py logs/room.mcap

The front-end gives every estimator the same observations. This one trusts the front-end's motion between the last
two frames, and triangulates each point from its current view alone. Its covariance is a guess; the NEES, printed
for both methods, shows how good it is.
"""

import argparse

import numpy as np

import stream_sfm as sfm


class DeadReckoning:
    """Concatenates motions; the position is given a σ of `STD_PER_FRAME_M` more in each frame, as a random walk."""

    name = "dead-reckoning"
    STD_PER_FRAME_M = 0.005
    STD_PER_FRAME_RAD = 0.002

    def __init__(self, projection: sfm.StereoProjection, config: sfm.Config) -> None:
        self._projection = projection
        self._world_from_cam = np.eye(4)
        self._cov_pose = np.zeros((6, 6))

    def step(self, observations: sfm.Observations) -> sfm.Solution:
        """Take the next frame."""
        status, reason = sfm.Status.INITIALISING, "first frame"
        if observations.frame_index > 0:
            status, reason = sfm.Status.OK, ""
            if observations.cam_from_previous is None:
                status, reason = sfm.Status.LOST, "the front-end has found no motion"
            else:
                self._world_from_cam = self._world_from_cam @ np.linalg.inv(observations.cam_from_previous)
            variances = np.repeat([self.STD_PER_FRAME_M**2, self.STD_PER_FRAME_RAD**2], 3)
            self._cov_pose = self._cov_pose + np.diag(variances)
        return self._solution(observations, status, reason)

    def _solution(self, observations: sfm.Observations, status: sfm.Status, reason: str) -> sfm.Solution:
        """The pose, and the points of this frame's stereo views."""
        both_sides = np.isfinite(observations.z_px).all(axis=1)
        points = self._projection.triangulate(observations.z_px[both_sides])
        jacobian = np.linalg.pinv(self._projection.jacobian(points))
        cov_points = jacobian @ observations.cov_px[both_sides] @ jacobian.transpose(0, 2, 1)
        rotation, position = self._world_from_cam[:3, :3], self._world_from_cam[:3, 3]
        return sfm.Solution(
            status=status,
            reason=reason,
            world_from_cam=self._world_from_cam,
            cov_pose=self._cov_pose,
            track_ids=observations.track_ids[both_sides],
            points_in_cam=points,
            cov_points=cov_points,
            points_in_world=points @ rotation.T + position,
            cov_points_in_world=rotation @ cov_points @ rotation.T,
            window_frame_indices=np.array([observations.frame_index]),
            window_world_from_cam=self._world_from_cam[None],
        )


def main() -> None:
    """Run both methods on a log with ground truth."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log")
    parser.add_argument("--max-frames", type=int)
    args = parser.parse_args()
    log = sfm.open_log(args.log)
    engines = {
        "dead reckoning": sfm.Engine(log.rig, estimator=DeadReckoning),
        "cross-frame": sfm.Engine(log.rig),
    }
    truth = log.ground_truth()
    for name, engine in engines.items():
        estimates = [engine.step(frame) for frame in log.frames(sfm.Selection(max_frames=args.max_frames))]
        trajectory = sfm.Trajectory(
            np.array([e.stamp_ns for e in estimates]),
            np.stack([e.world_from_cam for e in estimates]),
            np.stack([e.cov_pose for e in estimates]),
        )
        if truth is None:
            raise SystemExit(f"{args.log} has no ground truth to compare with")
        figures = sfm.evaluate(trajectory, truth)
        error_mm, nees = 1e3 * figures["ate_rmse_m"], figures["nees_pose_mean"]
        print(f"{name}: {len(trajectory)} frames, position error {error_mm:.2f} mm RMS, NEES {nees:.2f} (6 expected)")


if __name__ == "__main__":
    main()
