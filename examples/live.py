"""Live estimates in your own program, with a display: from a stereo camera, or from a log played as one.

    python examples/live.py realsense
    python examples/live.py 0 1 --calibration calibration.toml
    python examples/live.py logs/room.mcap --no-view --out run

`stream-sfm live` does the same, and more. Ctrl-C ends the run; files are finished however it ends.
"""

import argparse
import sys
from contextlib import ExitStack, closing
from pathlib import Path

import stream_sfm as sfm


def parsed() -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("camera", nargs="+", help="realsense, oak, zed, one or two cameras of OpenCV, or a log")
    parser.add_argument("--calibration", metavar="FILE")
    parser.add_argument("--rrd", metavar="FILE", help="write what is shown to this file")
    parser.add_argument("--no-view", action="store_true", help="open no window")
    parser.add_argument("--out", metavar="DIR", help="write the results of the run to this folder")
    parser.add_argument("--max-frames", type=int, metavar="N")
    return parser.parse_args()


def run(args: argparse.Namespace) -> int:
    """Step the engine with each frame, show and store the estimates; return the number of frames."""
    with ExitStack() as stack:  # whatever ends the run, camera, viewer and files are closed
        is_log = Path(args.camera[0]).exists() and not args.camera[0].startswith("/dev/")
        log = sfm.open_log(args.camera[0]) if is_log else sfm.open_camera(*args.camera, calibration=args.calibration)
        stack.enter_context(closing(log))
        engine, odometry, count = sfm.Engine(log.rig), None, 0
        sinks: list[sfm.Sink] = []
        if args.rrd or not args.no_view:
            sinks.append(stack.enter_context(closing(sfm.open_viewer(log.rig, args.rrd, view=not args.no_view))))
        if args.out:
            sinks.append(stack.enter_context(sfm.ResultFolder(args.out, log.rig, engine.config)))
        try:
            for frame in log.frames(sfm.Selection(max_frames=args.max_frames)):
                estimate = engine.step(frame)
                for sink in sinks:
                    sink.write(estimate, frame)
                odometry = sfm.Odometry.after(odometry, estimate)
                x, y, z = estimate.world_from_cam[:3, 3]
                speed_m_s = 0.0 if odometry.twist is None else float(sum(odometry.twist[:3] ** 2) ** 0.5)
                print(f"\r{estimate.status:12} x {x:8.3f}  y {y:8.3f}  z {z:8.3f} m  {speed_m_s:6.3f} m/s", end="")
                count += 1
        except KeyboardInterrupt:
            pass
    return count


def main() -> None:
    """Run, or say in one sentence why that is impossible."""
    try:
        print(f"\n{run(parsed())} frames")
    except sfm.StreamSfmError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
