"""`stream-sfm import`: data sets, folders of images and videos to a log."""

import argparse
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode
from . import arguments

if TYPE_CHECKING:
    from ..importers import Imported


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "import",
        None,
        summary="convert a KITTI or EuRoC recording, folders of images, or video, to a log",
        description="Write a log (MCAP) that `replay`, Foxglove and Rerun read. Image files are copied unchanged.",
        usage="KIND ... OUT.mcap [options]",
    )
    kinds = parser.add_subparsers(title="kinds", metavar="KIND", dest="kind", required=True)
    _add_kitti(kinds)
    _add_euroc(kinds)
    _add_images(kinds)
    _add_video(kinds)
    arguments.add_general(parser)


def _add_kitti(kinds: Any) -> None:
    parser = arguments.add_command(
        kinds,
        "kitti",
        _kitti,
        summary="one sequence of KITTI odometry",
        description="Convert one sequence of the KITTI odometry benchmark.",
        usage="DIR OUT.mcap [options]",
        parent="import",
    )
    parser.add_argument(
        "folder", metavar="DIR", help="the sequence, with calib.txt, times.txt, image_0 and image_1"
    )
    _add_out(parser)
    parser.add_argument_group("ground truth").add_argument(
        "--poses", metavar="FILE", help="poses, 12 numbers per line (default: poses/SEQUENCE.txt beside sequences/)"
    )
    _add_general(parser)


def _add_euroc(kinds: Any) -> None:
    parser = arguments.add_command(
        kinds,
        "euroc",
        _euroc,
        summary="one EuRoC recording",
        description="Convert one recording in the format of the EuRoC MAV data set.",
        usage="DIR OUT.mcap [options]",
        parent="import",
    )
    parser.add_argument("folder", metavar="DIR", help="the folder mav0, or the folder that contains it")
    _add_out(parser)
    _add_general(parser)


def _add_images(kinds: Any) -> None:
    parser = arguments.add_command(
        kinds,
        "images",
        _images,
        summary="two sets of image files with a calibration",
        description="Convert left and right image files, paired in the order of their names. FILES is a folder, a "
        "glob such as 'left/*.png', or several files.",
        usage="--left FILES --right FILES --calibration FILE OUT.mcap [options]",
        parent="import",
    )
    _add_out(parser)
    group = parser.add_argument_group("images")
    group.add_argument("--left", metavar="FILES", nargs="+", required=True, help="the left images")
    group.add_argument("--right", metavar="FILES", nargs="+", required=True, help="the right images")
    _add_calibration(group)
    group.add_argument("--stamps", metavar="FILE", help="one time stamp per line: seconds, or integer nanoseconds")
    group.add_argument(
        "--rate", dest="rate_hz", metavar="HZ", type=float, help="frames per second without stamps (default: 10)"
    )
    _add_general(parser)


def _add_video(kinds: Any) -> None:
    parser = arguments.add_command(
        kinds,
        "video",
        _video,
        summary="two videos, or one that holds both images, with a calibration",
        description="Convert stereo video, whatever OpenCV decodes: one file per camera, or one file whose frames hold "
        "both images, side by side or one above the other. The images are written as grey PNG.",
        usage="(--left FILE --right FILE | --both FILE) --calibration FILE OUT.mcap [options]",
        parent="import",
    )
    _add_out(parser)
    group = parser.add_argument_group("video")
    group.add_argument("--left", metavar="FILE", help="the video of the left camera")
    group.add_argument("--right", metavar="FILE", help="the video of the right camera")
    group.add_argument("--both", metavar="FILE", help="one video that holds both images")
    group.add_argument(
        "--layout",
        choices=("left-right", "right-left", "top-bottom", "bottom-top"),
        help="which image is where in the frames of --both (default: left-right or top-bottom, by the calibrated size)",
    )
    _add_calibration(group)
    group.add_argument(
        "--rate",
        dest="rate_hz",
        metavar="HZ",
        type=float,
        help="frames per second (default: the times that the file has)",
    )
    _add_general(parser)


def _add_calibration(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--calibration",
        action=arguments.OneOrTwo,
        metavar="FILE",
        required=True,
        help="the calibration of the pair: a file, the files of left and right, or their folder",
    )


def _add_out(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", metavar="OUT.mcap", help="the log to write")
    result = parser.add_argument_group("result")
    result.add_argument("--force", dest="overwrite", action="store_true", help="replace OUT.mcap if it exists")


def _add_general(parser: argparse.ArgumentParser) -> None:
    arguments.add_general(parser, json="what was imported, as one JSON object,")


def _kitti(args: argparse.Namespace) -> int:
    from ..importers import import_kitti

    return _report(import_kitti(args.folder, args.out, args.poses, overwrite=args.overwrite), args)


def _euroc(args: argparse.Namespace) -> int:
    from ..importers import import_euroc

    return _report(import_euroc(args.folder, args.out, overwrite=args.overwrite), args)


def _images(args: argparse.Namespace) -> int:
    from ..importers import import_images

    files = (args.left, args.right, args.calibration, args.out, args.stamps, args.rate_hz)
    return _report(import_images(*files, overwrite=args.overwrite), args)


def _video(args: argparse.Namespace) -> int:
    from ..errors import ConfigError
    from ..importers import import_video

    pair = [name for name in (args.left, args.right) if name is not None]
    if bool(args.both) == bool(pair) or len(pair) == 1:
        raise ConfigError("give the video of each camera (--left, --right), or one that holds both images (--both)")
    videos = [args.both] if args.both else pair
    done = import_video(videos, args.calibration, args.out, args.rate_hz, args.layout, overwrite=args.overwrite)
    return _report(done, args)


def _report(imported: "Imported", args: argparse.Namespace) -> int:
    from ..wording import printable
    from .printing import print_json, print_notes

    print_notes("warning", imported.warnings)
    if args.json:
        numbers = {"left": imported.left, "right": imported.right, "poses": imported.poses}
        print_json({"out": str(imported.path), **numbers, "warnings": imported.warnings})
    else:
        counts = f"{imported.left} left and {imported.right} right images, {imported.poses} poses"
        print(f"{printable(str(imported.path))}: {counts}")
    return ExitCode.DONE
