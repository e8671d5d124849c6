"""Estimates live, with a display: from two OpenCV cameras, from video, or from two folders that are being filled.

    python examples/live.py calibration.toml --cameras 0 1
    python examples/live.py calibration.toml --videos left.mp4 right.mp4
    python examples/live.py calibration.toml --video side_by_side.mkv --rrd run.rrd --no-view
    python examples/live.py calibration.toml --folders left right --no-view --out run

In folders, an image and its partner have the same name, and names are in the order of time. Ctrl-C ends the run.
A frame that cannot be used, such as one whose stamp goes backwards, is reported and left out.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import cv2
import numpy as np

import stream_sfm as sfm


def opened(given: int | str) -> cv2.VideoCapture:
    """A camera by its number, or a video by its path."""
    capture = cv2.VideoCapture(given)
    if not capture.isOpened():
        raise SystemExit(f"{'camera' if isinstance(given, int) else 'video'} {given} cannot be opened")
    return capture


def from_captures(captures: list[cv2.VideoCapture], live: bool) -> Iterator[sfm.StereoFrame]:
    """Yield frames, grabbed together, until one capture delivers nothing more; one alone holds both images.

    `live`: stamped by the clock, otherwise by the video.
    """
    try:
        while all([capture.grab() for capture in captures]):
            stamp_ns = time.time_ns() if live else round(captures[0].get(cv2.CAP_PROP_POS_MSEC) * 1e6)
            images = [np.asarray(image, np.uint8) for good, image in (c.retrieve() for c in captures) if good]
            if len(images) < len(captures):
                continue  # grabbed, but not decodable
            left, right = images if len(images) == 2 else np.array_split(images[0], 2, axis=1)
            yield sfm.StereoFrame(stamp_ns, left, right)
    finally:
        for capture in captures:
            capture.release()


def from_folders(left: Path, right: Path, timeout_s: float) -> Iterator[sfm.StereoFrame]:
    """Yield frames as their images appear, until none has appeared for `timeout_s`."""
    last, since_s = "", time.monotonic()
    while time.monotonic() - since_s < timeout_s:
        for name in sorted(p.name for p in left.iterdir() if p.name > last and (right / p.name).exists()):
            images = [cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED) for folder in (left, right)]
            if images[0] is None or images[1] is None:
                break  # still being written
            last, since_s = name, time.monotonic()
            yield sfm.StereoFrame(time.time_ns(), np.asarray(images[0], np.uint8), np.asarray(images[1], np.uint8))
        time.sleep(0.01)


def parsed() -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("calibration")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--cameras", nargs=2, type=int, metavar=("LEFT", "RIGHT"))
    source.add_argument("--videos", nargs=2, metavar=("LEFT", "RIGHT"))
    source.add_argument("--video", nargs=1, metavar="FILE", help="one that holds both images side by side")
    source.add_argument("--folders", nargs=2, type=Path, metavar=("LEFT", "RIGHT"))
    parser.add_argument(
        "--timeout", type=float, default=10.0, metavar="S", help="of folders: seconds without an image"
    )
    parser.add_argument("--rrd", metavar="FILE", help="write what is shown to this file")
    parser.add_argument("--no-view", action="store_true", help="open no window")
    parser.add_argument("--out", metavar="DIR", help="write the results of the run to this folder")
    return parser.parse_args()


def run(args: argparse.Namespace) -> int:
    """Step the engine with each frame, show and keep the estimates; the number of frames."""
    rig = sfm.StereoRig.from_calibration(args.calibration)
    engine, count = sfm.Engine(rig), 0
    with ExitStack() as stack:  # whatever ends the run, viewer and files are closed
        sinks: list[sfm.Sink] = []
        if args.rrd or not args.no_view:
            sinks.append(stack.enter_context(closing(sfm.open_viewer(rig, args.rrd, view=not args.no_view))))
        if args.out:
            sinks.append(stack.enter_context(sfm.ResultFolder(args.out, rig, engine.config)))
        if args.folders:
            frames = from_folders(args.folders[0], args.folders[1], args.timeout)
        else:
            captures = [opened(given) for given in args.cameras or args.videos or args.video]
            frames = from_captures(captures, live=bool(args.cameras))
        try:
            for frame in frames:
                try:
                    estimate = engine.step(frame)
                except sfm.FrameError as error:
                    print(f"\nleft out: {error}", file=sys.stderr)
                    continue
                for sink in sinks:
                    sink.write(estimate, frame)
                x, y, z = estimate.world_from_cam[:3, 3]
                print(f"\r{estimate.status:12} x {x:8.3f}  y {y:8.3f}  z {z:8.3f} m", end="")
                count += 1
        except KeyboardInterrupt:
            pass
    return count


def main() -> None:
    """Run, and say what prevents it in one sentence."""
    try:
        print(f"\n{run(parsed())} frames")
    except sfm.StreamSfmError as error:
        raise SystemExit(f"error: {error}") from None


if __name__ == "__main__":
    main()
