"""Fusion of disparity maps into one surface: weighted signed distances on voxels (Curless and Levoy 1996).

A voxel near an observed surface averages its signed distance over the frames, with weights 1/σ² of the disparity
noise. Errors that frames share do not average out: the bias of the disparities and the error of the estimated poses
are accumulated separately and added to the σ of the surface. Only voxels near a surface exist; when there are too
many, their edge is doubled, so that memory stays bounded for a log of any length.
"""

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..geometry.stereo import StereoProjection
from . import voxels
from .disparity import DisparityMap, cosine_of_incidence, rays, std_along_ray
from .mesh import Mesh
from .rules import DenseRules

_WEIGHT, _DISTANCE, _SHARED, _FRAMES, _COLOUR = 0, 1, 2, 3, slice(4, 7)


class Fusion:
    """A surface fused from all `frames` so far, with voxels of edge `voxel_m`, which is 0 before the first frame."""

    def __init__(self, projection: StereoProjection, rules: DenseRules, voxel_m: float = 0.0) -> None:
        self.projection, self.rules, self.voxel_m = projection, rules, voxel_m
        self.frames = 0
        self._rays = rays(projection)
        self._keys = np.empty(0, np.int64)  # ascending
        self._slots = np.empty(0, np.int32)  # rows of the sums that belong to the keys
        # Sums over frames: weight; weight × (distance, shared variance); frames; weight × colour. Zeros take no
        # memory until they are written to.
        self._sums = np.zeros((rules.max_voxels, _COLOUR.stop), np.float32)

    def add(self, found: DisparityMap, colours: NDArray[np.uint8], world_from_rect: Array, cov_position: Array) -> None:
        """Add a frame with colours (h, w, 3), pose (4, 4) and covariance (3, 3), m², of its position, rectified."""
        p = self.projection
        depth = p.f_px * p.baseline_m / found.disparity_px.astype(float)
        std_noise = std_along_ray(p, self._rays, found.disparity_px, found.std_noise_px)
        if not self.voxel_m:
            self.voxel_m = self._fitting_voxel(depth)
        with np.errstate(invalid="ignore"):
            certain = std_noise < self.rules.max_std_voxels * self.voxel_m
            certain &= depth < self.rules.reach_voxels * p.f_px * self.voxel_m
        if not certain.any():
            return
        self.frames += 1
        surface = self._rays[certain] * depth[certain][:, None]
        keys, points, (u, v) = self._voxels_in_view(surface, world_from_rect)
        # the distance along the ray, times the cosine: the distance to the plane of the surface. On a road seen at a
        # grazing angle, the next voxel below is metres away along the ray.
        distance = (depth[v, u] - points[:, 2]) * np.linalg.norm(points, axis=1) / points[:, 2]
        distance *= cosine_of_incidence(p, self._rays, found.disparity_px)[v, u]
        near = certain[v, u] & (np.abs(distance) < self.rules.reach_voxels * self.voxel_m)
        keys, points, u, v, distance = keys[near], points[near], u[near], v[near], distance[near]

        weight = 1 / np.square(std_noise[v, u])
        disparity = found.disparity_px[v, u]
        bias = std_along_ray(p, self._rays[v, u], disparity, np.full(disparity.shape, found.std_bias_px))
        shared = bias**2 + _variance_along(points, cov_position)
        sums = np.empty((len(keys), _COLOUR.stop), np.float32)
        sums[:, _WEIGHT], sums[:, _FRAMES] = weight, 1
        sums[:, _DISTANCE], sums[:, _SHARED] = weight * distance, weight * shared
        sums[:, _COLOUR] = weight[:, None] * colours[v, u]
        self._accumulate(keys, sums)

    def __len__(self) -> int:
        """Return the number of voxels."""
        return len(self._keys)

    def mesh(self) -> Mesh:
        """Return the surface in the world frame where at least `min_frames` frames (or all, if fewer) have seen it."""
        sums = self._sums[self._slots]
        seen = sums[:, _FRAMES] >= min(self.rules.min_frames, max(self.frames, 1))
        keys, sums = self._keys[seen], sums[seen]
        weight = sums[:, _WEIGHT]
        variance = (1 + sums[:, _SHARED]) / weight
        means = np.column_stack([sums[:, _COLOUR] / weight[:, None], variance])
        points, faces, normals, attributes = voxels.isosurface(keys, sums[:, _DISTANCE] / weight, means)
        return Mesh(
            ((points + 0.5) * (self.voxel_m or 1.0)).astype(np.float32),
            faces,
            normals.astype(np.float32),
            np.clip(np.rint(attributes[:, :3]), 0, 255).astype(np.uint8),
            np.sqrt(attributes[:, 3]).astype(np.float32),
        )

    def _fitting_voxel(self, depth: Array) -> float:
        """Return the edge of a voxel that fits the pixels at the median depth; 0 where nothing is seen."""
        if not np.isfinite(depth).any():
            return 0.0
        return float(self.rules.voxel_footprints * np.nanmedian(depth) / self.projection.f_px)

    def _voxels_in_view(self, surface: Array, world_from_rect: Array) -> tuple[voxels.Keys, Array, voxels.Keys]:
        """Return voxels around points (n, 3) of a frame: keys (m,), centres (m, 3) in rectified axes, pixels (2, m)."""
        p = self.projection
        seen = voxels.keys_of(se3.transform(world_from_rect, surface), self.voxel_m)
        keys = voxels.grown(voxels.distinct(seen), self.rules.reach_voxels)
        centres = se3.transform(se3.inverse(world_from_rect), (voxels.cells_of(keys) + 0.5) * self.voxel_m)
        front = centres[:, 2] > self.voxel_m
        keys, centres = keys[front], centres[front]
        u, v = pixels = np.rint(p.project(centres)[:, :2]).astype(np.int64).T
        inside = (u >= 0) & (u < p.width) & (v >= 0) & (v < p.height)
        return keys[inside], centres[inside], pixels[:, inside]

    def _accumulate(self, keys: voxels.Keys, sums: NDArray[np.float32]) -> None:
        at = voxels.find(self._keys, keys)
        while len(self._keys) + np.count_nonzero(at < 0) > self.rules.max_voxels:
            self._coarsen()
            keys, sums = _averaged(voxels.halved(keys), sums)
            at = voxels.find(self._keys, keys)
        old, new = at >= 0, np.flatnonzero(at < 0)
        self._sums[self._slots[at[old]]] += sums[old]
        slots = np.arange(len(self._keys), len(self._keys) + len(new), dtype=np.int32)
        self._sums[slots] = sums[new]
        places = np.searchsorted(self._keys, keys[new])
        self._keys = np.insert(self._keys, places, keys[new])
        self._slots = np.insert(self._slots, places, slots)

    def _coarsen(self) -> None:
        """Double the edge: a voxel takes the mean of the sums of its children."""
        keys, sums = _averaged(voxels.halved(self._keys), self._sums[self._slots])
        self.voxel_m *= 2
        self._keys, self._slots = keys, np.arange(len(keys), dtype=np.int32)
        self._sums = np.zeros_like(self._sums)
        self._sums[: len(keys)] = sums


def _averaged(keys: voxels.Keys, sums: NDArray[np.float32]) -> tuple[voxels.Keys, NDArray[np.float32]]:
    """Return the distinct keys, ascending, and the mean row of each."""
    unique, row, count = np.unique(keys, return_inverse=True, return_counts=True)
    columns = [np.bincount(row, sums[:, i]) / count for i in range(sums.shape[1])]
    return unique, np.stack(columns, axis=1).astype(np.float32)


def _variance_along(points: Array, cov_position: Array) -> Array:
    """Return the variance (n,), m², along the viewing rays of points (n, 3) in the camera due to the error of its pose.

    A right perturbation (ρ, ω) moves a point X by ρ + ω × X in the axes of the camera; along X only ρ has an effect.
    """
    direction = points / np.linalg.norm(points, axis=1, keepdims=True)
    return np.einsum("ni,ij,nj->n", direction, cov_position, direction)
