"""EuRoC and what is laid out like it, such as TUM-VI: mav0 with cam0, cam1 and a table of ground truth.

Ground truth is the body in the world; it is carried into the left camera here, by the calibration of each camera
(sensor.yaml), or by one for all of them that says where the IMU is (Kalibr's camchain, Basalt's).
"""

from contextlib import suppress
from os.path import isdir, isfile
from pathlib import Path

from ..camera.calibration import euroc, kalibr
from ..camera.calibration.document import load
from ..camera.calibration.read import is_calibration
from ..camera.rig import StereoRig
from ..errors import ConfigError, LogError
from ..geometry.se3 import Array
from .image_files import ImageFile, ImageFilesSource
from .image_folders import IMAGE_SUFFIXES
from .pose_files import read_euroc
from .text_files import check_ascending, read_table, read_text

_SENSOR, _TABLE = "sensor.yaml", "data.csv"  # of each camera
_TRUTHS = ("state_groundtruth_estimate0/data.csv", "mocap0/data.csv", "gt/data.csv")
_CALIBRATIONS = ("", "..", "../dso", "../calibration")  # folders from mav0, where one for all cameras may be


def is_euroc(folder: Path) -> bool:
    """Whether a folder is, or contains, a recording laid out like EuRoC's."""
    return _mav(folder) is not None


def open_euroc(folder: Path) -> ImageFilesSource:
    """The recording in `folder`: mav0, or what contains it. Raises LogError; ConfigError for its calibration."""
    mav = _mav(folder)
    if mav is None:
        raise LogError(f"{folder} holds no mav0 with cam0 and cam1: give the folder of one EuRoC recording")
    cameras = [mav / name for name in ("cam0", "cam1")]
    images = _images(cameras[0]), _images(cameras[1])
    rig, body_from_left = _rig(mav, cameras)
    truth_file = next((mav / name for name in _TRUTHS if (mav / name).is_file()), None)
    if truth_file is None:
        return ImageFilesSource(folder, "EuRoC", rig, images)
    if body_from_left is None:
        note = f"{truth_file} is not used: no calibration says where the camera is on the body whose poses they are"
        return ImageFilesSource(folder, "EuRoC", rig, images, notes=[note])
    truth = read_euroc(truth_file)
    poses = list(zip(truth.stamps_ns.tolist(), truth.world_from_cam @ body_from_left, strict=True))
    return ImageFilesSource(folder, "EuRoC", rig, images, poses)


def _rig(mav: Path, cameras: list[Path]) -> tuple[StereoRig | None, Array | None]:
    """The rig, and the pose of the left camera on the body, as far as files say it."""
    sensors = [camera / _SENSOR for camera in cameras]
    if any(sensor.is_file() for sensor in sensors):
        rig = StereoRig.from_calibration(sensors)
        return rig, euroc.body_from_cam(load(read_text(sensors[0], "calibration").encode(), sensors[0]))
    for place in (mav / name for name in _CALIBRATIONS):
        files = sorted(p for p in place.glob("*.*") if p.suffix in (".yaml", ".yml", ".json") and is_calibration(p))
        for file in files:
            with suppress(ConfigError):  # a file may be of something else
                rig = StereoRig.from_calibration(file)
                return rig, kalibr.body_from_left(load(read_text(file, "calibration").encode(), file))
    return None, None


def _mav(folder: Path) -> Path | None:
    for mav in (folder / "mav0", folder):
        cameras = mav / "cam0", mav / "cam1"
        # Folders of these names may hold images alone.
        known = any(isfile(camera / name) for camera in cameras for name in (_SENSOR, _TABLE))
        if known and all(isdir(camera) for camera in cameras):
            return mav
    return None


def _images(folder: Path) -> list[ImageFile]:
    """The images of a camera by its table; without one, their names are the stamps."""
    path, images = folder / _TABLE, []
    if not path.is_file():
        found = [
            p for p in sorted((folder / "data").glob("*")) if p.suffix in IMAGE_SUFFIXES and p.stem.isdecimal()
        ]
        images = sorted((ImageFile(int(p.stem), p) for p in found), key=lambda image: image.stamp_ns)
    for number, cells in read_table(path, "table") if path.is_file() else ():
        if len(cells) < 2 or not cells[0].isdecimal():
            raise LogError(f"{path}, line {number} is not a stamp in nanoseconds and the name of an image: {cells}")
        images.append(ImageFile(int(cells[0]), folder / "data" / cells[1]))
    if not images:
        raise LogError(f"{path} must list stamps and file names, one image per line")
    check_ascending([image.stamp_ns for image in images], path)
    return images
