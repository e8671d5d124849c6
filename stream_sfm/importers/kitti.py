"""KITTI odometry: one sequence folder with calib.txt, times.txt, image_0 and image_1 (or image_2 and image_3).

Poses are camera 0 in the world; with the colour cameras they are carried into camera 2, the left one then.
"""

from pathlib import Path

import numpy as np

from ..camera.models import Camera
from ..errors import ConfigError, InputError
from ..geometry import se3
from ..geometry.se3 import Array
from .common import ImageFile, Imported, ascending, read_text, rig_of_files, seconds_to_ns, size_of, write_images


def import_kitti(folder: str | Path, out: str | Path, poses: str | Path | None = None) -> Imported:
    """The sequence in `folder` as a log at `out`.

    `poses`: ground truth, 12 numbers a row; without it `poses.txt` in the folder and the data set's own place
    (`../../poses/NN.txt`) are looked at. Raises InputError, ConfigError, OutputError.
    """
    folder = Path(folder)
    cameras = next((c for c in ((0, 1), (2, 3)) if all((folder / f"image_{i}").is_dir() for i in c)), None)
    if cameras is None:
        raise InputError(
            f"{folder} holds neither image_0 and image_1 nor image_2 and image_3: give the folder of one KITTI "
            "odometry sequence, such as dataset/sequences/00"
        )
    files = [sorted((folder / f"image_{i}").glob("*.png")) for i in cameras]
    times = [t for t in read_text(folder / "times.txt", "times").split() if t]
    stamps = [seconds_to_ns(t, f"{folder / 'times.txt'}, line {n}") for n, t in enumerate(times, start=1)]
    ascending(stamps, folder / "times.txt")
    if not files[0] or not files[1]:
        raise InputError(f"{folder}: image_{cameras[0]} and image_{cameras[1]} must hold .png images")
    images = tuple([ImageFile(_stamp(f, stamps), f) for f in side] for side in files)
    projections = _projections(folder / "calib.txt")
    left, right = (_camera_of(folder / "calib.txt", projections, i) for i in cameras)
    width, height = size_of(files[0][0])
    rig = rig_of_files(
        folder / "calib.txt",
        Camera(width, height, left[0], (), "none"),
        Camera(width, height, right[0], (), "none"),
        se3.from_rotation_translation(np.eye(3), right[1] - left[1]),
    )
    warnings: list[str] = []
    chosen = _poses_file(folder, poses)
    truth: list[tuple[int, Array]] = []
    if chosen is None:
        warnings.append("no ground truth: no file of poses was given or found beside the sequence")
    else:
        cam0_from_left = se3.from_rotation_translation(np.eye(3), -left[1])
        world_from_cam0 = _read_poses(chosen)
        if len(world_from_cam0) > len(stamps):
            raise InputError(f"{chosen} has {len(world_from_cam0)} poses for {len(stamps)} times in {folder}")
        if len(world_from_cam0) < len(stamps):
            warnings.append(f"{chosen} has poses for the first {len(world_from_cam0)} of {len(stamps)} frames")
        truth = list(zip(stamps, world_from_cam0 @ cam0_from_left, strict=False))
    return write_images(out, rig, (images[0], images[1]), truth, warnings)


def _stamp(file: Path, stamps: list[int]) -> int:
    """The stamp of an image: its name is its line in times.txt."""
    if not file.stem.isdecimal() or int(file.stem) >= len(stamps):
        raise InputError(f"{file}: the name is no number of a line in times.txt, which has {len(stamps)} lines")
    return stamps[int(file.stem)]


def _projections(path: Path) -> dict[str, Array]:
    found = {}
    for line in read_text(path, "calibration").splitlines():
        name, colon, numbers = line.partition(":")
        if colon and name.strip() in ("P0", "P1", "P2", "P3"):
            found[name.strip()] = _row(path, name, numbers).reshape(3, 4)
    return found


def _row(path: Path, where: object, text: str) -> Array:
    """12 finite numbers. Raises InputError."""
    try:
        row = np.array([float(x) for x in text.split()])
    except ValueError:
        row = np.empty(0)
    if row.shape != (12,) or not np.isfinite(row).all():
        raise InputError(f"{path}: {where} must be followed by 12 numbers, got {text.strip()[:60]!r}")
    return row


def _camera_of(path: Path, projections: dict[str, Array], index: int) -> tuple[Array, Array]:
    """K (3, 3) and the translation (3,) of camera `index` from camera 0, metres: P = K [I | t]."""
    p = projections.get(f"P{index}")
    if p is None:
        raise ConfigError(f"{path} has no line P{index}: the calibration of image_{index} is missing")
    try:
        return p[:, :3], np.asarray(np.linalg.solve(p[:, :3], p[:, 3]), dtype=float)
    except np.linalg.LinAlgError:
        raise ConfigError(f"{path}: P{index} is no projection matrix: {p.tolist()}") from None


def _poses_file(folder: Path, poses: str | Path | None) -> Path | None:
    if poses is not None:
        return Path(poses)
    resolved = folder.resolve()
    places = (folder / "poses.txt", resolved.parent.parent / "poses" / f"{resolved.name}.txt")
    return next((p for p in places if p.is_file()), None)


def _read_poses(path: Path) -> Array:
    """world_from_cam0 (n, 4, 4)."""
    lines = [line for line in read_text(path, "poses").splitlines() if line.strip()]
    rows = [_row(path, f"line {n}", line).reshape(3, 4) for n, line in enumerate(lines, start=1)]
    if not rows:
        raise InputError(f"{path} holds no pose")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows
    if not np.allclose(poses[:, :3, :3] @ poses[:, :3, :3].swapaxes(1, 2), np.eye(3), atol=1e-2):
        raise InputError(f"{path}: the first 3×3 numbers of a row are no rotation: is it KITTI's format?")
    return se3.orthonormalise(poses)
