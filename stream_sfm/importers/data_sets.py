"""Data sets and folders of images to logs: each is opened as a source and copied."""

from collections.abc import Sequence
from pathlib import Path

from ..camera.rig import StereoRig
from ..sources.euroc import open_euroc
from ..sources.image_files import size_of
from ..sources.image_folders import first_image, open_images
from ..sources.kitti import open_kitti
from .copy import Imported, copy_to_log


def import_kitti(
    folder: str | Path, out: str | Path, poses: str | Path | None = None, *, overwrite: bool = False
) -> Imported:
    """Convert one sequence of KITTI odometry to a log at `out`.

    `poses`: ground truth, 12 numbers per line; without it `poses.txt` in the folder and the data set's own place
    (`../../poses/NN.txt`) are looked at. `overwrite`: a file at `out` may be replaced. Raises InputError, ConfigError,
    OutputError.
    """
    return copy_to_log(open_kitti(Path(folder), poses), out, overwrite=overwrite, expects_poses=True)


def import_euroc(folder: str | Path, out: str | Path, *, overwrite: bool = False) -> Imported:
    """Convert the recording in `folder` (mav0, or the folder that contains it) to a log at `out`.

    `overwrite`: a file at `out` may be replaced. Raises InputError, ConfigError, OutputError.
    """
    return copy_to_log(open_euroc(Path(folder)), out, overwrite=overwrite, expects_poses=True)


def import_images(
    left: str | Sequence[str],
    right: str | Sequence[str],
    calibration: str | Path | Sequence[str | Path],
    out: str | Path,
    stamps: str | Path | None = None,
    rate_hz: float | None = None,
    *,
    overwrite: bool = False,
) -> Imported:
    """Convert the images `left` and `right`, paired in the order of their names, to a log at `out`.

    Each side is one or several files, folders or globs; `calibration` as in `StereoRig.from_calibration`. `stamps`: a
    file with one time per line, seconds with a decimal point or integer nanoseconds; without it names that are
    stamps are used, else the frames are put `rate_hz` apart. `overwrite`: a file at `out` may be replaced. Raises
    InputError, ConfigError, OutputError.
    """
    image = first_image(left)
    rig = StereoRig.from_calibration(calibration, None if image is None else size_of(image))
    return copy_to_log(open_images(left, right, rig, stamps, rate_hz), out, overwrite=overwrite)
