"""`stream-sfm batch`: many logs in parallel, one result folder per log, one table and one page."""

from pathlib import Path
from typing import Annotated, Any

from ..errors import ConfigError, ExitCode
from . import options
from .printing import print_error, print_json, print_notes
from .tables import Parameter


def batch(
    *logs: options.Log,
    out: options.Folder,
    cameras: options.Cameras = options.Cameras(),
    frames: options.Frames = options.Frames(),
    settings: options.Settings = options.Settings(),
    method: options.MethodName = None,
    truth: options.TruthFile = options.TruthFile(),
    workers: options.Workers = None,
    scheduler: Annotated[str | None, Parameter(group=options.PARALLEL, metavar="ADDRESS")] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Replay many logs in parallel, with one table and one HTML page for all.

    Each log is replayed in its own process: one that fails or crashes does not affect the others. Writes one
    result folder per log, as `replay` does, batch.json and report.html (a single file). A second run processes only
    what is missing or has changed. Ground truth may be a folder of files that are named after the logs.
    Needs the extra study.

    Args:
        logs: recordings of any kind, folders of them, or patterns
        out: folder for the results of all logs
        scheduler: use a Dask cluster instead, such as tcp://127.0.0.1:8786 (needs stream-sfm[cluster])
    """
    from ..batch.logs import find_logs, size_bytes
    from ..batch.replay_batch import replay_batch
    from .progress import counter

    options.at_least_one(logs, "LOG", "recordings, folders of them, or patterns")
    if workers is not None and scheduler is not None:
        raise ConfigError("--workers and --scheduler exclude each other: leave one out")
    config, selection = settings.read(method=method), frames.selection()
    sizes = {str(log): size_bytes(log) for log in find_logs(logs)}  # logs take as long as they are large
    with counter("batch", "logs", len(sizes), quiet, sum(sizes.values())) as advance:
        content = replay_batch(
            logs,
            out,
            config,
            selection,
            **cameras.chosen,
            ground_truth=truth.read(),
            workers=workers,
            scheduler=scheduler,
            on_done=lambda result: advance(1, f"{result.name}: {result.status}", sizes.get(result.log)),
        )
    return _end(content, out, json, quiet)


def _end(content: dict[str, Any], out: str | Path, json: bool, quiet: bool) -> int:
    """Print the content of batch.json and what has failed, and return the exit code."""
    from .summaries import print_batch

    if not quiet:
        print_notes("skipped", content["skipped"])
    if json:
        print_json(content)
    elif not quiet:
        print_batch(content, Path(out))
    for log in content["logs"]:
        if log["status"] != "done":
            print_error(f"{log['name']}: {log['status']}: {log['reason']}")
    if content["interrupted"]:
        return ExitCode.INTERRUPTED
    return ExitCode.DONE if content["complete"] else ExitCode.INPUT
