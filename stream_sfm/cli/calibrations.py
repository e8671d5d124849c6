"""`stream-sfm refine` and `convert-calibration`: calibrations as TOML, from recordings and from other tools."""

from typing import Annotated

from cyclopts import Parameter

from ..errors import RigError
from . import options
from .printing import print_json, print_notes


def refine(
    *logs: options.Log,
    out: options.OutFile,
    calibration: options.Calibration = None,
    frames: options.Frames = options.Frames(),
    settings: options.Settings = options.Settings(),
    json: options.Json = False,
) -> None:
    """Refine the calibration of a rig from its recordings.

    Estimates the errors of a calibration from one or more logs of the same cameras. Writes a calibration with these
    errors, and with delay and readout if they are certain; other commands read it with --calibration. Images cannot
    show an error of the baseline, because it scales everything alike. An IMU can: then the baseline, and the clock
    and the axes of the IMU, are corrected if the correction is certain.

    Args:
        logs: recordings of the same cameras
        out: the calibration to write (TOML)
        calibration: refine this calibration instead of the one in the logs
    """
    from ..camera.rectification import Rectifier
    from ..files import write_whole
    from ..report.calibration import describe
    from ..run import refine as run

    options.at_least_one(logs, "LOG", "recordings of the same cameras")
    options.protect([out], list(logs), calibration)
    given = options.calibration_files(calibration)
    refined = run.refine(logs, settings.read(), frames.selection(), calibration=given)
    write_whole(out, refined.rig.to_toml().encode())
    projection = Rectifier(refined.rig).projection
    nothing = {"text": "no frame was tracked, so nothing was learnt"}
    found = [
        {"log": log, **(nothing if estimate is None else describe(projection, estimate)), "imu": list(of_unit)}
        for log, estimate, of_unit in zip(logs, refined.estimates, refined.of_unit, strict=True)
    ]
    if json:
        print_json({"out": out, "logs": found})
    else:
        for of_log in found:
            print("; ".join([f"{of_log['log']}: {of_log['text']}", *of_log["imu"]]))
        print(f"written to {out}: give it to other commands with --calibration {out}")


def convert_calibration(
    *files: Annotated[str, Parameter("FILE")],
    out: options.OutFile,
    size: options.MaybeSize = None,
    json: options.Json = False,
) -> None:
    """Convert the calibration of another tool to TOML.

    Recognises a calibration of Kalibr, ROS, EuRoC, KITTI, OpenCV, OAK, ZED and others by its content: a file, the
    files of the left and right camera, or their folder. Other commands also read them unconverted.

    Args:
        files: file or folder; the left camera's file first
        out: the calibration to write (TOML)
        size: size of the images in pixels, for formats that do not contain it
    """
    from ..camera.rectification import check_rectifiable
    from ..camera.rig import StereoRig, baseline_warnings
    from ..files import write_whole
    from ..inspection.overview import describe_rig

    options.at_least_one(files, "FILE", "a calibration, or the files of left and right")
    options.protect([out], list(files))
    rig = StereoRig.from_calibration(files[0] if len(files) == 1 else list(files), size)
    write_whole(out, rig.to_toml().encode())
    questions = baseline_warnings(rig)
    try:
        check_rectifiable(rig)
    except RigError as error:  # the file may be converted in order to correct it
        questions.append(str(error))
    print_notes("warning", questions)
    if json:
        print_json({"out": out, **describe_rig(rig)})
    else:
        left = rig.left
        print(f"written to {out}: {left.width}×{left.height} pixels, baseline {rig.baseline_m:.4g} m")
