"""Voxels as sorted integer keys, and triangles at the zero level of signed distances on them.

The neighbours of a voxel are found by adding to its key. The triangles are naive surface nets (Gibson 1998): a cell
has eight voxels as corners. If all of them exist and the sign changes, it has one vertex, the mean of the zero
crossings on its edges; around each crossed edge, the four cells that share it form two triangles. Without all its
voxels there is no cell, so surfaces end where nothing was seen.
"""

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array

Keys = NDArray[np.int64]

_BITS = 21  # per axis: three axes fill an int64
_HALF = 1 << (_BITS - 1)  # voxels on either side of the origin of the world
_MARGIN = 8  # voxels at the end of the range, so that neighbours exist
_MASK = (1 << _BITS) - 1
_AXES: Keys = np.array([1 << 2 * _BITS, 1 << _BITS, 1], dtype=np.int64)  # added to a key by one step along x, y, z
_CORNERS = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])  # x, y, z steps
_EDGES = [(i, i | bit) for bit in (4, 2, 1) for i in range(8) if not i & bit]


def keys_of(points: Array, voxel_m: float) -> Keys:
    """Return keys of the voxels that contain points (n, 3), metres; points outside the range of keys are left out."""
    cell = np.floor(points / voxel_m)
    cell = cell[(np.abs(cell) < _HALF - _MARGIN).all(axis=1)].astype(np.int64)
    return (cell + _HALF) @ _AXES


def cells_of(keys: Keys) -> Keys:
    """Return integer coordinates (n, 3) of keys (n,)."""
    return np.stack([(keys >> shift) & _MASK for shift in (2 * _BITS, _BITS, 0)], axis=-1) - _HALF


def halved(keys: Keys) -> Keys:
    """Return keys of the voxels with twice the edge that contain these."""
    return ((cells_of(keys) >> 1) + _HALF) @ _AXES


def grown(keys: Keys, radius: int) -> Keys:
    """Return ascending keys of all voxels within `radius` steps along each axis."""
    for axis in _AXES:
        keys = distinct((keys[:, None] + axis * np.arange(-radius, radius + 1)).ravel())
    return keys


def distinct(keys: Keys) -> Keys:
    """Return the distinct keys, ascending; ten times as fast as np.unique, which uses a hash table."""
    keys = np.sort(keys)
    return keys[np.concatenate([[True], keys[1:] != keys[:-1]])] if len(keys) else keys


def find(keys: Keys, wanted: Keys) -> NDArray[np.int64]:
    """Return rows of `wanted` (…) in the ascending `keys` (n,); −1 for those that are missing."""
    if not len(keys):
        return np.full(wanted.shape, -1)
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[at] == wanted, at, -1)


def isosurface(
    keys: Keys, distances: NDArray[np.floating], attributes: NDArray[np.floating]
) -> tuple[Array, NDArray[np.int32], Array, Array]:
    """Extract the surface from ascending voxel keys (v,), signed distances (v,) and attributes (v, k).

    Returns points (n, 3) in voxels, relative to the centre of voxel (0, 0, 0); faces (m, 3); normals (n, 3) to the
    positive side; attributes (n, k), which are means over the corners of the cell.
    """
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
    return (
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
        row = find(keys, cells + corner @ _AXES).astype(np.int32)
        there = row >= 0
        cells, rows = cells[there], [r[there] for r in (*rows, row)]
    return np.stack(rows, axis=1), cells


def _faces(keys: Keys, distances: NDArray[np.floating], cells: Keys) -> NDArray[np.int32]:
    """Return triangles (m, 3): two for each crossed edge between voxels that has four cells around it."""
    found: list[NDArray[np.int64]] = []
    for axis in range(3):
        along, b, c = _AXES[axis], _AXES[(axis + 1) % 3], _AXES[(axis + 2) % 3]
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
