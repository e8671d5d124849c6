"""`stream-sfm evaluate` and `stream-sfm view`: finished runs against ground truth, and in the Rerun viewer."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ConfigError, ExitCode, InputError, require_study
from . import options
from .printing import print_json, print_notes

if TYPE_CHECKING:
    from ..logs.recording.stereo_log import StereoLog
    from ..results.run_results import RunResults
    from ..types import Trajectory


def evaluate(
    *runs: options.Run,
    out: options.ResultFile = None,
    truth: options.TruthFile = options.TruthFile(),
    errors: options.TruthErrors = options.TruthErrors(),
    json: options.Json = False,
) -> int:
    """Compare finished runs with ground truth, one row per run.

    The ground truth comes from the log of the run, or from a file. The figures are those of the section
    ground_truth in summary.json, without the ones of the local structure. Of two folders with runs of the same logs,
    such as batches with two configurations, it also says which one drifts less: the ratio of their errors, with its
    95 % interval over the logs (needs the extra study).

    Args:
        runs: result folders: of replays, of methods of a comparison, of batches
        out: also write a page with charts, an .html; needs the extra study
    """
    from ..evaluation.association import without_frames
    from ..evaluation.paired import paired
    from ..report.pages import Evaluated, render_evaluation
    from ..results.run_results import read_results
    from ..system.files import write_whole
    from .summaries import print_evaluation

    options.at_least_one(runs, "RUN", "result folders, such as runs/latest")
    if out is not None and Path(out).suffix.lower() != ".html":
        raise ConfigError(f"--out {out}: the name must end in .html")
    if out is not None:
        require_study("a page")
    runs = tuple(run for name in runs for run in _runs_in(Path(name)))
    options.protect([out], *runs, truth.ground_truth)
    found, rows, missing, failed = [], [], [], []
    for name in dict.fromkeys(runs):
        try:
            run = read_results(name)
            poses, std = _truth(run, truth)
            used = without_frames(poses, run.stamps_ns, errors.ignore_ground_truth)
            figures, method = _figures(run, used, errors, std), run.config.method
        except (InputError, ConfigError) as error:  # one of many; the others are still compared
            failed.append(error)
            continue
        missing += run.warnings
        found.append(Evaluated(name, method, figures, run.trajectory, used))
        rows.append({"run": name, "method": method, "log": run.summary.get("log"), "ground_truth": figures})
        if not figures["frames_compared"]:
            missing.append(_why_none(run, used, truth.ground_truth or "of the log"))
    if not found:
        raise failed[0]
    missing += map(str, failed)
    if out is not None:
        write_whole(out, render_evaluation(found).encode())
    sets = paired(rows)
    if json:
        print_json({"runs": rows, "paired": None if sets is None else asdict(sets)})
    else:
        print_evaluation(rows)
        if sets is not None:
            print(sets.in_words())
    print_notes("warning", missing)
    return ExitCode.INPUT if missing else ExitCode.DONE


def _runs_in(folder: Path) -> list[str]:
    """Return the runs in a folder of runs, such as that of a batch; a run itself is one."""
    from ..results.run_results import is_run

    inside = sorted(folder.iterdir()) if folder.is_dir() and not is_run(folder) else []
    return [str(run) for run in inside if is_run(run)] or [str(folder)]


def _truth(run: "RunResults", given: options.TruthFile) -> "tuple[Trajectory, tuple[float, float]]":
    """Return the ground truth of a run and its σ as far as known. The log is opened only if it is needed."""
    from ..logs.recording.stereo_log import open_log

    file, log = given.read(), run.summary.get("log")
    if file is not None and file.of_left_camera:
        return file.poses(), (0.0, 0.0)
    if log is None:
        raise InputError(
            f"{run.folder} does not name its log (summary.json), which is needed here", hint=("ground_truth",)
        )
    opened = open_log(log, ground_truth=file, mono=run.config.mono)
    if (truth := opened.ground_truth()) is None:
        raise InputError(f"{run.folder}: its log {log} holds no ground truth: name a file", hint=("ground_truth",))
    return truth, opened.std_truth


def _why_none(run: "RunResults", truth: "Trajectory", name: str) -> str:
    """Return the reason why no frame of a run has a true pose."""
    from ..logs.recording.truth_file import time_warning

    if not len(truth) or not len(run):
        return f"{run.folder}: there is nothing to compare: {len(run)} frames, {len(truth)} poses of ground truth"
    elsewhere = time_warning(truth, name, int(run.stamps_ns[0]), int(run.stamps_ns[-1]))
    return f"{run.folder}: {elsewhere or f'no pose of the ground truth {name} has the time of a frame'}"


def _figures(
    run: "RunResults", truth: "Trajectory", known: options.TruthErrors, std_truth: tuple[float, float]
) -> dict[str, Any]:
    from ..evaluation.relative_consistency import RelativeRecord
    from ..evaluation.summary import evaluate_run, evaluate_unscaled

    if run.config.mono:
        return evaluate_unscaled(run.trajectory, truth)
    motions = RelativeRecord()
    for estimate in run.estimates():
        motions.add(estimate)
    figures = evaluate_run(run.trajectory, motions, truth, known.ground_truth_std or std_truth)
    return figures | {"frames_ignored": [list(frames) for frames in known.ignore_ground_truth]}


def view(run: options.Run, /, *, rrd: options.ResultFile = None, quiet: options.Quiet = False) -> None:
    """Open a finished run in the Rerun viewer.

    Shows the path, the points and the figures of a run, and its images if the log has not been moved.

    Args:
        run: the result folder of a replay, such as runs/latest
        rrd: write a recording instead of opening a window
    """
    from ..results.estimates_reader import read_estimates, recorded_rig
    from ..results.run_results import read_results
    from ..viewer import open_viewer, require_rerun
    from .progress import counter

    require_rerun()
    found = read_results(run)
    options.protect([rrd], run, found.summary.get("log"))
    log, notes = _log(found)
    if not quiet:
        print_notes("warning", [*found.warnings, *notes])
    truth = log.ground_truth() if log is not None and not found.config.mono else None
    name = log.path.stem if log is not None else found.folder.name
    viewer = open_viewer(recorded_rig(found.estimates_path), rrd, rrd is None, truth, name)
    frames = iter(log.frames() if log is not None else ())
    with counter("view", "frames", len(found), quiet) as advance:
        for estimate in read_estimates(found.estimates_path, [], points=True):
            frame = next((frame for frame in frames if frame.stamp_ns >= estimate.stamp_ns), None)
            shown = frame if frame is not None and frame.stamp_ns == estimate.stamp_ns else None
            viewer.write(estimate, shown)  # type: ignore[arg-type]  # it takes estimates without images, too
            advance()
    viewer.close()


def _log(found: "RunResults") -> "tuple[StereoLog | None, list[str]]":
    """Return the log of a run, and warnings if it cannot be read."""
    from ..logs.recording.stereo_log import open_log

    path = found.summary.get("log")
    try:
        if path is None:
            raise InputError(f"{found.folder} does not name its log (summary.json)")
        return open_log(path, mono=found.config.mono), []
    except InputError as error:
        return None, [f"the run is shown without images: {error}"]
