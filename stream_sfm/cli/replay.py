"""`stream-sfm replay` and `stream-sfm live`: a log or a camera in, a folder of results out."""

import os
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ..errors import ExitCode
from . import options
from .printing import print_error, print_json, print_notes

if TYPE_CHECKING:
    from ..config import Config
    from ..recording.stereo_log import StereoLog
    from ..run.replay import ReplayResult


def replay(
    log: options.Recording,
    /,
    *,
    out: options.MaybeFolder = None,
    rrd: options.ResultFile = None,
    view: options.ResultFlag = False,
    strict: options.ResultFlag = False,
    self_test: options.ResultFlag = False,
    loops: options.ResultFlag = False,
    map: options.ResultFile = None,
    save_map: options.ResultFile = None,
    cameras: options.Cameras = options.Cameras(),
    mono: options.CameraFlag = False,
    frames: options.Frames = options.Frames(),
    settings: options.Settings = options.Settings(),
    method: options.MethodName = None,
    truth: Annotated[options.TruthFile, Parameter(show=False)] = options.TruthFile(),
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
    """
    from ..outputs import MAP_TRAJECTORY
    from ..recording.stereo_log import open_log

    config, selection = settings.read(method=method, mono=mono), frames.selection()
    inputs = (log, truth.ground_truth, settings.config, cameras.calibration)
    run = _Run("replay", log, out, config, quiet, verbose, json, strict)
    run.protect([rrd, run.folder / MAP_TRAJECTORY], *inputs, map)
    options.protect([save_map], *inputs)
    recording = open_log(log, *cameras.chosen, mono=config.mono, ground_truth=truth.read())
    known = {"selection": selection, "self_test": self_test, "loops": loops, "known_map": map, "save_map": save_map}
    return run(recording, selection.count(recording.expected_frames), rrd, view, **known)


def live(
    camera: Annotated[str, Parameter("CAMERA")],
    right: Annotated[str | None, Parameter("RIGHT")] = None,
    /,
    *,
    out: options.MaybeFolder = None,
    record: options.ResultFile = None,
    rrd: options.ResultFile = None,
    view: options.ResultFlag = False,
    calibration: options.Calibration = None,
    max_frames: options.MaybeCount = None,
    settings: options.Settings = options.Settings(),
    method: options.MethodName = None,
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
    """
    from ..recording.stereo_log import open_camera
    from ..types import Selection

    names = [camera] if right is None else [camera, right]
    name = "-".join(name.rsplit("/", 1)[-1] for name in names)
    run = _Run("live", name, out, settings.read(method=method), quiet, verbose, json)
    run.protect([record, rrd], settings.config, calibration)
    given = options.calibration_files(calibration)
    with closing(open_camera(*names, calibration=given, record=record)) as log:
        return run(log, max_frames, rrd, view, selection=Selection(max_frames=max_frames))


class _Run:
    """One run into the folder `out`, or a new one named after what it is of, and what is printed about it."""

    def __init__(
        self,
        label: str,
        name: str,
        out: str | None,
        config: "Config",
        quiet: bool,
        verbose: bool,
        json: bool,
        strict: bool = False,
    ) -> None:
        from ..results.folder import new_run_folder

        self.folder = Path(out) if out else new_run_folder(name)
        self._label, self._is_latest, self._config = label, not out, config
        self._quiet, self._verbose, self._json, self._strict = quiet, verbose, json, strict

    def protect(self, outputs: Sequence[str | Path | None], *inputs: str | list[str] | None) -> None:
        """Raise an OutputError where one of the outputs, or a file of the folder, is an input."""
        from ..results.folder import changed_results

        options.protect([*outputs, *changed_results(self.folder, self._config)], *inputs)

    def __call__(self, log: "StereoLog", total: int | None, rrd: str | None, view: bool, **known: Any) -> int:
        """Estimate `total` frames of a log (None: unknown), and return the exit code; `known`: options of `replay`."""
        from ..results.folder import point_latest_to
        from ..run import replay as run
        from .progress import frame_progress

        viewers = []
        if rrd or view:
            from ..viewer import open_viewer

            truth = None if self._config.mono else log.ground_truth()
            viewers.append(open_viewer(log.rig, rrd, view, truth, log.path.stem))
        interrupted = False
        try:
            with frame_progress(self._label, total, self._quiet, self._verbose) as progress:
                result = run.replay(log, self.folder, self._config, sinks=[*viewers, progress], **known)
        except run.ReplayInterrupted as stop:
            result, interrupted = stop.result, True
        finally:
            if self._is_latest and os.path.exists(self.folder):
                point_latest_to(self.folder)
        self._print(result)
        if interrupted:
            return ExitCode.INTERRUPTED
        summary = result.summary
        wanting = result.problems or not summary["complete"] or (self._strict and summary["warnings"])
        return ExitCode.INPUT if wanting else ExitCode.DONE

    def _print(self, result: "ReplayResult") -> None:
        if not self._quiet or not result.summary["complete"]:
            print_notes("warning", result.summary["warnings"])
        if self._json:
            print_json({**result.summary, "out": str(result.out_dir)})
        elif not self._quiet:
            from .summaries import print_summary

            print_summary(result.summary, result.out_dir, stages=self._verbose)
        for problem in result.problems:
            print_error(problem)
