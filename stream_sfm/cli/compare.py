"""`stream-sfm compare`: every method on the same observations, and the drift report of one log or of several."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ConfigError, ExitCode, InputError
from ..system.wording import printable
from . import options
from .printing import print_error, print_json, print_notes

if TYPE_CHECKING:
    from ..run.compare import ComparisonResult


def compare(
    *logs: options.Log,
    out: options.MaybeFolder = None,
    methods: options.Names = "",
    as_is: options.ResultFlag = False,
    self_test: options.ResultFlag = False,
    loops: options.ResultFlag = False,
    cameras: options.Cameras = options.Cameras(),
    frames: options.Frames = options.Frames(),
    truth: options.TruthFile = options.TruthFile(),
    errors: options.TruthErrors = options.TruthErrors(),
    settings: options.Settings = options.Settings(),
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Compare the drift of windows, EKFs and frame-to-frame estimation in an HTML report.

    Runs several methods on the same observations with the same covariances and the same calibration, which a first
    pass corrects: by default the cross-frame method (joint, per-point WC and per-point CC), EKFs (with plain weights
    and with those of lasting errors; iterated and camera-centred; linearised at a constant velocity; without
    cross-correlations) and frame-to-frame estimation. Another row is the cross-frame method as `replay` runs it, which
    finds the calibration on the way. Where the log has an IMU, the cross-frame method and EKFs use it, and the
    cross-frame method is also run without. Writes report.html (a single file), report.json, and one result folder per
    method, as `replay` does. Of several logs each has a folder with these files, and the page above them gives ratios
    of errors with intervals over logs: one path is one sample. Needs the extra study.

    Args:
        logs: recordings: MCAP, ROS bags, videos, or folders of data sets or of images
        out: result folder; runs/LOG-TIME if not given
        methods: the methods, separated by commas; without this option those above
        as_is: give each method the uncorrected calibration of the log; adds a row for the newest motions of cross-frame
        self_test: check the covariances without ground truth: disjoint halves of the tracks and of the image must agree
        loops: also show the first method with loops closed; needs the extra map
    """
    from ..results.folder import new_run_folder, point_latest_to
    from .summaries import print_comparison, print_over_logs

    options.at_least_one(logs, "LOG", "recordings")
    if len(logs) > 1 and truth.ground_truth is not None:
        raise ConfigError(f"{truth.ground_truth} has the true poses of one log: give one log")
    named = tuple(dict.fromkeys(filter(None, map(str.strip, methods.split(",")))))
    chosen = _Chosen(named, as_is, self_test, loops, cameras, frames, truth, errors, settings, quiet)
    folder, names = Path(out) if out else new_run_folder(logs[0]), _names(logs)
    results, problems = _all_compared(chosen, names, folder)
    if len(names) == 1:
        content, show = results[""].report, print_comparison
    else:
        content, show = _over_logs(results, folder), print_over_logs
    if not out:
        point_latest_to(folder)
    if json:
        print_json(content)
    elif not quiet:
        print_notes("warning", [note for result in results.values() for note in result.comparison.warnings])
        show(content)
        print(printable(str(folder / "report.html")))
    for problem in problems:
        print_error(problem)
    return _exit_code(results.values(), problems)


@dataclass(frozen=True)
class _Chosen:
    """The options of the command, the same for each of its logs."""

    methods: tuple[str, ...]
    as_is: bool
    self_test: bool
    loops: bool
    cameras: options.Cameras
    frames: options.Frames
    truth: options.TruthFile
    errors: options.TruthErrors
    settings: options.Settings
    quiet: bool

    def compared(self, log: str, folder: Path) -> "ComparisonResult":
        """Compare the methods on one log, and write all files to a folder."""
        from ..inspection.overview import inspect_log
        from ..logs.recording.stereo_log import open_log
        from ..run import compare as comparison
        from .progress import counter

        config, selection = self.settings.read(), self.frames.selection()
        recording = open_log(log, **self.cameras.chosen, ground_truth=self.truth.read())
        names = self.methods or comparison.compared_on(recording, config)
        written, file = comparison.outputs(folder, names), self.truth.ground_truth
        options.protect(written, log, file, self.settings.config, self.cameras.calibration)
        inspection = inspect_log(log, **self.cameras.chosen)
        print_notes("problem", inspection["problems"])
        frames_in_all = selection.count(recording.expected_frames)
        with counter("compare", "frames in two passes", frames_in_all and 2 * frames_in_all, self.quiet) as advance:
            return comparison.compare(
                recording,
                folder,
                config,
                selection,
                methods=names,
                ignore_ground_truth=self.errors.ignore_ground_truth,
                inspection=inspection,
                as_is=self.as_is,
                self_test=self.self_test,
                loops=self.loops,
                std_truth=self.errors.ground_truth_std,
                on_frame=advance,
            )


def _all_compared(
    chosen: _Chosen, names: Mapping[str, str], folder: Path
) -> "tuple[dict[str, ComparisonResult], list[str]]":
    """Compare the methods on each log, and return the results by name with all problems.

    A log that cannot be read is a problem, unless there is no other.
    """
    results: dict[str, ComparisonResult] = {}
    failed: list[InputError] = []
    problems: list[str] = []
    for log, name in names.items():
        try:
            results[name] = found = chosen.compared(log, folder / name)
        except InputError as error:
            failed.append(error)
            continue
        problems += found.comparison.inspection["problems"]
        if found.comparison.interrupted:
            break
    if not results:
        raise failed[0]
    return results, [*problems, *map(str, failed)]


def _names(logs: Sequence[str]) -> dict[str, str]:
    """Return the folder of each log below that of the comparison, which is the folder itself for a single log."""
    from ..batch.logs import names_for

    paths = {Path(os.path.abspath(log)): log for log in logs}
    if len(paths) == 1:
        return {logs[0]: ""}
    return {paths[path]: name for path, name in names_for(dict.fromkeys(paths, 1)).items()}


def _over_logs(results: "Mapping[str, ComparisonResult]", folder: Path) -> dict[str, Any]:
    """Write the page over all logs, and return the content of its report.json."""
    from ..report.over_logs import numbers_over_logs, write_over_logs

    content = numbers_over_logs({name: result.report for name, result in results.items()})
    write_over_logs(content, folder)
    return content


def _exit_code(results: "Iterable[ComparisonResult]", problems: Sequence[str]) -> int:
    found = [result.comparison for result in results]
    if any(comparison.interrupted for comparison in found):
        return ExitCode.INTERRUPTED
    if any(run.failure for comparison in found for run in comparison.runs):
        return ExitCode.DEFECT
    return ExitCode.INPUT if problems or not all(comparison.complete for comparison in found) else ExitCode.DONE
