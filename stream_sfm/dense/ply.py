"""Meshes as binary PLY files: position, normal, colour and `std_m` of each vertex, and triangles."""

from pathlib import Path

import numpy as np

from ..files import write_whole
from ..wording import printable
from .mesh import Mesh

_VERTEX = np.dtype([(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
                   + [(name, "u1") for name in ("red", "green", "blue")] + [("std_m", "<f4")])  # fmt: skip
_FACE = np.dtype([("count", "u1"), ("vertices", "<i4", 3)])
_TYPES = {"<f4": "float", "|u1": "uchar"}


def write_ply(path: str | Path, mesh: Mesh, comment: str) -> None:
    """Write a mesh; `comment` states its axes. Raises OutputError."""
    vertices = np.empty(len(mesh.vertices), _VERTEX)
    for i, axis in enumerate("xyz"):
        vertices[axis], vertices[f"n{axis}"] = mesh.vertices[:, i], mesh.normals[:, i]
    for i, name in enumerate(("red", "green", "blue")):
        vertices[name] = mesh.colours[:, i]
    vertices["std_m"] = mesh.std_m
    faces = np.empty(len(mesh.faces), _FACE)
    faces["count"], faces["vertices"] = 3, mesh.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {printable(comment)}",
        "comment metres; std_m: standard deviation of the vertex along its viewing ray",
        f"element vertex {len(vertices)}",
        *(f"property {_TYPES[_VERTEX[name].str]} {name}" for name in _VERTEX.names or ()),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    write_whole(path, "\n".join(header).encode("ascii", "replace"), vertices.tobytes(), faces.tobytes())
