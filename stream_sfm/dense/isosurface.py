"""Triangles at the zero level of signed distances on scattered voxels: naive surface nets (Gibson 1998).

A cell has eight voxels as corners. If all of them exist and the sign changes, it has one vertex, the mean of the zero
crossings on its edges; around each crossed edge, the four cells that share it form two triangles. Where a voxel is
missing there is no cell, so surfaces end where nothing was seen.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array
from .voxels import AXES, Keys, cells_of, find

_CORNERS = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])  # x, y, z steps
_EDGES = [(i, i | bit) for bit in (4, 2, 1) for i in range(8) if not i & bit]


class Isosurface(NamedTuple):
    """A surface of triangles in units of voxels."""

    points: Array  # (n, 3), relative to the centre of voxel (0, 0, 0)
    faces: NDArray[np.int32]  # (m, 3)
    normals: Array  # (n, 3), to the positive side
    attributes: Array  # (n, k), means over the corners of the cell


def isosurface(keys: Keys, distances: NDArray[np.floating], attributes: NDArray[np.floating]) -> Isosurface:
    """Extract the surface from ascending voxel keys (v,), signed distances (v,) and attributes (v, k)."""
    rows, cells = _whole_cells(keys)
    inside = distances[rows] < 0
    crossed = inside.any(axis=1) != inside.all(axis=1)
    rows, cells = rows[crossed], cells[crossed]

    values = distances[rows].astype(float)
    sums, count = np.zeros((len(cells), 3)), np.zeros((len(cells), 1))
    for a, b in _EDGES:
        cut = (values[:, a] < 0) != (values[:, b] < 0)
        va, vb = values[cut, a], values[cut, b]
        sums[cut] += _CORNERS[a] + (va / (va - vb))[:, None] * (_CORNERS[b] - _CORNERS[a])
        count[cut] += 1
    signs = 2.0 * _CORNERS - 1
    slope = values @ signs
    normals = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-30)
    return Isosurface(
        cells_of(cells) + sums / np.maximum(count, 1),
        _faces(keys, distances, cells),
        normals,
        attributes[rows].mean(axis=1) if len(rows) else np.zeros((0, attributes.shape[1])),
    )


def _whole_cells(keys: Keys) -> tuple[NDArray[np.int32], Keys]:
    """Return rows (n, 8) of the corners of the cells whose corners all exist, and the keys (n,) of these cells."""
    cells = keys
    rows: list[NDArray[np.int32]] = []
    for corner in _CORNERS:
        row = find(keys, cells + corner @ AXES).astype(np.int32)
        there = row >= 0
        cells, rows = cells[there], [r[there] for r in (*rows, row)]
    return np.stack(rows, axis=1), cells


def _faces(keys: Keys, distances: NDArray[np.floating], cells: Keys) -> NDArray[np.int32]:
    """Return triangles (m, 3): two for each edge between voxels that is crossed and has four cells around it."""
    found: list[NDArray[np.int64]] = []
    for axis in range(3):
        along, b, c = AXES[axis], AXES[(axis + 1) % 3], AXES[(axis + 2) % 3]
        other = find(keys, keys + along)
        near = distances < 0
        crossed = (other >= 0) & (near != near[other])
        start = keys[crossed]
        quad = np.stack([find(cells, start - step) for step in (0, b, b + c, c)], axis=1)
        rising = near[crossed]  # inside first: the positive side lies ahead along the axis
        closed = (quad >= 0).all(axis=1)
        quad, rising = quad[closed], rising[closed]
        quad[~rising] = quad[~rising][:, ::-1]
        found += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return np.concatenate(found).astype(np.int32)
