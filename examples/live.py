"""Estimates live, with a display: two OpenCV cameras, or two folders that are being filled.

    python tools/live_cameras.py calibration.toml --cameras 0 1
    python tools/live_cameras.py calibration.toml --folders left right [--rrd run.rrd] [--no-view]

In folders, an image and its partner have the same name, and names are in the order of time. Ctrl-C ends the run.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import stream_sfm as sfm

Frame = tuple[int, NDArray[np.uint8], NDArray[np.uint8]]


def from_cameras(left: int, right: int) -> Iterator[Frame]:
    """(stamp_ns, left, right) grey, grabbed together; ends when a camera gives nothing more."""
    cameras = [cv2.VideoCapture(index) for index in (left, right)]
    try:
        while all([camera.grab() for camera in cameras]):
            stamp_ns = time.time_ns()
            images = [camera.retrieve()[1] for camera in cameras]
            grey = [i if i.ndim == 2 else cv2.cvtColor(i, cv2.COLOR_BGR2GRAY) for i in images]
            yield stamp_ns, grey[0], grey[1]
    finally:
        for camera in cameras:
            camera.release()


def from_folders(left: Path, right: Path, patience_s: float) -> Iterator[Frame]:
    """(stamp_ns, left, right) of the pairs as they appear; ends when none has come for `patience_s`."""
    last, waited_since = "", time.monotonic()
    while time.monotonic() - waited_since < patience_s:
        for name in sorted(p.name for p in left.iterdir() if p.name > last and (right / p.name).exists()):
            images = [cv2.imread(str(side / name), cv2.IMREAD_GRAYSCALE) for side in (left, right)]
            if images[0] is None or images[1] is None:
                break  # still being written
            last, waited_since = name, time.monotonic()
            yield time.time_ns(), images[0], images[1]
        time.sleep(0.01)


def main() -> None:
    """Step the engine with each pair and show the estimate."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("calibration")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--cameras", nargs=2, type=int, metavar=("LEFT", "RIGHT"))
    source.add_argument("--folders", nargs=2, type=Path, metavar=("LEFT", "RIGHT"))
    parser.add_argument("--rrd", help="also write what is shown to this file")
    parser.add_argument("--no-view", action="store_true", help="no window")
    parser.add_argument("--patience", type=float, default=10.0, help="seconds without a new image that end the run")
    args = parser.parse_args()
    rig = sfm.StereoRig.from_calibration(args.calibration)
    engine = sfm.Engine(rig)
    viewer = sfm.open_viewer(rig, args.rrd, view=not args.no_view)
    frames = from_cameras(*args.cameras) if args.cameras else from_folders(*args.folders, args.patience)
    count = 0
    try:
        for stamp_ns, left, right in frames:
            frame = sfm.StereoFrame(stamp_ns, left, right)
            viewer.write(engine.step(frame), frame)
            count += 1
    except KeyboardInterrupt:
        pass
    finally:
        viewer.close()
    print(f"{count} frames")


if __name__ == "__main__":
    main()
