"""A sink of your own: note where the pose is too uncertain to drive by.

    python examples/custom_sink.py logs/room.mcap --limit 0.002

A sink is anything with `write` and `close`. `replay` gives it every estimate with its frame; a live program calls
`write` itself, after `Engine.step`.
"""

import argparse

import numpy as np

import stream_sfm as sfm


class UncertaintyGuard:
    """Keeps the stamps of the frames whose position is uncertain by more than `limit_m` (σ of the worst direction)."""

    def __init__(self, limit_m: float) -> None:
        self.limit_m = limit_m
        self.too_uncertain_ns: list[int] = []

    def write(self, estimate: sfm.FrameEstimate, frame: sfm.StereoFrame | sfm.MonoFrame) -> None:
        """Judge one estimate; its `frame`, with the images, is not needed here."""
        worst_sigma_m = np.sqrt(np.linalg.eigvalsh(estimate.cov_pose[:3, :3])[-1])
        if estimate.status == sfm.Status.LOST or worst_sigma_m > self.limit_m:
            self.too_uncertain_ns.append(estimate.stamp_ns)

    def close(self) -> None:
        """Report; called once, also where the run ends early."""
        print(f"{len(self.too_uncertain_ns)} frames with σ above {1e3 * self.limit_m:g} mm, or lost")


def main() -> None:
    """Replay a log into the sink alone; no files are written."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log")
    parser.add_argument("--limit", type=float, default=0.002, metavar="M", help="metres (0.002)")
    args = parser.parse_args()
    result = sfm.replay(args.log, sinks=[UncertaintyGuard(args.limit)])
    print(f"{len(result.trajectory)} frames in all")


if __name__ == "__main__":
    main()
