"""`stream-sfm import`: data sets and folders of images to a log."""

from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from ..wording import printable
from . import options

if TYPE_CHECKING:
    from ..importers.data_sets import Imported

import_ = App(name="import", help_epilogue="")
import_.help = """Convert a KITTI or EuRoC recording, or folders of images, to a log.

Writes a log (MCAP) that `replay`, Foxglove and Rerun read. Image files are copied unchanged."""
Pair = Annotated[options.Calibration, Parameter(required=True)]
Files = Annotated[list[str], Parameter(consume_multiple=True, metavar="FILES")]
Rate = Annotated[float | None, Parameter("--rate", metavar="HZ")]


@import_.command
def kitti(
    folder: Annotated[str, Parameter("DIR")],
    out: options.NewLog,
    /,
    *,
    poses: options.MaybeFile = None,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Convert one sequence of the KITTI odometry benchmark.

    Args:
        folder: the sequence, with calib.txt, times.txt, image_0 and image_1
        poses: poses, 12 numbers per line; poses/SEQUENCE.txt beside sequences/ if not given
    """
    from ..importers.data_sets import import_kitti

    _report(import_kitti(folder, out, poses, overwrite=force), json)


@import_.command
def euroc(
    folder: Annotated[str, Parameter("DIR")],
    out: options.NewLog,
    /,
    *,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Convert one recording in the format of the EuRoC MAV data set.

    Args:
        folder: the folder mav0, or the folder that contains it
    """
    from ..importers.data_sets import import_euroc

    _report(import_euroc(folder, out, overwrite=force), json)


@import_.command
def images(
    out: options.NewLog,
    /,
    *,
    left: Files,
    right: Files,
    calibration: Pair,
    stamps: options.MaybeFile = None,
    rate: Rate = None,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Convert two sets of image files with a calibration.

    Left and right files are paired in the order of their names. FILES is a folder, a glob such as 'left/*.png', or
    several files.

    Args:
        left: the left images
        right: the right images
        calibration: the calibration of the pair: a file, the files of left and right, or their folder
        stamps: one time stamp per line: seconds, or integer nanoseconds
        rate: frames per second without stamps (10)
    """
    from ..importers.data_sets import import_images

    where = options.calibration_files(calibration)
    assert where is not None
    _report(import_images(left, right, where, out, stamps, rate, overwrite=force), json)


def _report(imported: "Imported", json: bool) -> None:
    from .printing import print_json, print_notes

    print_notes("warning", imported.warnings)
    if json:
        numbers = {"left": imported.left, "right": imported.right, "poses": imported.poses}
        print_json({"out": str(imported.path), **numbers, "warnings": imported.warnings})
    else:
        counts = f"{imported.left} left and {imported.right} right images, {imported.poses} poses"
        print(f"{printable(str(imported.path))}: {counts}")
