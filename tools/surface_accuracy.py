"""Measures the error of a surface and the consistency of its σ, on logs with ground-truth depth and poses.

    python tools/surface_accuracy.py logs/room.mcap [--all] [--set dense.window_radius_px=6]

The true surface: the ground-truth depth images at their true poses, as points with normals. The error of a vertex
is its distance to the tangent plane at the nearest true point, or to that point if it is over 5 cm away. One frame
(the first): also the error along the viewing ray, and which share of the textured pixels is covered. Textured:
grey levels deviate by more than 10 within 15 × 15 px.
"""

import argparse
import itertools
import time
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

from stream_sfm import open_log, read_config
from stream_sfm.camera.lens import project_into_image
from stream_sfm.camera.models import Camera
from stream_sfm.config import Config
from stream_sfm.dense.mesh import Mesh
from stream_sfm.dense.surface import surface
from stream_sfm.evaluation.structure import structure_errors
from stream_sfm.geometry import se3
from stream_sfm.logs.recording.stereo_log import StereoLog

_UNKNOWN_M = 6.55  # the depth format ends here, and rendered depth is cut off at it
_TEXTURE_PX, _TEXTURE_GREY = 15, 10.0
_NEAR_M = 0.05
_HIDDEN_M = 0.5


def raw_rays(camera: Camera) -> np.ndarray:
    """(h, w, 3) rays, Z = 1, through the pixels of the image as delivered; plumb_bob or no distortion."""
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).astype(float)
    flat = cv2.undistortPoints(pixels.reshape(-1, 1, 2), camera.K, np.array(camera.D or (0.0,) * 4))
    return np.concatenate([flat[:, 0], np.ones((len(flat), 1))], axis=1).reshape(*pixels.shape[:2], 3)


def true_surface(log: StereoLog, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and normals (n, 3) in the first left camera's axes, away from edges of depth; which vertices to judge.

    Those in view of a depth image that knows their pixel and has no surface far in front of them.
    """
    truth = log.ground_truth()
    assert truth is not None, f"{log.path} has no ground-truth poses"
    first_from_world = se3.inverse(truth.world_from_cam[0])
    rays = raw_rays(log.rig.left)
    points, normals = [], []
    judged = np.zeros(len(vertices), bool)
    for stamp_ns, depth in log.depths():
        i = int(np.argmin(np.abs(truth.stamps_ns - stamp_ns)))
        if abs(int(truth.stamps_ns[i]) - stamp_ns) > 1_000_000:
            continue
        grid = rays * np.where(depth < _UNKNOWN_M, depth, np.nan)[..., None]
        across, down = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
        normal = np.cross(across, down)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        step = np.maximum(np.abs(across[..., 2]), np.abs(down[..., 2]))
        good = np.isfinite(normal).all(axis=-1) & (step < 0.02 * grid[..., 2])
        first_from_cam = first_from_world @ truth.world_from_cam[i]
        points.append(se3.transform(first_from_cam, grid[good][::2]))
        normals.append(normal[good][::2] @ first_from_cam[:3, :3].T)
        in_cam = se3.transform(se3.inverse(first_from_cam), vertices)
        front = np.flatnonzero(in_cam[:, 2] > 0.1)
        u, v = np.rint(project_into_image(log.rig.left, in_cam[front])).astype(int).T
        inside = (u >= 0) & (v >= 0) & (u < depth.shape[1]) & (v < depth.shape[0])
        front, u, v = front[inside], u[inside], v[inside]
        judged[front[(depth[v, u] < _UNKNOWN_M) & (in_cam[front, 2] < depth[v, u] + _HIDDEN_M)]] = True
    return np.concatenate(points), np.concatenate(normals), judged


def distances(vertices: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Distances (n,), metres, to the true surface."""
    apart, nearest = cKDTree(points).query(vertices)
    plane = np.abs(np.einsum("ni,ni->n", vertices - points[nearest], normals[nearest]))
    return np.where(apart < _NEAR_M, plane, apart)


def coverage(log: StereoLog, mesh: Mesh, left: np.ndarray, depth: np.ndarray) -> float:
    """Share of the textured pixels of the left image with known depth that the mesh covers."""
    grey = left.astype(np.float32)
    mean, square = (cv2.blur(i, (_TEXTURE_PX, _TEXTURE_PX)) for i in (grey, grey * grey))
    textured = (square - mean**2 > _TEXTURE_GREY**2) & (depth < _UNKNOWN_M)
    pixels = np.rint(project_into_image(log.rig.left, mesh.vertices.astype(float))).astype(int)
    inside = ((pixels >= 0) & (pixels < left.shape[::-1])).all(axis=1)
    covered = np.zeros(left.shape, np.uint8)
    covered[pixels[inside, 1], pixels[inside, 0]] = 1
    covered = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return float(covered[textured].mean())


def describe(name: str, errors: np.ndarray, sigmas: np.ndarray) -> None:
    """Percentiles of the errors, and of error over σ: its median is 0.67, its 95th percentile 1.96 if σ is right."""
    p50, p90 = 1e3 * np.percentile(np.abs(errors), [50, 90])
    r50, r95 = np.percentile(np.abs(errors) / sigmas, [50, 95])
    gross = np.mean(np.abs(errors) > 5 * sigmas)
    print(f"  {name}: {len(errors)} points, median {p50:.2f} mm, 90 % {p90:.2f} mm; "
          f"median σ {1e3 * np.median(sigmas):.2f} mm; error/σ median {r50:.2f}, 95 % {r95:.2f}, "
          f"beyond 5σ {100 * gross:.1f} %")  # fmt: skip


def measure(path: Path, whole: bool, config: Config) -> None:
    """One log."""
    log = open_log(path)
    began_s = time.process_time()
    reconstructed = surface(log, None if whole else 0, config)
    mesh = reconstructed.mesh
    cpu_s = time.process_time() - began_s
    print(f"{path.name}: {len(mesh.vertices)} vertices of {reconstructed.used} frames, {cpu_s:.1f} s CPU")
    if not whole:
        stamp_ns, depth = next(log.depths())
        frame = next(f for f in itertools.islice(log.frames(), 1))
        assert frame.stamp_ns == stamp_ns, "the first frame has no ground-truth depth"
        print(f"  textured pixels covered: {100 * coverage(log, mesh, frame.left, depth):.1f} %")
        ray = mesh.vertices.astype(float)
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        cov = (mesh.std_m.astype(float) ** 2)[:, None, None] * ray[:, :, None] * ray[:, None, :]
        true = np.where(depth < _UNKNOWN_M, depth, np.nan)
        found = structure_errors(log.rig.left, mesh.vertices.astype(float), cov, true)
        describe("depth, away from edges", found.errors_m, found.sigmas_m)
    points, normals, judged = true_surface(log, mesh.vertices)
    errors = distances(mesh.vertices[judged], points, normals)
    describe("distance to the true surface", errors, mesh.std_m[judged])


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--all", action="store_true", help="all frames fused instead of the first one")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args()
    for path in arguments.logs:
        measure(path, arguments.all, read_config(None, arguments.overrides))


if __name__ == "__main__":
    main()
