"""A Rerun recording of a surface: the mesh, and the path of the camera."""

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from ..dense.mesh import Mesh
from ..errors import OutputError
from ..geometry.se3 import Array
from . import layout

_SURFACE, _PATH = "world/surface", "world/path"


def write_surface(rrd: str | Path, mesh: Mesh, path: Array, name: str) -> None:
    """Write what `write_surface_recording` describes."""
    try:
        Path(rrd).open("wb").close()
    except OSError as error:
        raise OutputError(f"cannot write {rrd}: {error.strerror}") from None
    stream = rr.RecordingStream("stream_sfm", recording_id=None)
    blueprint = rrb.Blueprint(
        rrb.Spatial3DView(name=name, origin="world", line_grid=False), rrb.TimePanel(state="hidden")
    )
    stream.set_sinks(rr.FileSink(rrd), default_blueprint=blueprint)
    stream.send_recording_name(name)
    stream.log("world", rr.ViewCoordinates.RDF, static=True)
    surface = rr.Mesh3D(
        vertex_positions=mesh.vertices,
        triangle_indices=mesh.faces,
        vertex_normals=mesh.normals,
        vertex_colors=mesh.colours,
    )
    stream.log(_SURFACE, surface, static=True)
    line = rr.LineStrips3D([path], colors=layout.ESTIMATE_COLOUR, radii=rr.Radius.ui_points(1.5))
    stream.log(_PATH, line, static=True)
    stream.flush(timeout_sec=30)
    stream.disconnect()
