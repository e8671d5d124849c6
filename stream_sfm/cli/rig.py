"""`stream-sfm refine` and `convert-calibration`: a refined calibration from recordings, and TOML from other tools."""

import re
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ..errors import ConfigError, ExitCode, RigError
from . import options

if TYPE_CHECKING:
    from ..run.refine import RefinedRig


def refine(
    *logs: options.Log,
    out: options.OutFile,
    calibration: options.Calibration = None,
    frames: options.Frames = options.Frames(),
    settings: options.Settings = options.Settings(),
    json: options.Json = False,
) -> int:
    """Refine the calibration of a rig from its recordings.

    Estimates from one log or several of the same cameras how their calibration errs, and writes the calibration with
    these errors, to be given to other commands with --calibration. Errors of the baseline cannot be seen: they scale
    everything alike.

    Args:
        logs: recordings of the same cameras
        out: the calibration to write (TOML)
        calibration: refine this calibration instead of the one in the logs
    """
    from ..files import write_whole
    from ..run import refine as run
    from .printing import print_json

    if not logs:
        raise ConfigError("LOG is missing: name recordings of the same cameras")
    options.protect([out], list(logs), calibration)
    config, selection = settings.read(), frames.selection()
    given = options.calibration_files(calibration)
    refined = run.calibrate(logs, config, selection, calibration=given)
    write_whole(out, refined.rig.to_toml().encode())
    found = _found(refined, logs, out)
    if json:
        print_json(found)
    else:
        for line in found["logs"]:
            print(f"{line['log']}: {line['text']}")
        print(f"written to {out}: give it to other commands with --calibration {out}")
    return ExitCode.DONE


def _found(refined: "RefinedRig", names: tuple[str, ...], out: str) -> dict[str, Any]:
    from ..camera.rectification import Rectifier
    from ..report.calibration_field import describe

    projection = Rectifier(refined.rig).projection
    logs = []
    for log, estimate in zip(names, refined.estimates, strict=True):
        told: dict[str, Any] = {"text": "no frame was tracked, so nothing was learnt"}
        if estimate is not None:
            told = describe(projection, estimate)
        logs.append({"log": log, **told})
    refinement = refined.rig.refinement
    numbers: dict[str, Any] = {}
    if refinement is not None:
        numbers = {"error_px": refinement.error_px.tolist(), "std_px": refinement.std_px.tolist()}
    if refined.rig.timing is not None:
        numbers["timing"] = asdict(refined.rig.timing)
    return {"out": out, **numbers, "logs": logs}


def convert_calibration(
    *files: Annotated[str, Parameter("FILE")],
    out: options.OutFile,
    size: Annotated[str | None, Parameter(group=options.CAMERAS, metavar="W×H")] = None,
    json: options.Json = False,
) -> int:
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
    from ..camera.rig import StereoRig, baseline_question
    from ..files import write_whole
    from ..inspection.overview import describe_rig
    from .printing import print_json, print_notes

    if not files:
        raise ConfigError("FILE is missing: name a calibration, or the files of left and right")
    options.protect([out], list(files))
    rig = StereoRig.from_calibration(files[0] if len(files) == 1 else list(files), _size(size))
    write_whole(out, rig.to_toml().encode())
    questions = list(filter(None, [baseline_question(rig)]))
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
    return ExitCode.DONE


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    if (found := re.fullmatch(r"(\d{1,6})\s*[x×,]\s*(\d{1,6})", text)) is None:
        raise ConfigError(f"the size {text!r} is not a width and a height: write it as 1241x376")
    return int(found[1]), int(found[2])
