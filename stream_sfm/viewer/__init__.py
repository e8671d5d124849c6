"""The Rerun viewer, for replays and for live use. Rerun itself is imported when a viewer is opened.

The HTML pages are in `report/`.
"""

import os
from importlib.util import find_spec
from pathlib import Path

from ..camera.rig import MonoRig, StereoRig
from ..errors import ConfigError
from ..types import Sink, Trajectory


def require_rerun() -> None:
    """Raise a ConfigError if Rerun is not installed; if it is, keep its raw escapes off standard error."""
    if find_spec("rerun") is None:
        raise ConfigError(
            "the Rerun viewer is not installed: pip install rerun-sdk, or this package with its extra [view]"
        )
    os.environ.setdefault("RUST_LOG", "off")  # read when Rerun is imported


def open_viewer(
    rig: StereoRig | MonoRig,
    rrd: str | Path | None = None,
    view: bool = False,
    ground_truth: Trajectory | None = None,
    name: str = "live",
) -> Sink:
    """Open a sink that shows estimates in a viewer window (`view`), writes them to the file `rrd`, or both.

    `ground_truth` is drawn in the world frame of the estimates, aligned at the first common frame; `name` is the
    name of the recording in the viewer. Raises ConfigError if Rerun is not installed, no window can be opened or
    neither output is requested, OutputError if the file cannot be written.
    """
    if not isinstance(rig, StereoRig | MonoRig):
        raise ConfigError(f"the rig is of type {type(rig).__name__}; give a StereoRig or a MonoRig")
    require_rerun()
    from .sink import RerunSink

    return RerunSink(rig, rrd, view, ground_truth, name)
