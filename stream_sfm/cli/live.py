"""`stream-sfm live`: a stereo camera in, and what a replay writes out, while it happens."""

from contextlib import closing
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..errors import ExitCode
from . import options
from .replay import print_result, viewers


def live(
    camera: Annotated[str, Parameter("CAMERA")],
    right: Annotated[str | None, Parameter("RIGHT")] = None,
    /,
    *,
    out: options.MaybeFolder = None,
    record: options.MaybeOutFile = None,
    rrd: options.MaybeOutFile = None,
    view: options.ResultFlag = False,
    calibration: options.Calibration = None,
    max_frames: options.MaybeCount = None,
    settings: options.MethodSettings = options.MethodSettings(),
    json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> int:
    """Estimate the camera's motion and the local structure live, until Ctrl-C.

    Cameras: realsense, oak or zed, with the calibration of their factory; or for OpenCV the number, device file or
    address of one camera that gives both images beside or above each other, or two of them, left and right. Ctrl-C ends
    after the current frame, and all files are finished. Pictures that come faster than they are estimated are left out
    of the estimates, not of the recording.

    Args:
        camera: realsense, oak, zed, or a camera of OpenCV such as 0
        right: the right camera, where it is another one
        out: result folder as of a replay; runs/CAMERA-TIME if not given
        record: write a log of every picture, for later replays
        rrd: write a recording for the Rerun viewer
        view: show the run in a Rerun window
        calibration: of the pair, instead of the factory's: a file, the files of left and right, or their folder
        max_frames: end after N frames
        verbose: report every change of status, and the time per stage
    """
    from ..recording.stereo_log import open_camera
    from ..results.folder import changed_results, new_run_folder, point_latest_to
    from ..run import replay as run
    from ..types import Selection
    from .progress import frame_progress

    names = [camera] if right is None else [camera, right]
    config = settings.read()
    folder = Path(out) if out else new_run_folder("-".join(name.rsplit("/", 1)[-1] for name in names))
    outputs = [record, rrd, *changed_results(folder, config)]
    options.protect(outputs, settings.config, calibration)
    given = options.calibration_files(calibration)
    interrupted = False
    with closing(open_camera(*names, calibration=given, record=record)) as log:
        shown = viewers(log, config.mono, rrd, view)
        try:
            with frame_progress("live", max_frames, quiet, verbose) as progress:
                result = run.replay(log, folder, config, Selection(max_frames=max_frames), sinks=[*shown, progress])
        except run.ReplayInterrupted as stop:
            result, interrupted = stop.result, True
    if not out and folder.exists():
        point_latest_to(folder)
    print_result(result, json, quiet, verbose)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.INPUT if result.problems or not result.summary["complete"] else ExitCode.DONE
