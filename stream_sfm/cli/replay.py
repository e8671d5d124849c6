"""`stream-sfm replay` and `stream-sfm live`: a log or a camera in, a folder of results out."""

import os
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..errors import ExitCode
from ..system.wording import printable
from . import options
from .printing import print_error, print_json, print_notes
from .tables import Options, Parameter

if TYPE_CHECKING:
    from ..config import Config
    from ..logs.recording.stereo_log import StereoLog
    from ..run.replay import ReplayResult
    from ..types import Selection


@Parameter(name="*")
class _Shown(Options):
    """What a run shows and prints.

    Attributes:
        rrd: write a recording for the Rerun viewer
        view: show the run in a Rerun window
    """

    rrd: options.ResultFile = None
    view: options.ResultFlag = False
    json: options.Json = False
    quiet: options.Quiet = False
    verbose: options.Verbose = False


def replay(
    log: options.Recording,
    /,
    *,
    out: options.MaybeFolder = None,
    shown: _Shown = _Shown(),
    strict: options.ResultFlag = False,
    self_test: options.ResultFlag = False,
    there_and_back: options.ResultFlag = False,
    loops: options.ResultFlag = False,
    map: options.ResultFile = None,
    save_map: options.ResultFile = None,
    world: options.World = None,
    cameras: options.Cameras = options.Cameras(),
    mono: options.CameraFlag = False,
    frames: options.Frames = options.Frames(),
    settings: options.Settings = options.Settings(),
    method: options.MethodName = None,
    truth: Annotated[options.TruthFile, Parameter(show=False)] = options.TruthFile(),
    ground_truth_std: options.StdTruth = None,
) -> int:
    """Estimate the camera's motion and the local structure in every frame of a log.

    Estimates the pose of the left camera and the 3-D structure in front of it, with covariances, for every frame of a
    stereo log. Writes estimates.mcap (a ROS 2 bag, together with metadata.yaml), trajectory.tum, trajectory.kitti,
    trajectory.csv, summary.json and config.toml.

    Args:
        out: result folder; runs/LOG-TIME if not given
        strict: exit with code 3 if there was any warning
        self_test: check the covariances without ground truth: disjoint halves of the tracks and of the image must agree
        there_and_back: measure drift without ground truth: also estimate the way back, and compare the ends
        loops: close loops and write the corrected poses to trajectory_map.tum; needs the extra map
        map: continue in a map that --save-map wrote; implies --loops
        save_map: write the map at the end, even over the one that was read; implies --loops
        mono: use the left camera only; lengths are in units of the first baseline, not metres; needs the extra study
        ground_truth_std: σ of the ground truth itself, metres and radians; known for KITTI, EuRoC and TUM-VI
    """
    from ..logs.recording.stereo_log import open_log
    from ..results.folder import changed_results, new_run_folder
    from ..system.outputs import RESULTS, TRAJECTORIES

    config, selection = settings.read(method=method, mono=mono, world=world), frames.selection()
    inputs = (log, truth.ground_truth, settings.config, cameras.calibration)
    folder = Path(out) if out else new_run_folder(log)
    options.protect(
        [shown.rrd, *(folder / name for name in TRAJECTORIES), *changed_results(folder, config)], *inputs, map
    )
    options.protect([save_map], *inputs)
    options.protect([shown.rrd, save_map, *(folder / name for name in (*RESULTS, *TRAJECTORIES))])
    recording = open_log(log, **cameras.chosen, mono=config.mono, ground_truth=truth.read())
    known = {
        "self_test": self_test,
        "there_and_back": there_and_back,
        "loops": loops,
        "known_map": map,
        "save_map": save_map,
        "std_truth": ground_truth_std,
    }
    return _run("replay", recording, folder, config, selection, shown, is_latest=not out, strict=strict, **known)


def live(
    camera: Annotated[str, Parameter("CAMERA")],
    right: Annotated[str | None, Parameter("RIGHT")] = None,
    /,
    *,
    out: options.MaybeFolder = None,
    record: options.ResultFile = None,
    shown: _Shown = _Shown(),
    force: Annotated[bool, Parameter(group=options.RESULTS)] = False,
    calibration: options.Calibration = None,
    size: options.MaybeSize = None,
    rate: options.MaybePositive = None,
    world: options.World = None,
    serial: Annotated[str | None, Parameter(group=options.CAMERAS, metavar="NUMBER")] = None,
    exposure: Annotated[options.MaybePositive, Parameter(metavar="MS")] = None,
    max_frames: options.MaybeCount = None,
    settings: options.Settings = options.Settings(),
    method: options.MethodName = None,
) -> int:
    """Estimate the camera's motion and the local structure live, until Ctrl-C.

    Cameras: realsense, oak or zed, with their factory calibration; or, through OpenCV, the number, device file or
    address of one camera that delivers both images side by side or stacked, or of two cameras, left and right. A
    recording can stand in for a camera: its images come at the pace at which they were recorded. Ctrl-C ends the
    run after the current frame and completes all files. Images that arrive faster than they can be processed are
    skipped, but kept in the recording.

    Args:
        camera: realsense, oak, zed, a camera of OpenCV such as 0, or a recording
        right: the right camera, if it is a separate one
        out: result folder as of a replay; runs/CAMERA-TIME if not given
        record: write a log of every image, for later replays
        force: replace the file of --record if it exists
        calibration: a file, the files of left and right, or a folder, instead of the factory calibration
        size: size of each image, pixels
        rate: frames per second
        serial: serial number, to choose one of several cameras
        exposure: exposure time, milliseconds; automatic if not given
        max_frames: end after N frames
    """
    from ..logs.recording.stereo_log import open_camera
    from ..results.folder import changed_results, new_run_folder
    from ..types import Selection

    names = [camera] if right is None else [camera, right]
    name = "-".join(name.rsplit("/", 1)[-1] for name in names)
    config = settings.read(method=method, world=world)
    folder = Path(out) if out else new_run_folder(name)
    inputs = [name for name in names if os.path.isfile(name) or os.path.isdir(name)]
    options.protect([record, shown.rrd, *changed_results(folder, config)], settings.config, calibration, inputs)
    given = options.calibration_files(calibration)
    camera_log = open_camera(
        *names,
        calibration=given,
        record=record,
        overwrite=force,
        size=size,
        rate_hz=rate,
        serial=serial,
        exposure_ms=exposure,
    )
    with closing(camera_log) as log:
        return _run("live", log, folder, config, Selection(max_frames=max_frames), shown, is_latest=not out)


def _run(
    label: str,
    log: "StereoLog",
    folder: Path,
    config: "Config",
    selection: "Selection",
    shown: _Shown,
    *,
    is_latest: bool,
    strict: bool = False,
    **known: Any,
) -> int:
    """Estimate the selected frames of a log into a folder, print the summary, and return the exit code.

    `is_latest`: runs/latest shall lead there; `known`: options of `run.replay`.
    """
    from ..results.folder import point_latest_to
    from ..run import replay as run
    from .progress import frame_progress

    viewers = []
    if shown.rrd or shown.view:
        from ..camera.rig import masked_by
        from ..viewer import open_viewer

        truth = None if config.mono else log.ground_truth()
        viewers.append(open_viewer(masked_by(config, log.rig), shown.rrd, shown.view, truth, log.path.stem))
    interrupted = False
    try:
        total = selection.count(log.expected_frames)
        with frame_progress(label, total, shown.quiet, shown.verbose) as progress:
            result = run.replay(log, folder, config, selection, sinks=[*viewers, progress], **known)
    except run.ReplayInterrupted as stop:
        result, interrupted = stop.result, True
    finally:
        if is_latest and os.path.exists(folder):
            point_latest_to(folder)
    _print_result(result, folder, shown)
    if interrupted:
        return ExitCode.INTERRUPTED
    summary = result.summary
    wanting = result.problems or not summary["complete"] or (strict and summary["warnings"])
    return ExitCode.INPUT if wanting else ExitCode.DONE


def _print_result(result: "ReplayResult", folder: Path, shown: _Shown) -> None:
    """Print the summary of a replay, its warnings and its problems, each as far as asked for."""
    summary = result.summary
    if not shown.quiet or not summary["complete"]:
        print_notes("warning", summary["warnings"])
    if shown.json:
        print_json({**summary, "out": str(folder)})
    elif not shown.quiet:
        from .summaries import print_summary

        print_summary(summary, folder, stages=shown.verbose)
        if shown.rrd:
            from importlib.metadata import version

            page = f"https://app.rerun.io/version/{version('rerun-sdk')}"
            print(printable(f"`rerun {shown.rrd}` opens the recording; so does a browser, dragged to {page}"))
    for problem in result.problems:
        print_error(problem)
