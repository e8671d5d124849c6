"""Copies of logs whose calibration is made wrong: what the window finds, how accurate it stays, and whether σ is right.

    python -m tools.decalibrated logs/room.mcap LOG... --frames 100

For each kind of error, of either sign: from which frame on errors are corrected; ATE from frame 30 on, after the best
rigid motion and (Sim) similarity, over that with the calibration of the log; mean NEES of the pose, 6 expected of a
window that knows nothing, less where most of σ stands for errors that the copy does not have; and the same with
`rig.exact`. Logs need exact ground truth and an exact calibration.
"""

import argparse
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

from stream_sfm import Engine, StereoRig, Trajectory, open_log
from stream_sfm.camera.models import Camera
from stream_sfm.config import Config, RigConfig
from stream_sfm.evaluation.summary import evaluate
from stream_sfm.geometry import se3
from stream_sfm.types import FrameEstimate, Selection

_LEARNT = 30  # frames


def camera(c: Camera, *, cx: float = 0.0, cy: float = 0.0, k1: float = 0.0, p2: float = 0.0) -> Camera:
    """A camera with another principal point and lens."""
    k, d = c.K.copy(), np.zeros(5)
    k[:2, 2] += cx, cy
    d[: len(c.D)] = c.D
    d[[0, 3]] += k1, p2
    lens = {"distortion_model": "plumb_bob", "D": tuple(d)} if k1 or p2 else {}
    return replace(c, K=k, **lens)


def _turned(axis: int) -> Callable[[StereoRig, int], StereoRig]:
    def wrong(rig: StereoRig, sign: int) -> StereoRig:
        turn = np.zeros(6)
        turn[3 + axis] = sign * 5e-4
        return replace(rig, right_from_left=se3.exp(turn) @ rig.right_from_left)

    return wrong


def _longer(rig: StereoRig, sign: int) -> StereoRig:
    right_from_left = rig.right_from_left.copy()
    right_from_left[:3, 3] *= 1 + 0.005 * sign
    return replace(rig, right_from_left=right_from_left)


def _both(**errors: float) -> Callable[[StereoRig, int], StereoRig]:
    def wrong(rig: StereoRig, sign: int) -> StereoRig:
        of_sign = {name: sign * error for name, error in errors.items()}
        return replace(rig, left=camera(rig.left, **of_sign), right=camera(rig.right, **of_sign))

    return wrong


def _right(**errors: float) -> Callable[[StereoRig, int], StereoRig]:
    def wrong(rig: StereoRig, sign: int) -> StereoRig:
        return replace(rig, right=camera(rig.right, **{name: sign * error for name, error in errors.items()}))

    return wrong


# What is made wrong, by as much as real calibrations err: half a milliradian, a pixel, half a per cent.
KINDS: dict[str, Callable[[StereoRig, int], StereoRig]] = {
    "yaw": _turned(1),
    "pitch": _turned(0),
    "roll": _turned(2),
    "centre x": _both(cx=1.0),
    "centre y": _both(cy=1.0),
    "right centre x": _right(cx=1.0),
    "k1": _both(k1=0.005),
    "right k1": _right(k1=0.005),
    "p2": _both(p2=0.002),
    "baseline": _longer,
}


def poses_nees(estimates: list[FrameEstimate], world_from_cam: np.ndarray) -> np.ndarray:
    """NEES (n,) of the poses after the first, against true ones (n + 1, 4, 4) that begin with the identity."""
    poses = np.stack([e.world_from_cam for e in estimates])
    errors = se3.log(se3.inverse(poses) @ world_from_cam)[1:]
    covs = np.stack([e.cov_pose for e in estimates])[1:]
    return np.einsum("ni,ni->n", errors, np.linalg.solve(covs, errors[..., None])[..., 0])


def run(path: Path, wrong: Callable[[StereoRig], StereoRig], config: Config, frames: int) -> tuple[float | None, ...]:
    """First frame that is corrected, ATE and ATE after a similarity (mm) from frame `_LEARNT` on, mean NEES."""
    log = open_log(path)
    engine = Engine(wrong(log.stereo_rig), config)
    estimates = [engine.step(frame) for frame in log.frames(Selection(max_frames=frames))]
    stamps = np.array([e.stamp_ns for e in estimates])
    truth = log.ground_truth()
    found = Trajectory(
        stamps, np.stack([e.world_from_cam for e in estimates]), np.stack([e.cov_pose for e in estimates])
    )
    late = evaluate(Trajectory(stamps[_LEARNT:], found.world_from_cam[_LEARNT:]), truth)
    corrected = next((e.frame_index for e in estimates if e.rig is not None and e.rig.applied), None)
    scale = 1 + (late["scale_error_percent"] or 0.0) / 100
    scaled = found.world_from_cam[_LEARNT:].copy()
    scaled[:, :3, 3] /= scale
    similar = evaluate(Trajectory(stamps[_LEARNT:], scaled), truth)
    nees = evaluate(found, truth)["nees_pose_mean"]
    return corrected, 1e3 * late["ate_rmse_aligned_m"], 1e3 * similar["ate_rmse_aligned_m"], nees


def main() -> None:
    """Print a table per log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--blind", action="store_true", help="also with rig.exact, as if the calibration were right")
    args = parser.parse_args()
    for path in args.logs:
        table = Table("calibration", "corrected from", "ATE, mm", "Sim", "NEES", "NEES blind", title=str(path))
        for kind, sign in [("exact", 0), *((kind, sign) for kind in args.kinds for sign in (1, -1))]:

            def wrong(rig: StereoRig, kind: str = kind, sign: int = sign) -> StereoRig:
                return KINDS[kind](rig, sign) if sign else rig

            corrected, ate, similar, nees = run(path, wrong, Config(), args.frames)
            blind = run(path, wrong, Config(rig=RigConfig(exact=True)), args.frames)[3] if args.blind else None
            numbers = [f"{x:.3g}" if x is not None else "–" for x in (corrected, ate, similar, nees, blind)]
            table.add_row(f"{kind} {'+' if sign > 0 else '−' if sign else ''}", *numbers)
        Console().print(table)


if __name__ == "__main__":
    main()
