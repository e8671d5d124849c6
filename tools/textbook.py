"""Runs the textbook loop that a user would write with OpenCV in an hour on any log, beside a finished run.

    python -m tools.textbook LOG                # how well the loop follows it
    python -m tools.textbook LOG RUN_FOLDER     # and what a replay of the same log has made of it

Corners, KLT from left to right and through time, both forward and backward, and a pose by PnP with RANSAC, frame to
frame. No calibration is questioned, and nothing is learnt. A log with more than 70 % of inliers in the median frame is
followed by the loop; where more than 5 % of the run's frames are degraded or lost on such a log, this is said.
"""

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stream_sfm import open_log, read_results
from stream_sfm.camera.rectification import Rectifier
from stream_sfm.evaluation import trajectory
from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.logs.recording.stereo_log import StereoLog
from stream_sfm.types import Selection, Status

Images = tuple[NDArray[np.uint8], NDArray[np.uint8]]  # rectified, left and right
CORNERS, QUALITY, APART_PX = 800, 0.005, 8
FLOW = {"winSize": (21, 21), "maxLevel": 3}
RETURN_PX, ROW_PX, REPROJECTION_PX = 0.5, 1.5, 1.5
FEWEST = 8  # points for a pose
FOLLOWED, FEW_DEGRADED = 0.7, 0.05


@dataclass(frozen=True, slots=True)
class Loop:
    """What the loop makes of a log: stamps (n,), poses of the physical left camera (n, 4, 4), and shares (n − 1,).

    A share is that of the tracked points that are inliers of the pose; 0 where there is no pose.
    """

    stamps_ns: NDArray[np.int64]
    world_from_cam: Array
    inliers: Array

    @property
    def median_inliers(self) -> float:
        """0 of a log of one frame."""
        return float(np.median(self.inliers)) if len(self.inliers) else 0.0


def follow(log: StereoLog, selection: Selection | None = None) -> Loop:
    """Run the loop on a log."""
    rectifier = Rectifier(log.stereo_rig)
    rect_from_cam = se3.from_rotation_translation(rectifier.rect_from_cam, np.zeros(3))
    world_from_rect, before = np.eye(4), None
    stamps_ns, poses, shares = [], [], []
    for frame in log.frames(selection):
        left, right = rectifier.rectify(frame.left, frame.right)
        if before is not None:
            previous_from_now, share = _motion(before, left, rectifier.projection)
            world_from_rect = world_from_rect @ previous_from_now
            shares.append(share)
        stamps_ns.append(frame.stamp_ns)
        poses.append(se3.inverse(rect_from_cam) @ world_from_rect @ rect_from_cam)
        before = left, right
    return Loop(np.array(stamps_ns, np.int64), np.array(poses), np.array(shares))


def _motion(before: Images, left: NDArray[np.uint8], p: StereoProjection) -> tuple[Array, float]:
    """The motion since the previous frame, and the share of inliers."""
    corners = cv2.goodFeaturesToTrack(before[0], CORNERS, QUALITY, APART_PX)
    if corners is None:
        return np.eye(4), 0.0
    matched, good = _both_ways(*before, corners)
    apart = (corners - matched)[:, 0]
    disparity = apart[:, 0] - (p.cx_left_px - p.cx_right_px)
    good &= (np.abs(apart[:, 1]) < ROW_PX) & (disparity > 1)
    corners, depth_m = corners[good], p.f_px * p.baseline_m / disparity[good]
    if len(corners) <= FEWEST:
        return np.eye(4), 0.0
    slopes = (corners[:, 0] - (p.cx_left_px, p.cy_px)) / p.f_px
    points = np.column_stack([slopes, np.ones(len(slopes))]) * depth_m[:, None]
    now, good = _both_ways(before[0], left, corners)
    if good.sum() <= FEWEST:
        return np.eye(4), 0.0
    k = np.array([[p.f_px, 0, p.cx_left_px], [0, p.f_px, p.cy_px], [0, 0, 1]])
    found, turn, shift, inliers = cv2.solvePnPRansac(
        points[good], now[good], k, None, reprojectionError=REPROJECTION_PX, iterationsCount=200
    )
    if not found or inliers is None:
        return np.eye(4), 0.0
    now_from_previous = se3.from_rotation_translation(cv2.Rodrigues(turn)[0], shift[:, 0])
    return se3.inverse(now_from_previous), len(inliers) / int(good.sum())


def _both_ways(
    source: NDArray[np.uint8], target: NDArray[np.uint8], points_px: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where points (n, 1, 2) of an image are in another one, and which of them come back to where they were."""
    there, seen, _ = cv2.calcOpticalFlowPyrLK(source, target, points_px, None, **FLOW)
    back, seen_again, _ = cv2.calcOpticalFlowPyrLK(target, source, there, None, **FLOW)
    returned = np.linalg.norm((points_px - back)[:, 0], axis=1) < RETURN_PX
    return there, (seen[:, 0] > 0) & (seen_again[:, 0] > 0) & returned


@dataclass(frozen=True, slots=True)
class Comparison:
    """A run beside the loop: frames by status, those that both have, and the RMS distance of the aligned paths."""

    frames: int
    statuses: dict[str, int]
    common_frames: int
    apart_rms_m: float | None
    verdict: str


def compare(loop: Loop, stamps_ns: NDArray[np.int64], world_from_cam: Array, statuses: list[str]) -> Comparison:
    """Compare a run's frames with the loop's."""
    counts = {status.value: statuses.count(status.value) for status in Status}
    _, of_loop, of_run = np.intersect1d(loop.stamps_ns, stamps_ns, return_indices=True)
    apart_m = None
    if len(of_loop) > 1:
        apart_m = trajectory.ate_rmse_aligned_m(world_from_cam[of_run], loop.world_from_cam[of_loop])
    return Comparison(
        len(statuses), counts, len(of_loop), apart_m, verdict(loop.median_inliers, len(statuses), not_ok(counts))
    )


def not_ok(statuses: dict[str, int]) -> int:
    """How many frames are degraded or lost."""
    return statuses[Status.DEGRADED] + statuses[Status.LOST]


def verdict(median_inliers: float, frames: int, bad: int) -> str:
    """Say that a log is followed by the loop, and degraded with us; empty if it is not so."""
    if median_inliers > FOLLOWED and bad > FEW_DEGRADED * frames:
        return f"FOLLOWED by the loop, degraded with us: {bad} of {frames}"
    return ""


def main() -> None:
    """Parse, run the loop, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path)
    parser.add_argument("run", type=Path, nargs="?", help="the folder of a finished replay of this log")
    parser.add_argument("--calibration", type=Path, help="instead of the log's own")
    parser.add_argument("--max-frames", type=int)
    parser.add_argument("--json", action="store_true", help="one JSON object instead of sentences")
    arguments = parser.parse_args()
    log = open_log(arguments.log, calibration=arguments.calibration)
    loop = follow(log, Selection(max_frames=arguments.max_frames))
    compared = None
    if arguments.run is not None:
        run = read_results(arguments.run)
        compared = compare(loop, run.stamps_ns, run.world_from_cam, run.statuses.tolist())
    truth = log.ground_truth()
    found = {
        "frames": len(loop.stamps_ns),
        "path_m": trajectory.path_length_m(loop.world_from_cam),
        "median_inliers": loop.median_inliers,
        "more_than_half": float((loop.inliers > 0.5).mean()) if len(loop.inliers) else 0.0,
        "run": asdict(compared) if compared else None,
    }
    if truth is not None:
        from stream_sfm import Trajectory
        from stream_sfm.evaluation.summary import evaluate

        found["ground_truth"] = evaluate(Trajectory(loop.stamps_ns, loop.world_from_cam), truth)
    print(json.dumps(found) if arguments.json else _told(found))


def _told(found: dict) -> str:
    lines = [
        f"loop: {found['frames']} frames, path {found['path_m']:.2f} m; inliers: median {found['median_inliers']:.2f}, "
        f"more than half in {found['more_than_half']:.0%} of the frames"
    ]
    if (truth := found.get("ground_truth")) and truth["ate_rmse_aligned_m"] is not None:
        lines[0] += f"; ATE {1e3 * truth['ate_rmse_aligned_m']:.4g} mm"
    if (run := found["run"]) is not None:
        statuses = ", ".join(f"{n} {status}" for status, n in run["statuses"].items() if n)
        apart = "" if run["apart_rms_m"] is None else f"; paths differ by {run['apart_rms_m']:.4g} m RMS, aligned"
        lines.append(f"run: {statuses}{apart}, over {run['common_frames']} frames")
        lines += [run["verdict"]] if run["verdict"] else []
    return "\n".join(lines)


if __name__ == "__main__":
    main()
