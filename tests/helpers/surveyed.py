"""Surveyed test points of a log with ground truth, written as a file that `--test-points` reads."""

from pathlib import Path

import numpy as np

from stream_sfm.camera.lens import project_into_image
from stream_sfm.camera.rig import StereoRig
from stream_sfm.evaluation.surveyed_points import SurveyedPoints
from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array

SURVEY_FROM_WORLD = se3.exp([4.0, -2.0, 1.0, 0.4, -0.8, 0.2])
_MARGIN_PX = 2.0


def survey(
    rig: StereoRig, world_from_cam: Array, *, world: str = "first camera", std_px: float = 0.0, seed: int = 0
) -> SurveyedPoints:
    """Points in front of each camera of a path, seen wherever they are in both images, with noise `std_px`."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1.5, 3.0, (len(world_from_cam), 4, 1))
    sides = rng.uniform(-1, 1, (len(world_from_cam), 4, 2)) * (0.3, 0.2) * depth
    cameras = se3.inverse(world_from_cam[0]) @ world_from_cam
    points = np.concatenate(
        [se3.transform(c, np.concatenate([s, d], 1)) for c, s, d in zip(cameras, sides, depth, strict=True)]
    )
    rows, frames, pixels = [], [], []
    for frame, camera in enumerate(cameras):
        left = se3.transform(se3.inverse(camera), points)
        right = se3.transform(rig.right_from_left, left)
        ahead = np.flatnonzero((left[:, 2] > 0.5) & (right[:, 2] > 0.5))
        seen = [project_into_image(c, p[ahead]) for c, p in ((rig.left, left), (rig.right, right))]
        both = np.concatenate(seen, axis=1) + std_px * rng.normal(size=(len(ahead), 4))
        size = np.tile([rig.left.width, rig.left.height], 2) - 1 - _MARGIN_PX
        inside = ((both > _MARGIN_PX) & (both < size)).all(axis=1)
        rows += ahead[inside].tolist()
        frames += [frame] * int(inside.sum())
        pixels.append(both[inside])
    origin = {"survey": SURVEY_FROM_WORLD, "ground truth": world_from_cam[0]}.get(world, np.eye(4))
    z = np.concatenate(pixels)
    return SurveyedPoints(
        tuple(f"p{k}" for k in range(len(points))),
        se3.transform(origin, points),
        np.array(rows, np.int64),
        np.array(frames, np.int64),
        np.zeros(len(rows), np.int64),
        z[:, :2],
        z[:, 2:],
        world,  # type: ignore[arg-type]
        std_px or 0.5,
    )


def write_points(path: Path, points: SurveyedPoints) -> Path:
    """Write them as TOML."""
    lines = [f'world = "{points.world}"', f"std_px = {points.std_px}", f"std_m = {points.std_m}", "", "[points]"]
    lines += [f"{name} = {xyz.tolist()}" for name, xyz in zip(points.names, points.positions_m, strict=True)]
    for k, row in enumerate(points.point_rows):
        lines += ["", "[[seen]]", f'point = "{points.names[row]}"', f"frame = {points.frames[k]}"]
        lines += [f"left = {points.left_px[k].tolist()}"]
        if np.isfinite(points.right_px[k]).all():
            lines += [f"right = {points.right_px[k].tolist()}"]
    path.write_text("\n".join(lines) + "\n")
    return path
