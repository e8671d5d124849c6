"""Copies a source to a log: messages unchanged, an MCAP file that appears under its name when it is whole."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError, OutputError
from ..files import make_folder
from ..mcap_file.damage import Damage
from ..outputs import refuse_overwriting
from ..recording.log_writer import MessageWriter
from ..sources.image_files import ImageFilesSource


@dataclass(frozen=True, slots=True)
class Imported:
    """What was written: the number of images on each side, of ground-truth poses, and what to know about it."""

    path: Path
    left: int
    right: int
    poses: int
    warnings: list[str] = field(default_factory=list)


def copy_to_log(
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
    warnings = list(source.notes)
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
