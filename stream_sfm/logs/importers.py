"""Copies to MCAP: from data sets and folders of images (docs/log-profile.md), and from damaged files.

The data sets are read in `logs/sources/`, which `open_log` also uses: an import copies the messages of a source.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..camera.rig import StereoRig, baseline_warnings
from ..errors import InputError, LogError
from ..system.files import make_folder
from ..system.inputs import LIMITS
from ..system.outputs import refuse_existing, refuse_overwriting
from .mcap_file.log_file import LogFile
from .mcap_file.log_writer import MessageWriter
from .mcap_file.message import Damage
from .sources.data_sets import open_data_set
from .sources.given import Given
from .sources.image_files import ImageFile, ImageFilesSource
from .sources.image_sets import first_image, open_images


@dataclass(frozen=True, slots=True)
class Imported:
    """What was written: the number of images on each side and of ground-truth poses, with warnings."""

    path: Path
    left: int
    right: int
    poses: int
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Recovered:
    """What was copied to `path`: messages by topic, attachments and metadata records.

    `complete`: nothing was lost, as far as the file shows; `warnings` say what is wrong with it, and where.
    """

    path: Path
    messages: dict[str, int]
    attachments: int = 0
    metadata: int = 0
    complete: bool = True
    warnings: list[str] = field(default_factory=list)


def import_kitti(
    folder: str | Path, out: str | Path, poses: str | Path | None = None, *, overwrite: bool = False
) -> Imported:
    """Convert one sequence of KITTI odometry to a log at `out`.

    `poses`: ground truth, 12 numbers per line; without it, `poses.txt` in the folder and the usual place in the
    data set (`../../poses/NN.txt`) are tried. `overwrite`: a file at `out` may be replaced. Raises InputError,
    ConfigError, OutputError.
    """
    source = open_data_set(Path(folder), "KITTI", Given(poses=poses))
    return _copy_to_log(source, out, overwrite=overwrite, expects_poses=True)


def import_euroc(folder: str | Path, out: str | Path, *, overwrite: bool = False) -> Imported:
    """Convert the recording in `folder` (mav0, or the folder that contains it) to a log at `out`.

    `overwrite`: a file at `out` may be replaced. Raises InputError, ConfigError, OutputError.
    """
    source = open_data_set(Path(folder), "EuRoC", Given())
    return _copy_to_log(source, out, overwrite=overwrite, expects_poses=True)


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
    """Convert the images `left` and `right`, paired by the numbers in their names or else in order, to a log at `out`.

    Each side is one or several files, folders or globs; `calibration` as in `StereoRig.from_calibration`. `stamps`: a
    file with one time per line, seconds with a decimal point or integer nanoseconds; without it names that are
    stamps are used, otherwise frames follow at `rate_hz`. `overwrite`: a file at `out` may be replaced. Raises
    InputError, ConfigError, OutputError.
    """
    image = first_image(left)
    rig = StereoRig.from_calibration(calibration, None if image is None else ImageFile(0, image).size())
    return _copy_to_log(open_images(left, right, rig, stamps, rate_hz), out, overwrite=overwrite)


def recover(log: str | Path, out: str | Path, *, overwrite: bool = False) -> Recovered:
    """Copy every readable message, attachment and metadata record of an MCAP file to `out`, in the order of the file.

    The messages are not decoded: their bytes, times and sequence numbers, and the definitions of their channels, are
    those of the log. `out` appears when it is complete; its folder is created if needed. `overwrite`: a file that
    is there may be replaced, but not the log. Raises LogError if the log has no readable message, and OutputError.
    """
    out, source = Path(out), LogFile(log)
    _check_free(out, [source.path], overwrite)
    damage, counts = Damage(), Counter[str]()
    with MessageWriter(out, compressed=True, profile=source.profile or "") as copy:
        for message in source.messages(damage):
            copy.write(message)
            counts[message.channel.topic] += 1
        if not counts:
            raise LogError("; ".join([f"{source.path} has no message that can be read", *damage.notes[:3]]))
        attachments = metadata = 0
        for a in source.attachments(damage, LIMITS.record_bytes):
            copy.writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
            attachments += 1
        for record in source.metadata(damage):
            copy.writer.add_metadata(record.name, record.metadata)
            metadata += 1
    return Recovered(out, dict(sorted(counts.items())), attachments, metadata, damage.complete, damage.notes)


def _copy_to_log(
    source: ImageFilesSource, out: str | Path, *, overwrite: bool = False, expects_poses: bool = False
) -> Imported:
    """Write all messages of a source to `out`, whose folder is created if needed.

    `overwrite`: an existing file may be replaced, but no file of the source. `expects_poses`: missing ground truth
    gives a warning. Raises InputError for an image that cannot be read, OutputError.
    """
    _check_free(Path(out), [source.path, *(image.path for side in source.images for image in side)], overwrite)
    damage = Damage()
    with MessageWriter(out) as log:
        for message in source.messages(damage):
            if not damage.complete:
                break
            log.write(message)
        if not damage.complete:  # a copy must not omit what a replay would skip
            raise InputError(damage.notes[-1])
    rig = source.rig
    warnings = [*source.notes, *(baseline_warnings(rig) if rig is not None else ())]
    if isinstance(rig, StereoRig) and (rig.refinement is not None or rig.timing is not None):
        warnings.append("a log does not hold [refinement] and [timing]: also give the calibration to its replay")
    if source.without_partner:
        warnings.append(f"{source.without_partner} images have no partner of the same stamp on the other side")
    if expects_poses and not source.poses:
        warnings.append(f"no ground truth was found for {source.path}")
    left, right = source.images
    return Imported(Path(out), len(left), len(right), len(source.poses), warnings)


def _check_free(out: Path, inputs: Iterable[Path], overwrite: bool) -> None:
    """Create the folder of `out`. Raises OutputError if something is there that must not be replaced."""
    refuse_existing(out, overwrite)
    refuse_overwriting([out], inputs)
    make_folder(out.parent)
