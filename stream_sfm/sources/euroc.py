"""EuRoC (and what is laid out like it): mav0 with cam0, cam1 and state_groundtruth_estimate0.

Ground truth is the body in the world; it is carried into the left camera here.
"""

from os.path import isdir, isfile
from pathlib import Path

from ..camera.calibration import euroc
from ..camera.calibration.document import load
from ..camera.rig import StereoRig
from ..errors import LogError
from .image_files import ImageFile, ImageFilesSource
from .pose_files import read_euroc
from .text_files import check_ascending, read_table, read_text

_FILES = ("sensor.yaml", "data.csv")  # of each camera
_TRUTH = "state_groundtruth_estimate0/data.csv"


def is_euroc(folder: Path) -> bool:
    """Whether a folder is, or contains, a recording laid out like EuRoC's."""
    return _mav(folder) is not None


def open_euroc(folder: Path) -> ImageFilesSource:
    """The recording in `folder`: mav0, or what contains it. Raises LogError; ConfigError for its calibration."""
    mav = _mav(folder)
    if mav is None:
        raise LogError(f"{folder} holds no mav0 with cam0 and cam1: give the folder of one EuRoC recording")
    cameras = [mav / name for name in ("cam0", "cam1")]
    rig = StereoRig.from_calibration([camera / "sensor.yaml" for camera in cameras])
    left, right = (_images(camera) for camera in cameras)
    truth_file = mav / _TRUTH
    if not truth_file.is_file():
        return ImageFilesSource(folder, "EuRoC", rig, (left, right))
    truth = read_euroc(truth_file)
    sensor = cameras[0] / "sensor.yaml"
    body_from_left = euroc.body_from_cam(load(read_text(sensor, "calibration").encode(), sensor))
    poses = list(zip(truth.stamps_ns.tolist(), truth.world_from_cam @ body_from_left, strict=True))
    return ImageFilesSource(folder, "EuRoC", rig, (left, right), poses)


def _mav(folder: Path) -> Path | None:
    for mav in (folder / "mav0", folder):
        cameras = mav / "cam0", mav / "cam1"
        # Folders of these names may hold images alone.
        known = any(isfile(camera / name) for camera in cameras for name in _FILES)
        if known and all(isdir(camera) for camera in cameras):
            return mav
    return None


def _images(folder: Path) -> list[ImageFile]:
    path = folder / "data.csv"
    images = []
    for number, cells in read_table(path, "table"):
        if len(cells) < 2 or not cells[0].isdecimal():
            raise LogError(f"{path}, line {number} is not a stamp in nanoseconds and the name of an image: {cells}")
        images.append(ImageFile(int(cells[0]), folder / "data" / cells[1]))
    if not images:
        raise LogError(f"{path} must list stamps and file names, one image per line")
    check_ascending([image.stamp_ns for image in images], path)
    return images
