"""Triangle meshes: the mesh of a disparity map, and binary PLY files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..geometry.stereo import StereoProjection
from ..system.files import write_whole
from ..system.wording import printable
from .disparity import DisparityMap, rays, std_along_ray

_VERTEX = np.dtype([("position", "<f4", 3), ("normal", "<f4", 3), ("colour", "u1", 3), ("std_m", "<f4")])
_FACE = np.dtype([("count", "u1"), ("vertices", "<i4", 3)])


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Mesh:
    """A surface of triangles with a normal, a colour and a σ at each vertex.

    `vertices` (n, 3), metres; `faces` (m, 3), counter-clockwise as seen from the camera; `normals` (n, 3) point to
    that side; `colours` (n, 3), red green blue; `std_m` (n,): σ along the viewing ray. The distance to the surface
    has this σ or, on slanted surfaces, a smaller one.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]
    std_m: NDArray[np.float32]

    def moved(self, target_from_source: Array) -> "Mesh":
        """Return the same surface in axes of the target."""
        vertices = se3.transform(target_from_source, self.vertices).astype(np.float32)
        normals = (self.normals @ target_from_source[:3, :3].T).astype(np.float32)
        return Mesh(vertices, self.faces, normals, self.colours, self.std_m)

    def __repr__(self) -> str:
        return f"<Mesh {len(self.vertices)} vertices, {len(self.faces)} triangles>"


def mesh_of_frame(
    projection: StereoProjection, found: DisparityMap, colours: NDArray[np.uint8], max_step_px: float
) -> Mesh:
    """Mesh a disparity map in rectified axes: one vertex per pixel, two triangles between four neighbours.

    `colours` (h, w, 3) of the rectified left image. Neighbours whose disparities differ by more than `max_step_px` are
    not connected; 1 px is also the limit of human stereo vision (Burt and Julesz 1980).
    """
    d = found.disparity_px
    number = np.arange(d.size, dtype=np.int32).reshape(d.shape)
    a, b, c, e = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]  # above a b, below c e
    faces = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, c, b), (b, c, e))])
    corners = d.ravel()[faces]
    with np.errstate(invalid="ignore"):  # NaN compares false
        faces = faces[np.ptp(corners, axis=1) <= max_step_px]
    used = np.zeros(d.size, bool)
    used[faces] = True
    kept, faces = np.flatnonzero(used), (np.cumsum(used, dtype=np.int32) - 1)[faces]

    ray, disparity = rays(projection).reshape(-1, 3)[kept], d.ravel()[kept].astype(float)
    vertices = ray * (projection.f_px * projection.baseline_m / disparity)[:, None]
    return Mesh(
        vertices.astype(np.float32),
        faces,
        normals_of(vertices, faces),
        colours.reshape(-1, 3)[kept],
        std_along_ray(projection, ray, disparity, found.std_px.ravel()[kept]).astype(np.float32),
    )


def normals_of(vertices: Array, faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return unit normals (n, 3) of vertices (n, 3): the mean normals of their triangles, weighted by area."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across, corner = np.repeat(np.cross(b - a, c - a), 3, axis=0), faces.ravel()
    normals = np.stack([np.bincount(corner, of_axis, minlength=len(vertices)) for of_axis in across.T], axis=1)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return (normals / np.maximum(length, 1e-30)).astype(np.float32)


def write_ply(path: str | Path, mesh: Mesh, comment: str) -> None:
    """Write a mesh with all data of its vertices; `comment` states its axes. Raises OutputError."""
    vertices = np.empty(len(mesh.vertices), _VERTEX)
    vertices["position"], vertices["normal"] = mesh.vertices, mesh.normals
    vertices["colour"], vertices["std_m"] = mesh.colours, mesh.std_m
    faces = np.empty(len(mesh.faces), _FACE)
    faces["count"], faces["vertices"] = 3, mesh.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {printable(comment)}",
        "comment metres; std_m: standard deviation of the vertex along its viewing ray",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        "property float std_m",
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    write_whole(path, "\n".join(header).encode("ascii", "replace"), vertices.tobytes(), faces.tobytes())
