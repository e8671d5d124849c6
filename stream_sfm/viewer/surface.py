"""A recording of a surface for Rerun, which is imported when one is written."""

from pathlib import Path

from ..dense.mesh import Mesh
from ..geometry.se3 import Array
from . import require_rerun


def write_surface_recording(rrd: str | Path, mesh: Mesh, path: Array, name: str) -> None:
    """Write a recording called `name` to the file `rrd`: the mesh, and the camera centres (n, 3) in its axes.

    Raises ConfigError where Rerun is not installed, OutputError where the file cannot be written.
    """
    require_rerun()
    import rerun as rr
    import rerun.blueprint as rrb

    from . import layout
    from .recording import Recording

    space = rrb.Spatial3DView(name=name, origin="world", line_grid=False)
    recording = Recording(rrd, False, rrb.Blueprint(space, rrb.TimePanel(state="hidden")), name)
    surface = rr.Mesh3D(
        vertex_positions=mesh.vertices,
        triangle_indices=mesh.faces,
        vertex_normals=mesh.normals,
        vertex_colors=mesh.colours,
    )
    line = rr.LineStrips3D([path], colors=layout.ESTIMATE_COLOUR, radii=rr.Radius.ui_points(1.5))
    for entity, shown in (("world", rr.ViewCoordinates.RDF), ("world/surface", surface), ("world/path", line)):
        recording.stream.log(entity, shown, static=True)
    recording.close()
