"""`stream-sfm refine`: a refined calibration from recordings."""

from ..errors import ConfigError
from . import options


def refine(
    *logs: options.Log,
    out: options.OutFile,
    calibration: options.Calibration = None,
    frames: options.Frames = options.Frames(),
    settings: options.Settings = options.Settings(),
    json: options.Json = False,
) -> None:
    """Refine the calibration of a rig from its recordings.

    Estimates from one log or several of the same cameras how their calibration errs, and writes the calibration with
    these errors, and with delay and readout where they are certain, to be given to other commands with --calibration.
    Errors of the baseline cannot be seen: they scale everything alike.

    Args:
        logs: recordings of the same cameras
        out: the calibration to write (TOML)
        calibration: refine this calibration instead of the one in the logs
    """
    from ..camera.rectification import Rectifier
    from ..files import write_whole
    from ..report.calibration_field import describe
    from ..run import refine as run
    from .printing import print_json

    if not logs:
        raise ConfigError("LOG is missing: name recordings of the same cameras")
    options.protect([out], list(logs), calibration)
    given = options.calibration_files(calibration)
    refined = run.refine(logs, settings.read(), frames.selection(), calibration=given)
    write_whole(out, refined.rig.to_toml().encode())
    projection = Rectifier(refined.rig).projection
    nothing = {"text": "no frame was tracked, so nothing was learnt"}
    told = [nothing if e is None else describe(projection, e) for e in refined.estimates]
    if json:
        print_json({"out": out, "logs": [{"log": log, **of_log} for log, of_log in zip(logs, told, strict=True)]})
    else:
        for log, of_log in zip(logs, told, strict=True):
            print(f"{log}: {of_log['text']}")
        print(f"written to {out}: give it to other commands with --calibration {out}")
