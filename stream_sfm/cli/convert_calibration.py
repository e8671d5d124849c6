"""`stream-sfm convert-calibration`: the calibration of another tool as TOML."""

import re
from typing import Annotated

from cyclopts import Parameter

from ..errors import ConfigError, RigError
from . import options


def convert_calibration(
    *files: Annotated[str, Parameter("FILE")],
    out: options.OutFile,
    size: Annotated[str | None, Parameter(group=options.CAMERAS, metavar="W×H")] = None,
    json: options.Json = False,
) -> None:
    """Convert the calibration of another tool to TOML.

    Recognises a calibration of Kalibr, ROS, EuRoC, KITTI or OpenCV by its content: a file, the files of the left and
    of the right camera, or the folder they are in. Wherever a calibration is given to another command, it need not be
    converted.

    Args:
        files: file or folder; the left camera's file first
        out: the calibration to write (TOML)
        size: size of the images in pixels, for formats that do not contain it
    """
    from ..camera.rectification import check_rectifiable
    from ..camera.rig import StereoRig, baseline_warnings
    from ..files import write_whole
    from ..inspection.overview import describe_rig
    from .printing import print_json, print_notes

    if not files:
        raise ConfigError("FILE is missing: name a calibration, or the files of left and right")
    options.protect([out], list(files))
    rig = StereoRig.from_calibration(files[0] if len(files) == 1 else list(files), _size(size))
    write_whole(out, rig.to_toml().encode())
    questions = baseline_warnings(rig)
    try:
        check_rectifiable(rig)
    except RigError as error:  # the file may be converted in order to be corrected
        questions.append(str(error))
    print_notes("warning", questions)
    if json:
        print_json({"out": out, **describe_rig(rig)})
    else:
        left = rig.left
        print(f"written to {out}: {left.width}×{left.height} pixels, baseline {rig.baseline_m:.4g} m")


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    if (found := re.fullmatch(r"(\d{1,6})\s*[x×,]\s*(\d{1,6})", text)) is None:
        raise ConfigError(f"the size {text!r} is not a width and a height: write it as 1241x376")
    return int(found[1]), int(found[2])
