"""Pictures of a mesh, rendered without display or GPU: perspective, depth buffer, light from the viewer."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..files import write_whole
from ..geometry import se3
from ..geometry.se3 import Array
from .mesh import Mesh

_FIELD_OF_VIEW_RAD = np.deg2rad(45)
_SHOWN_PERCENT = 99.8  # of the vertices lie in the picture: a few outliers must not make the rest small
_MAX_RELATIVE_STD = 0.015  # chosen by eye: further away than where σ is this part of the distance, shapes are lost
_GROUPS = 50  # of vertices of about one distance
_MARGIN = 1.05  # of the distance at which the surface just fills the picture
_OVERSAMPLING = 2  # per axis, against jagged edges
_BACKGROUND = 255  # grey level: white
_AMBIENT = 0.6  # fraction of the light that comes from everywhere, so that no side is black
_FRAGMENTS = 2_000_000  # candidate pixels that are processed at a time: about 200 MB
_CLIP = 1e-3  # triangles nearer than this fraction of the median depth would be projected to infinity


def preview(
    mesh: Mesh, azimuth_deg: float, elevation_deg: float, width: int = 800, height: int = 600
) -> NDArray[np.uint8]:
    """Render a picture (height, width, 3), red green blue.

    The viewer stands `azimuth_deg` to the right and `elevation_deg` above the direction of the first camera, seen
    from the centre of the surface.
    """
    size = np.array([width, height]) * _OVERSAMPLING
    focal_px = size.max() / 2 / np.tan(_FIELD_OF_VIEW_RAD / 2)
    points, direction = _seen_from(mesh, np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg), size / 2 / focal_px)
    light = _AMBIENT + (1 - _AMBIENT) * np.abs(np.einsum("ni,ni->n", mesh.normals, direction))
    colours = mesh.colours * light[:, None].astype(np.float32)
    picture = np.full((size[1] * size[0], 3), _BACKGROUND, np.float32)
    nearest = np.full(size[1] * size[0], np.inf, np.float32)
    for pixels, depths, shown in _fragments(points, mesh.faces, colours, focal_px, size):
        front = depths < nearest[pixels]
        pixels, depths, shown = pixels[front], depths[front], shown[front]
        order = np.argsort(-depths)  # of several values for one pixel the last one is kept, which is the nearest
        nearest[pixels[order]], picture[pixels[order]] = depths[order], shown[order]
    image = picture.reshape(size[1], size[0], 3)
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return np.clip(np.rint(small), 0, 255).astype(np.uint8)


def near_part(mesh: Mesh) -> Mesh:
    """Of the mesh of one frame, in axes of its camera, what lies so near that its shape can be seen.

    σ grows with the square of the distance: far surfaces are drawn out into shards, and a picture that holds them all
    leaves nothing of what is near. The cut is at the distance where half of the vertices around it have a σ of more
    than `_MAX_RELATIVE_STD`; if all are less certain than that, there is none.
    """
    distance = np.linalg.norm(mesh.vertices, axis=1)
    order = np.argsort(distance)
    groups = [group for group in np.array_split(order, _GROUPS) if len(group)]
    certain = [np.median(mesh.std_m[group] / distance[group]) <= _MAX_RELATIVE_STD for group in groups]
    if all(certain) or not any(certain):
        return mesh
    last = groups[max(number for number, good in enumerate(certain) if good)]
    kept = distance <= distance[last[-1]]
    faces = mesh.faces[kept[mesh.faces].all(axis=1)]
    number = np.cumsum(kept, dtype=np.int32) - 1
    return Mesh(mesh.vertices[kept], number[faces], mesh.normals[kept], mesh.colours[kept], mesh.std_m[kept])


def write_png(path: str | Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture (h, w, 3), red green blue. Raises OutputError."""
    write_whole(path, cv2.imencode(".png", picture[:, :, ::-1])[1].tobytes())


def _seen_from(mesh: Mesh, azimuth_rad: float, elevation_rad: float, half_view: Array) -> tuple[Array, Array]:
    """Vertices in the axes of a viewer so far away that they fit, and directions to the viewer (n, 3)."""
    world_from_view = se3.exp_so3([0, -azimuth_rad, 0]) @ se3.exp_so3([-elevation_rad, 0, 0])
    if not len(mesh.vertices):
        return np.zeros((0, 3)), np.zeros((0, 3))
    points = mesh.vertices @ world_from_view
    points = points - np.percentile(points, [100 - _SHOWN_PERCENT, _SHOWN_PERCENT], axis=0).mean(axis=0)
    needed = np.abs(points[:, :2]) / half_view - points[:, 2:]
    points[:, 2] += _MARGIN * np.percentile(needed.max(axis=1), _SHOWN_PERCENT)
    to_viewer = -points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)
    return points, to_viewer @ world_from_view.T


def _fragments(
    points: Array, faces: NDArray[np.int32], colours: NDArray[np.float32], focal_px: float, size: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]]:
    """The pixels that triangles cover, with depths and colours, a bounded number at a time.

    Triangles of similar size are processed together: each tests all pixels of a square of that size.
    """
    faces = faces[(points[faces, 2] > _CLIP * np.median(np.abs(points[:, 2]))).all(axis=1)]
    corners = focal_px * points[faces, :2] / points[faces, 2:] + (size - 1) / 2
    low = np.ceil(corners.min(axis=1)).astype(np.int64)
    extent = (np.floor(corners.max(axis=1)).astype(np.int64) - low + 1).max(axis=1)
    in_view = (extent > 0) & (low < size).all(axis=1) & (corners.max(axis=1) >= 0).all(axis=1)
    step = 1
    while in_view.any():
        rows = np.flatnonzero(in_view & (extent <= step))
        in_view[rows] = False
        square = np.stack(np.meshgrid(np.arange(step), np.arange(step)), axis=-1).reshape(-1, 2)
        for some in np.array_split(rows, -(-len(rows) * len(square) // _FRAGMENTS) or 1):
            yield _covered(points, faces[some], corners[some], low[some][:, None] + square, colours, size)
        step = 2 * step if step < size.max() else int(extent.max(initial=1))


def _covered(
    points: Array,
    faces: NDArray[np.int32],
    corners: Array,
    pixels: NDArray[np.int64],
    colours: NDArray[np.float32],
    size: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
    """Those of the pixels (t, k, 2) that lie in their triangle (t, 3, 2) and in the picture."""
    a, b, c = (corners[:, i] for i in range(3))
    u, v = b - a, c - a
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    area = np.where(np.abs(area) < 1e-9, np.inf, area)
    p = pixels - a[:, None]
    second = (p[..., 0] * v[:, None, 1] - p[..., 1] * v[:, None, 0]) / area[:, None]
    third = (u[:, None, 0] * p[..., 1] - u[:, None, 1] * p[..., 0]) / area[:, None]
    weights = np.stack([1 - second - third, second, third], axis=-1)
    inside = (weights >= 0).all(axis=-1) & (pixels >= 0).all(axis=-1) & (pixels < size).all(axis=-1)
    triangle, _ = np.nonzero(inside)
    weights, pixels = weights[inside], pixels[inside]
    depth = 1 / np.einsum("fi,fi->f", weights, 1 / points[faces[triangle], 2])  # 1/Z is linear in the picture
    shown = np.einsum("fi,fik->fk", weights, colours[faces[triangle]])
    return pixels[:, 1] * size[0] + pixels[:, 0], depth.astype(np.float32), shown.astype(np.float32)
