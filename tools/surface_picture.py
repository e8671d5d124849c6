"""A picture of a mesh, rendered without display or GPU: perspective, far triangles first, light from the viewer."""

import cv2
import numpy as np
from numpy.typing import NDArray

from stream_sfm.dense.mesh import Mesh
from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array

_FIELD_OF_VIEW_RAD = np.deg2rad(45)
_SHOWN_PERCENT = 99.8  # of the vertices lie in the picture: a few outliers must not make the rest small
_MARGIN = 1.05  # of the distance at which the surface just fills the picture
_OVERSAMPLING = 2  # per axis, against jagged edges
_BACKGROUND = 255  # grey level: white
_AMBIENT = 0.6  # fraction of the light that comes from everywhere, so that no side is black
_SUBPIXEL_BITS = 4  # of the corners of a triangle
_NEAREST = 1e-2  # of the median depth: nearer triangles would be projected to infinity


def preview(
    mesh: Mesh, azimuth_deg: float, elevation_deg: float, width: int = 800, height: int = 600
) -> NDArray[np.uint8]:
    """Render a picture (height, width, 3), red green blue.

    The viewer stands `azimuth_deg` to the right and `elevation_deg` above the direction of the first camera, seen
    from the centre of the surface.
    """
    if not len(mesh.faces):
        return np.full((height, width, 3), _BACKGROUND, np.uint8)
    size = np.array([width, height]) * _OVERSAMPLING
    focal_px = size.max() / 2 / np.tan(_FIELD_OF_VIEW_RAD / 2)
    points, direction = _seen_from(mesh, np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg), size / 2 / focal_px)
    light = _AMBIENT + (1 - _AMBIENT) * np.abs(np.einsum("ni,ni->n", mesh.normals, direction))
    depth = points[mesh.faces, 2]
    ahead = (depth > _NEAREST * np.median(np.abs(points[:, 2]))).all(axis=1)
    faces, depth = mesh.faces[ahead], depth[ahead]
    faces = faces[np.argsort(-depth.max(axis=1))]
    corners = focal_px * points[faces, :2] / points[faces, 2:] + (size - 1) / 2
    shades = (mesh.colours * light[:, None]).astype(np.float32)[faces].mean(axis=1)
    picture = np.full((size[1], size[0], 3), _BACKGROUND, np.uint8)
    for corner, shade in zip(np.rint(corners * 2**_SUBPIXEL_BITS).astype(np.int32), shades, strict=True):
        cv2.fillConvexPoly(picture, corner, shade.tolist(), shift=_SUBPIXEL_BITS)
    return np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _seen_from(mesh: Mesh, azimuth_rad: float, elevation_rad: float, half_view: Array) -> tuple[Array, Array]:
    """Return vertices in axes of a viewer from whom they fill the picture, and directions to the viewer (n, 3)."""
    world_from_view = se3.exp_so3([0, -azimuth_rad, 0]) @ se3.exp_so3([-elevation_rad, 0, 0])
    points = mesh.vertices @ world_from_view
    points = points - np.percentile(points, [100 - _SHOWN_PERCENT, _SHOWN_PERCENT], axis=0).mean(axis=0)
    needed = np.abs(points[:, :2]) / half_view - points[:, 2:]
    points[:, 2] += _MARGIN * np.percentile(needed.max(axis=1), _SHOWN_PERCENT)
    to_viewer = -points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)
    return points, to_viewer @ world_from_view.T
