"""The Rerun viewer, for replays and for live use. Rerun itself is imported when a viewer is opened.

Not here: the HTML pages (`report/`).
"""

from pathlib import Path

from ..camera.rig import MonoRig, StereoRig
from ..types import Sink, Trajectory

__all__ = ["open_viewer"]


def open_viewer(
    rig: StereoRig | MonoRig,
    rrd: str | Path | None = None,
    view: bool = False,
    ground_truth: Trajectory | None = None,
    name: str = "live",
) -> Sink:
    """Open a sink that shows estimates in a viewer window (`view`), writes them to the file `rrd`, or both.

    `ground_truth` is drawn in the world frame of the estimates, aligned at the first common frame; `name` is the name
    of the recording in the viewer. Raises ConfigError where no window can be opened or neither output is requested,
    OutputError where the file cannot be written.
    """
    from .sink import RerunSink

    return RerunSink(rig, rrd, view, ground_truth, name)
