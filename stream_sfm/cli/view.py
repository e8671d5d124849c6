"""`stream-sfm view`: a finished run in the Rerun viewer."""

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..errors import InputError
from . import options
from .printing import print_notes

if TYPE_CHECKING:
    from ..recording.stereo_log import StereoLog
    from ..results.run_results import RunResults


def view(
    run: Annotated[str, Parameter("RUN")],
    /,
    *,
    rrd: options.ResultFile = None,
    quiet: options.Quiet = False,
) -> None:
    """Open a finished run in the Rerun viewer.

    Shows the path, the points and the figures of a run, and the images where its log is still where it was.

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
    """The log of a run, and what to say where it cannot be read."""
    from ..recording.stereo_log import open_log

    path = found.summary.get("log")
    try:
        if path is None:
            raise InputError(f"{found.folder} does not name its log (summary.json)")
        return open_log(path, mono=found.config.mono), []
    except InputError as error:
        return None, [f"the run is shown without images: {error}"]
