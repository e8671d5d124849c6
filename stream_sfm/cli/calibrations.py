"""`stream-sfm refine` and `convert-calibration`: calibrations as TOML, from recordings and from other tools."""

from collections.abc import Sequence
from typing import Annotated, Any

from ..errors import RigError
from . import options
from .printing import number, print_json, print_notes, print_table
from .tables import Parameter


def refine(
    *logs: options.Log,
    out: options.OutFile,
    calibration: options.Calibration = None,
    frames: options.Frames = options.Frames(),
    settings: options.Settings = options.Settings(),
    json: options.Json = False,
) -> None:
    """Refine the calibration of a rig from its recordings.

    Estimates the errors of a calibration from one or more logs of the same cameras. Rows that differ turn the right
    camera, a certain focal length goes into K, and errors of disparity and lenses are written if frames that they were
    not made from become better: other logs, or the other half of a single one. Delay and readout are written if they
    are certain. The logs are replayed with and without the result, and what makes them worse is refused, with the
    reason. Other commands read the result with --calibration. Images cannot show an error of the baseline, because it
    scales everything alike. An IMU can: then the baseline, and the clock and the axes of the IMU, are corrected if the
    correction is certain.

    Args:
        logs: recordings of the same cameras
        out: the calibration to write (TOML)
        calibration: refine this calibration instead of the one in the logs
    """
    from ..run import refine as run
    from ..system.files import write_whole

    options.at_least_one(logs, "LOG", "recordings of the same cameras")
    options.protect([out], list(logs), calibration)
    given = options.calibration_files(calibration)
    refined = run.refine(logs, settings.read(), frames.selection(), calibration=given)
    write_whole(out, refined.rig.to_toml().encode())
    found: list[dict[str, Any]] = [
        {"log": log, "without": before.figures(), "with": after.figures(), "imu": list(of_unit)}
        for log, before, after, of_unit in zip(logs, refined.before, refined.after, refined.of_unit, strict=True)
    ]
    if json:
        print_json({"out": out, "notes": list(refined.notes), "logs": found})
        return
    _print(found, refined.notes, out)


def _print(found: list[dict[str, Any]], notes: Sequence[str], out: str) -> None:
    """Print the notes, the figures of each log without and with the result, and the verdict on it."""
    print("\n".join([*notes, *(f"{of['log']}: {'; '.join(of['imu'])}" for of in found if of["imu"])]))
    headings = [
        "log",
        "calibration",
        "good frames",
        "rows\npx",
        "disparity,\nfurther px",
        "σ of the end\nm",
        "ATE\nm",
    ]
    rows = [[of["log"], name, *_cells(of[name])] for of in found for name in ("without", "with")]
    print_table(rows, headings, text_columns=2)
    print(f"written to {out}: give it to other commands with --calibration {out}")
    for of in found:
        log = f" of {of['log']}" if len(found) > 1 else ""
        print(f"calibration{log}: {of['with']['text']}")


def _cells(figures: dict[str, Any]) -> list[str]:
    """Return the cells of a row: what a replay has found, and how well it went."""
    found = (figures["rows_rms_px"], figures["disparity_further_px"])
    return [
        f"{figures['ok']} of {figures['frames']}",
        *(number(value, ".2f") for value in found),
        *(number(figures[key], ".3g") for key in ("std_position_m", "ate_rmse_aligned_m")),
    ]


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
    from ..inspection.overview import describe_rig
    from ..system.files import write_whole

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
