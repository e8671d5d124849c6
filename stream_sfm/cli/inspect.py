"""`stream-sfm inspect`: what a log contains, and whether it can be replayed."""

from ..errors import ExitCode, StreamSfmError
from . import options

_LOOK_FRAMES = 60  # some seconds, in which most cameras turn


def inspect(
    log: options.Recording, /, *, cameras: options.Cameras = options.Cameras(), json: options.Json = False
) -> int:
    """Show what a log contains and check whether it can be replayed.

    Shows the topics of a log, the stereo pair that would be used and why, frame rate, gaps and calibration, and checks
    the calibration against the images: rows of matched corners, and what the first frames tell about lenses, focal
    length, delay of the right camera and readout of the shutters. If a replay cannot work, the exit code is 3 and the
    output says what to change.
    """
    from ..inspection.overview import inspect_log
    from ..recording.stereo_log import open_log
    from ..run import replay
    from ..types import Selection
    from .inspection_tables import print_inspection
    from .printing import print_json

    found = inspect_log(log, *cameras.chosen)
    found["rig_errors"] = None
    if not found["problems"]:
        try:
            look = replay.replay(open_log(log, *cameras.chosen), selection=Selection(max_frames=_LOOK_FRAMES))
            found["rig_errors"] = look.summary.get("rig")
        except StreamSfmError as error:
            found["warnings"].append(f"the first frames cannot be estimated: {error}")
    if json:
        print_json(found)
    else:
        print_inspection(found)
    return ExitCode.INPUT if found["problems"] else ExitCode.DONE
