"""`stream-sfm import`: data sets and folders of images to a log."""

import argparse
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode

if TYPE_CHECKING:
    from ..importers import Imported


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "import",
        help="make a log of a KITTI or EuRoC recording, or of folders of images",
        description="Write a log (MCAP) that replay, Foxglove and Rerun read. Image bytes are kept as they are.",
    )
    kinds = parser.add_subparsers(title="kinds", metavar="KIND", dest="kind", required=True)
    kitti = kinds.add_parser("kitti", help="one sequence of KITTI odometry")
    kitti.add_argument("folder", metavar="DIR", help="with calib.txt, times.txt, image_0 and image_1")
    kitti.add_argument("out", metavar="OUT.mcap")
    kitti.add_argument(
        "--poses", metavar="FILE", help="ground truth, 12 numbers a row (found by itself in its usual place)"
    )
    kitti.set_defaults(run=_kitti)
    euroc = kinds.add_parser("euroc", help="one EuRoC recording")
    euroc.add_argument("folder", metavar="DIR", help="mav0, or the folder that holds it")
    euroc.add_argument("out", metavar="OUT.mcap")
    euroc.set_defaults(run=_euroc)
    images = kinds.add_parser("images", help="two sets of image files and a calibration")
    images.add_argument(
        "--left", metavar="GLOB", nargs="+", required=True, help="the left images: a glob, a folder, or files"
    )
    images.add_argument("--right", metavar="GLOB", nargs="+", required=True, help="the right images")
    images.add_argument("--calibration", metavar="FILE", required=True, help="calibration of the pair (TOML)")
    images.add_argument("--stamps", metavar="FILE", help="one time a line: seconds, or whole nanoseconds")
    images.add_argument(
        "--rate", metavar="HZ", type=float, default=10.0, help="frames a second without --stamps (10)"
    )
    images.add_argument("out", metavar="OUT.mcap")
    images.set_defaults(run=_images)
    for kind in (kitti, euroc, images):
        kind.add_argument("--json", action="store_true", help="print one JSON object, nothing else")


def _kitti(args: argparse.Namespace) -> int:
    from ..importers import import_kitti

    return _tell(import_kitti(args.folder, args.out, args.poses), args)


def _euroc(args: argparse.Namespace) -> int:
    from ..importers import import_euroc

    return _tell(import_euroc(args.folder, args.out), args)


def _images(args: argparse.Namespace) -> int:
    from ..importers import import_images

    found = import_images(args.left, args.right, args.calibration, args.out, args.stamps, args.rate)
    return _tell(found, args)


def _tell(imported: "Imported", args: argparse.Namespace) -> int:
    from . import output

    output.print_notes("warning", imported.warnings)
    if args.json:
        counts = {"left": imported.left, "right": imported.right, "poses": imported.poses}
        output.print_json({"out": str(imported.path), **counts, "warnings": imported.warnings})
    else:
        print(f"{imported.path}: {imported.left} left and {imported.right} right images, {imported.poses} poses")
    return ExitCode.DONE
