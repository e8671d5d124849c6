"""Estimates live, with a display: from two OpenCV cameras, or from two folders that are being filled.

    python examples/live.py calibration.toml --cameras 0 1
    python examples/live.py calibration.toml --folders left right --rrd run.rrd --no-view

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

Image = NDArray[np.uint8]


def from_cameras(left: int, right: int) -> Iterator[sfm.StereoFrame]:
    """Yield grey frames, grabbed together, until a camera delivers nothing more."""
    cameras = [cv2.VideoCapture(index) for index in (left, right)]
    try:
        while all([camera.grab() for camera in cameras]):
            stamp_ns = time.time_ns()
            left_image, right_image = (grey(camera.retrieve()[1]) for camera in cameras)
            yield sfm.StereoFrame(stamp_ns, left_image, right_image)
    finally:
        for camera in cameras:
            camera.release()


def from_folders(left: Path, right: Path, timeout_s: float) -> Iterator[sfm.StereoFrame]:
    """Yield frames as their images appear, until none has appeared for `timeout_s`."""
    last, since_s = "", time.monotonic()
    while time.monotonic() - since_s < timeout_s:
        for name in sorted(p.name for p in left.iterdir() if p.name > last and (right / p.name).exists()):
            images = [cv2.imread(str(folder / name)) for folder in (left, right)]
            if images[0] is None or images[1] is None:
                break  # still being written
            last, since_s = name, time.monotonic()
            yield sfm.StereoFrame(time.time_ns(), grey(images[0]), grey(images[1]))
        time.sleep(0.01)


def grey(image: cv2.typing.MatLike) -> Image:
    """The image (h, w) uint8."""
    return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def main() -> None:
    """Step the engine with each frame and show the estimate."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("calibration")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--cameras", nargs=2, type=int, metavar=("LEFT", "RIGHT"))
    source.add_argument("--folders", nargs=2, type=Path, metavar=("LEFT", "RIGHT"))
    parser.add_argument(
        "--timeout", type=float, default=10.0, metavar="S", help="of folders: seconds without an image"
    )
    parser.add_argument("--rrd", metavar="FILE", help="write what is shown to this file")
    parser.add_argument("--no-view", action="store_true", help="open no window")
    args = parser.parse_args()

    rig = sfm.StereoRig.from_calibration(args.calibration)
    engine = sfm.Engine(rig)
    viewer = sfm.open_viewer(rig, args.rrd, view=not args.no_view)
    if args.cameras:
        frames = from_cameras(*args.cameras)
    else:
        frames = from_folders(args.folders[0], args.folders[1], args.timeout)
    count = 0
    try:
        for frame in frames:
            viewer.write(engine.step(frame), frame)
            count += 1
    except KeyboardInterrupt:
        pass
    finally:
        viewer.close()
    print(f"{count} frames")


if __name__ == "__main__":
    main()
