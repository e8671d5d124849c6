"""`stream-sfm batch`: many logs in parallel, one result folder per log, one table and one page."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from ..errors import ConfigError, ExitCode
from ..wording import printable
from . import options
from .usage import print_error

batch = App(name="batch", help_epilogue="")


@batch.default
def replays(
    *logs: options.Log,
    out: options.Folder,
    cameras: options.Cameras = options.Cameras(),
    two_pass: options.CameraFlag = False,
    frames: options.Frames = options.Frames(),
    settings: options.MethodSettings = options.MethodSettings(),
    truth: options.TruthFile = options.TruthFile(),
    parallel: options.Workers = options.Workers(),
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Replay many logs in parallel, with one table and one HTML page for all.

    Each log is replayed in its own process: one that fails or crashes does not affect the others. Writes one
    result folder per log, as `replay` does, batch.json and report.html (a single file). A second run processes only
    what is missing or has changed. Ground truth may be a folder of files that are named after the logs.
    `batch compare LOG...` compares the methods on every log instead.

    Args:
        logs: recordings of any kind, folders of them, or patterns
        out: folder for the results of all logs
        two_pass: read the frames twice: first learn how the calibration errs, then estimate with it corrected
    """
    from ..batch.logs import find_logs
    from ..batch.replay_batch import replay_batch
    from .progress import counter

    _some(logs)
    config, selection = settings.read(), frames.selection()
    left, right, calibration = cameras.chosen
    with counter("batch", "logs", len(find_logs(logs)), quiet) as advance:
        content = replay_batch(
            logs,
            out,
            config,
            selection,
            left=left,
            right=right,
            calibration=calibration,
            calibrate=two_pass,
            ground_truth=truth.read(),
            workers=parallel.workers,
            scheduler=parallel.scheduler,
            on_done=lambda result: advance(1, f"{result.name}: {result.status}"),
        )
    _print(content, Path(out), json, quiet)
    if content["interrupted"]:
        return ExitCode.INTERRUPTED
    return ExitCode.DONE if content["complete"] else ExitCode.INPUT


def _print(content: dict[str, Any], out: Path, json: bool, quiet: bool) -> None:
    from ..report.batch_page import conclusion
    from .printing import print_json, print_notes
    from .summaries import print_batch

    if not quiet:
        print_notes("skipped", content["skipped"])
    if json:
        print_json(content)
    elif not quiet:
        print_batch(content)
        print(conclusion(content))
        print(printable(str(out / "report.html")))
    for log in content["logs"]:
        if log["status"] != "done":
            print_error(f"{log['name']}: {log['status']}: {log['reason']}")


@batch.command(name="compare")
def comparisons(
    *logs: options.Log,
    out: options.Folder,
    methods: options.Names = "",
    starts: Annotated[options.Count, Parameter(group=options.FRAMES)] = 1,
    start_step: Annotated[options.Seconds, Parameter(group=options.FRAMES)] = 1.0,
    cameras: options.Cameras = options.Cameras(),
    two_pass: options.CameraFlag = False,
    frames: options.Frames = options.Frames(),
    settings: options.Settings = options.Settings(),
    parallel: options.Workers = options.Workers(),
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Compare the methods on many logs, or on several starts of one.

    Writes one table of ratios with intervals over logs: comparison.json, and report.html (a single file). Each log is
    compared with the ground truth that it holds. Starts are samples of their own where they share no frame, by
    --max-frames.

    Args:
        logs: recordings of any kind, folders of them, or patterns
        out: folder for the results of all comparisons
        methods: the methods, separated by commas; those of `compare` if not given
        starts: run each log from N starts (1)
        start_step: seconds between starts (1)
        two_pass: read the frames twice: first learn how the calibration errs, then estimate with it corrected
    """
    import os

    from ..batch.logs import find_logs
    from ..run.compare import COMPARED
    from ..run.many import compare_many
    from .printing import print_json
    from .progress import counter
    from .summaries import print_many

    _some(logs)
    config, selection = settings.read(), frames.selection()
    left, right, calibration = cameras.chosen
    found = list(find_logs(logs))
    names = tuple(dict.fromkeys(map(str.strip, methods.split(",")))) if methods else COMPARED
    with counter("compare", "runs", len(found) * starts, quiet) as advance:
        content = compare_many(
            found,
            out,
            config,
            selection,
            left=left,
            right=right,
            calibration=calibration,
            calibrate=two_pass,
            methods=names,
            starts=starts,
            start_step_s=start_step,
            workers=parallel.workers or os.cpu_count() or 1,
            scheduler=parallel.scheduler,
            on_done=lambda name: advance(1, name),
        )
    if json:
        print_json(content)
    elif not quiet:
        print_many(content)
        print(content["conclusion"])
        print(printable(str(Path(out) / "report.html")))
    failed = [s for s in content["samples"] if s["failure"]]
    for s in failed:
        print_error(f"{s['log']} from {s['start_s']:g} s: {s['failure']}")
    if content["interrupted"]:
        return ExitCode.INTERRUPTED
    return ExitCode.INPUT if failed else ExitCode.DONE


def _some(logs: tuple[str, ...]) -> None:
    if not logs:
        raise ConfigError("LOG is missing: name recordings, folders of them, or patterns")
