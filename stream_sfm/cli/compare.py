"""`stream-sfm compare`: every method on the same observations, and the drift report."""

from pathlib import Path

from ..errors import ExitCode
from ..system.wording import printable
from . import options
from .printing import print_error, print_json, print_notes


def compare(
    log: options.Recording,
    /,
    *,
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
    method, as `replay` does. Needs the extra study.

    Args:
        out: result folder; runs/LOG-TIME if not given
        methods: the methods, separated by commas; without this option those above
        as_is: give each method the uncorrected calibration of the log; adds a row for the newest motions of cross-frame
        self_test: check the covariances without ground truth: disjoint halves of the tracks and of the image must agree
        loops: also show the first method with loops closed; needs the extra map
    """
    from ..inspection.overview import inspect_log
    from ..logs.recording.stereo_log import open_log
    from ..results.folder import new_run_folder, point_latest_to
    from ..run import compare as comparison
    from .progress import counter
    from .summaries import print_comparison

    config, selection = settings.read(), frames.selection()
    recording = open_log(log, **cameras.chosen, ground_truth=truth.read())
    folder = Path(out) if out else new_run_folder(log)
    named = tuple(dict.fromkeys(filter(None, map(str.strip, methods.split(",")))))
    names = named or comparison.compared_on(recording, config)
    written = comparison.outputs(folder, names)
    options.protect(written, log, truth.ground_truth, settings.config, cameras.calibration)
    inspection = inspect_log(log, **cameras.chosen)
    print_notes("problem", inspection["problems"])
    frames_in_all = selection.count(recording.expected_frames)
    with counter("compare", "frames in two passes", frames_in_all and 2 * frames_in_all, quiet) as advance:
        result = comparison.compare(
            recording,
            folder,
            config,
            selection,
            methods=names,
            ignore_ground_truth=errors.ignore_ground_truth,
            inspection=inspection,
            as_is=as_is,
            self_test=self_test,
            loops=loops,
            std_truth=errors.ground_truth_std,
            on_frame=advance,
        )
    if not out:
        point_latest_to(folder)
    if json:
        print_json(result.report)
    elif not quiet:
        print_notes("warning", result.comparison.warnings)
        print_comparison(result.report)
        print(printable(str(folder / "report.html")))
    for problem in inspection["problems"]:
        print_error(problem)
    if result.comparison.interrupted:
        return ExitCode.INTERRUPTED
    if any(run.failure for run in result.comparison.runs):
        return ExitCode.DEFECT
    return ExitCode.INPUT if inspection["problems"] or not result.comparison.complete else ExitCode.DONE
