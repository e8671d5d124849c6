"""Recordings that are folders: KITTI and its kin, EuRoC, TartanAir, folders of images or videos of left and right.

A data set is recognised by the folders of its two cameras and by files beside them; any other folder by the names
of its folders or files. To add a data set, add a line in `LAYOUTS` and the function that opens it.
"""

import os
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from os.path import exists, isdir
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...camera.calibration.document import camera_matrix
from ...camera.calibration.inertial import kalibr_noise
from ...camera.calibration.projections import cam_from_cam0, kitti_camera
from ...camera.calibration.read import has_calibration, is_calibration, read_document
from ...camera.calibration.slam import body_from_left
from ...camera.models import Camera
from ...camera.rig import StereoRig
from ...errors import ConfigError, LogError, as_error
from ...geometry import Array, se3
from ...inertial.samples import ImuCalibration
from ..mcap_file.message import Source
from .containers.video import VideoSource
from .four_seasons import SIDES, open_four_seasons
from .given import Given
from .image_files import ImageFile, ImageFilesSource
from .image_sets import ImageSides, image_sides, images_in, open_images
from .joined import JoinedSource
from .pose_files import (
    check_ascending,
    read_euroc,
    read_kitti,
    read_rows,
    read_stamped,
    read_table,
    read_text,
    read_times,
)
from .sides import possible_pairs

_CONTENTS = {
    "KITTI": "image_0 and image_1 (or 2 and 3): one sequence, or one drive of its raw data (…_sync)",
    "EuRoC": "mav0 with cam0 and cam1",
}
_FORM = re.compile(" (odometry|raw)$")  # of one data set
_STAMPS = ("times.txt", "stamps.txt", "timestamps.txt")
_EUROC_FILES = ("cam0/sensor.yaml", "cam1/sensor.yaml", "cam0/data.csv", "cam1/data.csv")
_EUROC_TRUTHS = ("state_groundtruth_estimate0/data.csv", "mocap0/data.csv", "gt/data.csv")
_EUROC_CALIBRATIONS = ("", "..", "../dso", "../calibration")  # relative to mav0, where one for all cameras may be
# σ of ground truth, m and rad. EuRoC's Vicon and Leica: 1 mm (Burri et al., 2016), over the half metre of the body.
# KITTI's OXTS: 2 cm with RTK (data sheet); its axes differ from those of the cameras by up to 9 mrad, taken as 2 σ.
_STD_EUROC, _STD_KITTI = (0.001, 0.002), (0.02, 0.0045)
_VIDEO_SUFFIXES = (".mp4", ".m4v", ".mkv", ".avi", ".mov", ".webm", ".ts")
# All cameras of TartanAir are identical and parallel.
_TARTANAIR_F_PX, _TARTANAIR_BASELINE_M = 320.0, 0.25
_VIRTUAL_KITTI_BASELINE_M = 0.532725
# The columns are right, down and forward of the camera in the axes of TartanAir's poses: x forward, y right, z
# down.
_BODY_FROM_CAM = se3.from_rotation_translation([[0, 0, 1], [1, 0, 0], [0, 1, 0]], [0, 0, 0])


class Layout(NamedTuple):
    """A layout of a recording: folders of left and right, one of the files is present; `also`: another data set."""

    name: str
    open: Callable[[Path, "Layout", Given], ImageFilesSource]
    sides: tuple[str, str]
    files: Sequence[str]
    also: str = ""

    def has_sides(self, folder: Path) -> bool:
        """Whether a folder contains the folders of left and right."""
        return all(isdir(folder / side) for side in self.sides)  # Path.is_dir raises OSError if a name is too long

    def fits(self, folder: Path) -> bool:
        return self.has_sides(folder) and any(exists(folder / name) for name in self.files)


def open_folder(folder: Path, given: Given) -> Source | None:
    """Return the recording in a folder; None if no layout fits. Raises LogError, ConfigError."""
    if (layout := next((layout for layout in LAYOUTS if layout.fits(folder)), None)) is not None:
        return layout.open(folder, layout, given)
    found = _open_videos(folder, given) or _open_images(folder, given)
    if found is None and len(videos := videos_in(folder)) == 1:
        return VideoSource(videos[0])
    return found


def known_data_sets() -> list[str]:
    return list(dict.fromkeys(name for layout in LAYOUTS for name in (_FORM.sub("", layout.name), layout.also) if name))


def is_data_set(folder: Path) -> bool:
    """Whether `open_folder` knows a folder."""
    known = any(layout.fits(folder) for layout in LAYOUTS) or _videos(folder) is not None
    return known or image_sides(folder) is not None


def open_data_set(folder: Path, name: str, given: Given) -> ImageFilesSource:
    """Return the recording in a folder that must have the layout of KITTI or EuRoC. Raises LogError, ConfigError."""
    for layout in LAYOUTS:
        if layout.name.startswith(name) and layout.has_sides(folder):
            if layout.fits(folder):
                return layout.open(folder, layout, given)
            raise LogError(f"{folder} has no {Path(layout.files[0]).name}: it is a part of the data set")
    raise LogError(f"{folder} is not laid out like {name}: give the folder that holds {_CONTENTS[name]}")


def _open_kitti(folder: Path, layout: Layout, given: Given) -> ImageFilesSource:
    files = [sorted((folder / side).glob("*.png")) for side in layout.sides]
    if not files[0] or not files[1]:
        raise LogError(f"{folder}: {layout.sides[0]} and {layout.sides[1]} must hold .png images")
    if layout.name == "KITTI odometry":
        stamps = read_times(folder / "times.txt")
    else:
        stamps = _read_dates((folder / layout.sides[0]).with_name("timestamps.txt"))
    for file in (*files[0], *files[1]):
        if not file.stem.isdecimal() or int(file.stem) >= len(stamps):
            raise LogError(f"{file}: its name is not the number of one of the {len(stamps)} times")
    left, right = ([ImageFile(stamps[int(file.stem)], file) for file in side] for side in files)
    rig: StereoRig | None = None
    cam0_from_left = np.eye(4)
    try:
        rig, cam0_from_left = _kitti_rig(folder, layout, left[0].size())
    except ConfigError:
        if not given.calibrated:
            raise
    known = rig is not None or re.match("image_0?0", layout.sides[0])  # of camera 0, to which the poses belong
    notes, truth = list[str](), list[tuple[int, Array]]()
    truth_file = _kitti_truth(folder) if given.poses is None else Path(given.poses)
    if truth_file is not None and not known:
        notes.append(f"{truth_file} is not used: its poses are camera 0's, and no calibration says where that is")
    elif truth_file is not None:
        world_from_left = read_kitti(truth_file) @ cam0_from_left
        if (count := len(world_from_left)) > len(stamps):
            raise LogError(f"{truth_file} has {count} poses for {len(stamps)} times in {folder}")
        if count < len(stamps):
            notes.append(f"{truth_file} has poses for the first {count} of {len(stamps)} frames")
        truth = list(zip(stamps, world_from_left, strict=False))
    used = None if given.calibrated else rig
    return ImageFilesSource(folder, layout.name, used, (left, right), truth, notes, std_truth=_STD_KITTI)


def _kitti_rig(folder: Path, layout: Layout, size: tuple[int, int]) -> tuple[StereoRig, Array]:
    """Return the rig, and the pose (4, 4) of the left camera in camera 0. Raises ConfigError."""
    document = read_document(next(folder / name for name in layout.files if exists(folder / name)))
    cameras = [int(re.findall(r"\d+", side)[0]) for side in layout.sides]
    left_from_cam0, right_from_cam0 = (cam_from_cam0(document, number, size) for number in cameras)
    cam0_from_left = se3.inverse(left_from_cam0)
    left, right = (kitti_camera(document, number, size) for number in cameras)
    with document.naming():
        return StereoRig(left, right, right_from_cam0 @ cam0_from_left), cam0_from_left


def _kitti_truth(folder: Path) -> Path | None:
    resolved = folder.resolve()
    own = folder / "poses.txt", resolved.parent.parent / "poses" / f"{resolved.name}.txt"
    return next((p for p in own if p.is_file()), None)


def _read_dates(path: Path) -> list[int]:
    """Return the stamps in a file of KITTI's raw data, nanoseconds, ascending: each line is a date with nanoseconds."""
    stamps = []
    for number, line in enumerate(read_text(path, "times").split("\n"), start=1):
        if line.strip():
            try:
                stamps.append(int(np.datetime64(line.strip().replace(" ", "T"), "ns").astype(np.int64)))
            except ValueError:
                raise LogError(f"{path}, line {number} is not a date: {line.strip()!r}") from None
    check_ascending(stamps, path)
    return stamps


def _open_euroc(folder: Path, layout: Layout, given: Given) -> ImageFilesSource:
    """Open a recording. Ground truth of the body is moved to the left camera if a calibration says how."""
    cameras = [folder / side for side in layout.sides]
    poses, notes = list[tuple[int, Array]](), list[str]()
    mav, images = cameras[0].parent, (_euroc_images(cameras[0], notes), _euroc_images(cameras[1], notes))
    rig: StereoRig | None = None
    body_from_cam: Array | None = None
    try:
        rig, body_from_cam = _euroc_rig(mav, cameras)
    except ConfigError:
        if not given.calibrated:
            raise
    truth_file = next((mav / name for name in _EUROC_TRUTHS if (mav / name).is_file()), None)
    if truth_file is not None and body_from_cam is not None:
        truth = read_euroc(truth_file)
        poses += zip(truth.stamps_ns.tolist(), truth.world_from_cam @ body_from_cam, strict=True)
    elif truth_file is not None:
        notes.append(f"{truth_file} is not used: no calibration says where the camera is on the body")
    imu = None if body_from_cam is None else _euroc_imu(mav / "imu0", se3.inverse(body_from_cam), notes)
    used = None if given.calibrated else rig
    return ImageFilesSource(folder, layout.name, used, images, poses, notes, imu, _STD_EUROC)


def _euroc_imu(
    folder: Path, cam_from_body: Array, notes: list[str]
) -> tuple[list[tuple[int, Array]], ImuCalibration] | None:
    """Return the samples of the inertial unit, which is the body, and its noise if a file contains it."""
    if not (path := folder / "data.csv").is_file():
        return None
    try:
        stamps, rows = read_stamped(path, 6, "`stamp wx wy wz ax ay az`")
        sensor = folder / "sensor.yaml"
        document = read_document(sensor) if sensor.is_file() else None
        noise = {} if document is None else kalibr_noise(document)
        return list(zip(stamps, rows, strict=True)), ImuCalibration(cam_from_body, **noise)
    except (LogError, ConfigError) as error:
        notes.append(f"the IMU is not used: {error}")
        return None


def _euroc_rig(mav: Path, cameras: Sequence[Path]) -> tuple[StereoRig | None, Array | None]:
    """Return the rig, and the pose of the left camera on the body, as far as files contain them.

    Each camera may have a file (sensor.yaml), or one file for all may have the pose of the IMU (Kalibr, Basalt).
    """
    sensors = [camera / "sensor.yaml" for camera in cameras]
    if any(sensor.is_file() for sensor in sensors):
        rig = StereoRig.from_calibration(sensors)
        return rig, body_from_left(read_document(sensors[0]))
    for place in (mav / name for name in _EUROC_CALIBRATIONS):
        files = sorted(p for p in place.glob("*.*") if p.suffix in (".yaml", ".yml", ".json") and is_calibration(p))
        for file in files:
            with suppress(ConfigError):  # a file may be something else
                rig = StereoRig.from_calibration(file)
                return rig, body_from_left(read_document(file))
    return None, None


def _euroc_images(folder: Path, notes: list[str]) -> list[ImageFile]:
    """Return the images of a camera in its table; without a table, their names are the stamps."""
    path, data = folder / "data.csv", folder / "data"
    files = images_in(data) if isdir(data) else []
    if path.is_file():
        listed, names = [], {file.name for file in files}
        for number, cells in read_table(path, "table"):
            if len(cells) < 2 or not cells[0].isdecimal():
                raise LogError(f"{path}, line {number} is not a stamp in nanoseconds and a name: {cells}")
            listed.append(ImageFile(int(cells[0]), data / cells[1]))
        images = [image for image in listed if image.path.name in names]
        if 0 < len(images) < len(listed):
            missing = f"{len(listed) - len(images)} of {len(listed)}"
            notes.append(f"{missing} images in {path} are not in the folder {data}")
    else:
        images = [ImageFile(int(file.stem), file) for file in files if file.stem.isdecimal()]
        images.sort(key=lambda image: image.stamp_ns)
    if not images:
        raise LogError(f"{path} must list stamps and names of files that are in {data}, one per line")
    check_ascending([image.stamp_ns for image in images], path)
    return images


def _open_tartanair(folder: Path, layout: Layout, given: Given) -> ImageFilesSource:
    """Open a recording whose images and lines of poses are numbered; there may be fewer of either."""
    poses = folder / layout.files[0]
    if not poses.is_file() and has_calibration(folder) and (own := _open_images(folder, given)) is not None:
        return own  # other images with the same names
    left, right = (str(folder / side) for side in layout.sides)
    source = open_images(left, right, None, rate_hz=given.rate_hz, path=folder)
    width, height = source.images[0][0].size()
    k = camera_matrix(_TARTANAIR_F_PX, _TARTANAIR_F_PX, width / 2, height / 2)
    camera = Camera(width, height, k, (), "none")
    rig = StereoRig(camera, camera, se3.exp([-_TARTANAIR_BASELINE_M, 0, 0, 0, 0, 0]))
    truth, notes = list[tuple[int, Array]](), list(source.notes)
    if poses.is_file():
        rows = read_rows(poses, 7, "`x y z qx qy qz qw`")
        rotations = se3.matrix_from_quat_xyzw(rows[:, 3:])
        world_from_cam = se3.from_rotation_translation(rotations, rows[:, :3]) @ _BODY_FROM_CAM
        in_cam_axes = se3.inverse(_BODY_FROM_CAM) @ world_from_cam
        numbers = [int(found[0]) if (found := re.findall(r"\d+", i.path.stem)) else -1 for i in source.images[0]]
        of = [(i.stamp_ns, n) for i, n in zip(source.images[0], numbers, strict=True) if 0 <= n < len(rows)]
        truth = [(stamp_ns, in_cam_axes[n]) for stamp_ns, n in of]
        if len(rows) != len(numbers):
            notes.append(f"{poses} has {len(rows)} poses for {len(numbers)} images: {len(truth)} belong together")
    return ImageFilesSource(folder, layout.name, None if given.calibrated else rig, source.images, truth, notes)


def _open_virtual_kitti(folder: Path, layout: Layout, given: Given) -> ImageFilesSource:
    """Open a variant of a scene: two equal, parallel cameras; tables have a line per frame and camera."""
    left, right = (str(folder / side) for side in layout.sides)
    source = open_images(left, right, None, rate_hz=given.rate_hz, path=folder)
    path = folder / layout.files[0]
    lines = [cells for _, cells in read_table(path, "intrinsics") if cells[0].isdecimal()]
    try:
        k = camera_matrix(*map(float, next(cells for cells in lines if cells[1] == "0")[2:6]))
    except (StopIteration, ValueError, TypeError, IndexError):
        raise LogError(f"{path} has no line `frame cameraID fx fy cx cy` of camera 0") from None
    camera = Camera(*source.images[0][0].size(), k, (), "none")
    rig = StereoRig(camera, camera, se3.exp([-_VIRTUAL_KITTI_BASELINE_M, 0, 0, 0, 0, 0]))
    truth = list[tuple[int, Array]]()
    if (poses := folder / "extrinsic.txt").is_file():
        with as_error(LogError, f"{poses} is not `frame cameraID` and a 4×4 matrix per line", ValueError):
            rows = [list(map(float, cells)) for _, cells in read_table(poses, "poses") if cells[0].isdecimal()]
            of = {int(row[0]): np.reshape(row[2:], (4, 4)) for row in rows if row[1] == 0}
        numbered = [(image.stamp_ns, int(re.findall(r"\d+", image.path.stem)[-1])) for image in source.images[0]]
        truth = [(stamp_ns, se3.inverse(se3.orthonormalise(of[n]))) for stamp_ns, n in numbered if n in of]
    used = None if given.calibrated else rig
    return ImageFilesSource(folder, layout.name, used, source.images, truth, source.notes)


def _open_images(folder: Path, given: Given) -> ImageFilesSource | None:
    """Open images by the names of their folders or their own, with stamps and calibration beside them, if any."""
    sides = image_sides(folder)
    if sides is None and given.mono and images_in(folder):
        sides = ImageSides(str(folder), ())
    if sides is None:
        return None
    stamps = next((folder / name for name in _STAMPS if (folder / name).is_file()), None)
    stamps = stamps if given.rate_hz is None else None
    source = open_images(sides.left, sides.right, None, stamps, given.rate_hz, path=folder)
    rig = _rig_in(folder, given, source.images[0][0].size)
    others = [f"{other} hold images, too, which are not used" for other in sides.others]
    return ImageFilesSource(folder, source.format, rig, source.images, notes=[*source.notes, *others])


def _rig_in(folder: Path, given: Given, size: Callable[[], tuple[int, int]]) -> StereoRig | None:
    """Return the rig of the calibration in a folder, if there is one, for images of this size."""
    if given.calibrated or not has_calibration(folder):
        return None
    return StereoRig.from_calibration(folder, size())


def _open_videos(folder: Path, given: Given) -> Source | None:
    """Open videos of left and right, with the calibration beside them, if there is one."""
    if (videos := _videos(folder)) is None:
        return None
    rig = _rig_in(folder, given, lambda: VideoSource(videos[0]).size)
    return JoinedSource(folder, [VideoSource(path, side, rig) for side, path in enumerate(videos)])


def videos_in(folder: Path) -> list[Path]:
    return [folder / name for name in sorted(os.listdir(folder)) if name.lower().endswith(_VIDEO_SUFFIXES)]


def _videos(folder: Path) -> tuple[Path, Path] | None:
    """Return the videos of left and right in a folder."""
    pairs = possible_pairs(path.name for path in videos_in(folder))
    return (folder / pairs[0][0], folder / pairs[0][1]) if len(pairs) == 1 else None


_KITTI_RAW = ("calib_cam_to_cam.txt", "../calib_cam_to_cam.txt")
LAYOUTS = (
    Layout("KITTI odometry", _open_kitti, ("image_0", "image_1"), ("calib.txt",)),
    Layout("KITTI odometry", _open_kitti, ("image_2", "image_3"), ("calib.txt",)),
    Layout("KITTI raw", _open_kitti, ("image_00/data", "image_01/data"), _KITTI_RAW),
    Layout("KITTI raw", _open_kitti, ("image_02/data", "image_03/data"), _KITTI_RAW),
    Layout("KITTI-360", _open_kitti, ("image_00/data_rect", "image_01/data_rect"),
           ("../../calibration/perspective.txt",)),
    Layout("Virtual KITTI 2", _open_virtual_kitti, ("frames/rgb/Camera_0", "frames/rgb/Camera_1"), ("intrinsic.txt",)),
    Layout("4Seasons", open_four_seasons, SIDES, SIDES),
    Layout("EuRoC", _open_euroc, ("mav0/cam0", "mav0/cam1"), [f"mav0/{name}" for name in _EUROC_FILES], "TUM-VI"),
    Layout("EuRoC", _open_euroc, ("cam0", "cam1"), _EUROC_FILES),
    Layout("TartanAir", _open_tartanair, ("image_left", "image_right"),
           ("pose_left.txt", "image_left/000000_left.png")),
    Layout("TartanAir", _open_tartanair, ("image_lcam_front", "image_rcam_front"),
           ("pose_lcam_front.txt", "image_lcam_front/000000_lcam_front.png")),
)  # fmt: skip
