"""`stream-sfm replay`: a log in, a folder of results out."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..errors import ExitCode
from . import options
from .usage import print_error

if TYPE_CHECKING:
    from ..recording.stereo_log import StereoLog
    from ..run.replay import ReplayResult
    from ..types import Sink


def replay(
    log: options.Recording,
    /,
    *,
    out: options.MaybeFolder = None,
    rrd: options.MaybeOutFile = None,
    view: options.ResultFlag = False,
    strict: options.ResultFlag = False,
    self_test: options.ResultFlag = False,
    loops: options.ResultFlag = False,
    map: options.MaybeInFile = None,
    save_map: options.MaybeOutFile = None,
    cameras: options.Cameras = options.Cameras(),
    mono: options.CameraFlag = False,
    frames: options.Frames = options.Frames(),
    settings: options.MethodSettings = options.MethodSettings(),
    truth: Annotated[options.Truth, Parameter(show=False)] = options.Truth(),
    json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> int:
    """Estimate the camera's motion and the local structure in every frame of a log.

    Estimates the pose of the left camera and the 3-D structure in front of it, with covariances, for every frame of a
    stereo log. Writes estimates.mcap (with metadata.yaml a ROS 2 bag), trajectory.tum, trajectory.kitti,
    trajectory.csv, summary.json and config.toml.

    Args:
        out: result folder; runs/LOG-TIME if not given
        rrd: write a recording for the Rerun viewer
        view: show the run in a Rerun window
        strict: exit with code 3 if there was any warning
        self_test: check the covariances without any truth: disjoint halves of the tracks, and of the image, must agree
        loops: find places again and correct the poses, in trajectory_map.tum; needs the extra map
        map: go on in the world of a map that --save-map wrote; with the effect of --loops
        save_map: write the map at the end, which may be the one that was read; with the effect of --loops
        mono: use the left camera only; lengths are in units of the first baseline instead of metres
        verbose: report every change of status, and the time per stage
    """
    from ..outputs import MAP_TRAJECTORY
    from ..recording.stereo_log import open_log
    from ..results.folder import changed_results, new_run_folder, point_latest_to
    from ..run import replay as run
    from .progress import frame_progress

    config, selection = settings.read(*(["mono=true"] if mono else [])), frames.selection()
    folder = Path(out) if out else new_run_folder(log)
    options.protect(
        [rrd, folder / MAP_TRAJECTORY, *changed_results(folder, config)],
        log,
        truth.ground_truth,
        settings.config,
        cameras.calibration,
        map,
    )
    options.protect([save_map], log, truth.ground_truth, settings.config, cameras.calibration)
    recording = open_log(log, *cameras.chosen, mono=config.mono, ground_truth=truth.read())
    shown = viewers(recording, config.mono, rrd, view)
    total = selection.count(recording.expected_frames)
    interrupted = False
    try:
        with frame_progress("replay", total, quiet, verbose) as progress:
            result = run.replay(
                recording,
                folder,
                config,
                selection,
                ignore_ground_truth=truth.ignore_ground_truth,
                self_test=self_test,
                loops=loops,
                known_map=map,
                save_map=save_map,
                std_truth=truth.ground_truth_std,
                sinks=[*shown, progress],
            )
    except run.ReplayInterrupted as stop:
        result, interrupted = stop.result, True
    finally:
        if not out and os.path.exists(folder):
            point_latest_to(folder)
    print_result(result, json, quiet, verbose)
    if interrupted:
        return ExitCode.INTERRUPTED
    wanting = result.problems or not result.summary["complete"] or (strict and result.summary["warnings"])
    return ExitCode.INPUT if wanting else ExitCode.DONE


def viewers(log: "StereoLog", mono: bool, rrd: str | None, view: bool) -> "list[Sink]":
    """The viewer that was asked for, if any."""
    if not rrd and not view:
        return []
    from ..viewer import open_viewer

    return [open_viewer(log.rig, rrd, view, None if mono else log.ground_truth(), log.path.stem)]


def print_result(result: "ReplayResult", json: bool, quiet: bool, verbose: bool) -> None:
    if json or not quiet or not result.summary["complete"]:
        from .printing import print_json, print_notes

        if not quiet or not result.summary["complete"]:
            print_notes("warning", result.summary["warnings"])
        if json:
            print_json({**result.summary, "out": str(result.out_dir)})
        elif not quiet:
            from .summaries import print_summary

            print_summary(result.summary, result.out_dir, stages=verbose)
    for problem in result.problems:
        print_error(problem)
