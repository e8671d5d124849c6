"""Your own sink: report frames whose velocity is too uncertain for driving.

    python examples/custom_sink.py logs/room.mcap --limit 0.02

A sink is anything with `write` and `close`. `replay` gives it every estimate with its frame; a live program calls
`write` itself, after `Engine.step`. The σ of a position grows with the path, as nothing corrects it, so an alarm on
it would never end; that of the velocity shows how well the camera sees now.
"""

import argparse

import numpy as np

import stream_sfm as sfm


class UncertaintyGuard:
    """Collects the stamps of frames whose velocity has a σ above `limit_m_s` in the worst direction."""

    def __init__(self, limit_m_s: float) -> None:
        self.limit_m_s = limit_m_s
        self.too_uncertain_ns: list[int] = []
        self._odometry: sfm.Odometry | None = None

    def write(self, estimate: sfm.FrameEstimate, frame: sfm.StereoFrame | sfm.MonoFrame) -> None:
        """Judge one estimate; its `frame`, with the images, is not needed here."""
        self._odometry = sfm.Odometry.after(self._odometry, estimate)
        cov = self._odometry.cov_twist
        if cov is None:  # the first frame has no velocity
            return
        worst_sigma_m_s = np.sqrt(np.linalg.eigvalsh(cov[:3, :3])[-1])
        if estimate.status == sfm.Status.LOST or worst_sigma_m_s > self.limit_m_s:
            self.too_uncertain_ns.append(estimate.stamp_ns)

    def close(self) -> None:
        """Report; called once, even if the run ends early."""
        print(f"{len(self.too_uncertain_ns)} frames with σ above {1e3 * self.limit_m_s:g} mm/s, or lost")


def main() -> None:
    """Replay a log into the sink alone; no files are written."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log")
    parser.add_argument("--limit", type=float, default=0.02, metavar="M/S", help="metres per second (0.02)")
    args = parser.parse_args()
    result = sfm.replay(args.log, sinks=[UncertaintyGuard(args.limit)])
    print(f"{len(result.trajectory)} frames in all")


if __name__ == "__main__":
    main()
