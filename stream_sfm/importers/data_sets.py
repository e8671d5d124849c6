"""Data sets and folders of images as logs: each is opened as a source, whose messages are copied unchanged."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..camera.rig import StereoRig, baseline_warnings
from ..errors import InputError, OutputError
from ..files import make_folder
from ..mcap_file.message import Damage
from ..outputs import refuse_overwriting
from ..recording.log_writer import MessageWriter
from ..sources.data_sets import open_euroc, open_kitti
from ..sources.image_files import ImageFilesSource, size_of
from ..sources.image_sets import first_image, open_images


@dataclass(frozen=True, slots=True)
class Imported:
    """What was written: the number of images on each side, of ground-truth poses, and what to know about it."""

    path: Path
    left: int
    right: int
    poses: int
    warnings: list[str] = field(default_factory=list)


def import_kitti(
    folder: str | Path, out: str | Path, poses: str | Path | None = None, *, overwrite: bool = False
) -> Imported:
    """Convert one sequence of KITTI odometry to a log at `out`.

    `poses`: ground truth, 12 numbers per line; without it `poses.txt` in the folder and the data set's own place
    (`../../poses/NN.txt`) are looked at. `overwrite`: a file at `out` may be replaced. Raises InputError, ConfigError,
    OutputError.
    """
    return _copy_to_log(open_kitti(Path(folder), poses), out, overwrite=overwrite, expects_poses=True)


def import_euroc(folder: str | Path, out: str | Path, *, overwrite: bool = False) -> Imported:
    """Convert the recording in `folder` (mav0, or the folder that contains it) to a log at `out`.

    `overwrite`: a file at `out` may be replaced. Raises InputError, ConfigError, OutputError.
    """
    return _copy_to_log(open_euroc(Path(folder)), out, overwrite=overwrite, expects_poses=True)


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
    return _copy_to_log(open_images(left, right, rig, stamps, rate_hz), out, overwrite=overwrite)


def _copy_to_log(
    source: ImageFilesSource, out: str | Path, *, overwrite: bool = False, expects_poses: bool = False
) -> Imported:
    """Write all messages of a source to `out`, whose folder is made if need be.

    `overwrite`: a file that is there may be replaced, but no file of the source. `expects_poses`: the lack of ground
    truth is worth a warning. Raises InputError for an image that cannot be read, OutputError.
    """
    check_free(Path(out), [source.path, *(image.path for side in source.images for image in side)], overwrite)
    damage = Damage()
    with MessageWriter(out) as log:
        for message in source.messages(damage):
            if not damage.complete:
                break
            log.write(message)
        if not damage.complete:  # what a replay would skip is not left out of a copy
            raise InputError(damage.notes[-1])
    warnings = [*source.notes, *(baseline_warnings(source.rig) if source.rig is not None else ())]
    if expects_poses and not source.poses:
        warnings.append(f"no ground truth was found for {source.path}")
    left, right = source.images
    return Imported(Path(out), len(left), len(right), len(source.poses), warnings)


def check_free(out: Path, inputs: Iterable[Path], overwrite: bool) -> None:
    """Make the folder of `out`. Raises OutputError where something is there that is not to be replaced."""
    if os.path.lexists(out) and not overwrite:
        raise OutputError(
            f"{out} exists already: choose another name, or allow it to be replaced", hint=("overwrite",)
        )
    refuse_overwriting([out], inputs)
    make_folder(out.parent)
