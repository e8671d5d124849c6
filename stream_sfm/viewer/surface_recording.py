"""The public way to a recording of a surface; Rerun is imported when one is written."""

from pathlib import Path

from ..dense.mesh import Mesh
from ..geometry.se3 import Array
from . import require_rerun


def write_surface_recording(rrd: str | Path, mesh: Mesh, path: Array, name: str) -> None:
    """Write a recording called `name` to the file `rrd`: the mesh, and the camera centres (n, 3) in its axes.

    Raises ConfigError where Rerun is not installed, OutputError where the file cannot be written.
    """
    require_rerun()
    from .surface import write_surface

    write_surface(rrd, mesh, path, name)
