"""`stream-sfm import` and `stream-sfm recover`: data sets, image files and damaged files as valid logs."""

from typing import TYPE_CHECKING, Annotated

from ..errors import ExitCode
from ..system.wording import printable
from . import options
from .printing import print_json, print_notes
from .tables import Family, Parameter

if TYPE_CHECKING:
    from ..logs.importers import Imported

import_ = Family(
    "import",
    """Convert a KITTI or EuRoC recording, or folders of images, to a log.

Writes a log (MCAP) that `replay`, Foxglove and Rerun read. Image files are copied unchanged.""",
    [],
)
DataSet = Annotated[str, Parameter("DIR")]
Files = Annotated[list[str], Parameter(consume_multiple=True, metavar="FILES")]


@import_.command
def kitti(
    folder: DataSet,
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
    from ..logs.importers import import_kitti

    _report(import_kitti(folder, out, poses, overwrite=force), json)


@import_.command
def euroc(folder: DataSet, out: options.NewLog, /, *, force: options.Force = False, json: options.Json = False) -> None:
    """Convert one recording in the format of the EuRoC MAV data set.

    Args:
        folder: the folder mav0, or the folder that contains it
    """
    from ..logs.importers import import_euroc

    _report(import_euroc(folder, out, overwrite=force), json)


@import_.command
def images(
    out: options.NewLog,
    /,
    *,
    left: Files,
    right: Files,
    calibration: Annotated[options.Calibration, Parameter(required=True)],
    stamps: options.MaybeFile = None,
    rate: Annotated[float | None, Parameter(metavar="HZ")] = None,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Convert two sets of image files with a calibration.

    Left and right files are paired in the order of their names. FILES: a folder, a glob such as 'left/*.png', or files.

    Args:
        left: the left images
        right: the right images
        calibration: the calibration of the pair: a file, the files of left and right, or their folder
        stamps: one time stamp per line: seconds, or integer nanoseconds
        rate: frames per second without stamps (10)
    """
    from ..logs.importers import import_images

    where = options.calibration_files(calibration)
    assert where is not None
    _report(import_images(left, right, where, out, stamps, rate, overwrite=force), json)


def _report(imported: "Imported", json: bool) -> None:
    print_notes("warning", imported.warnings)
    if json:
        numbers = {"left": imported.left, "right": imported.right, "poses": imported.poses}
        print_json({"out": str(imported.path), **numbers, "warnings": imported.warnings})
    else:
        counts = f"{imported.left} left and {imported.right} right images, {imported.poses} poses"
        print(f"{printable(str(imported.path))}: {counts}")


def recover(
    log: options.Log,
    out: options.NewLog,
    /,
    *,
    force: options.Force = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Copy what can be read of a damaged MCAP file.

    Copies every readable message of all topics, with unchanged bytes, into a new MCAP file with an index, and
    reports what was lost. `replay` and the other commands read damaged logs directly; a recovered one is for other
    programs. If something was lost, the exit code is 3.

    Args:
        log: the damaged MCAP file
    """
    from ..logs.importers import recover as recover_file
    from .printing import print_table

    done = recover_file(log, out, overwrite=force)
    others = {"attachments": done.attachments, "metadata": done.metadata}
    if json:
        report = {"out": str(done.path), "complete": done.complete, "messages": done.messages}
        print_json(report | others | {"warnings": done.warnings})
    else:
        print_notes("warning", done.warnings)
        if not quiet:
            lost = "nothing was lost" if done.complete else "what was damaged is lost"
            print(printable(f"{done.path}: {sum(done.messages.values())} messages; {lost}"))
            records = {"attachments": done.attachments, "metadata records": done.metadata}
            counts = [*done.messages.items(), *((kind, count) for kind, count in records.items() if count)]
            print_table([(name, str(count)) for name, count in counts])
    return ExitCode.DONE if done.complete else ExitCode.INPUT
