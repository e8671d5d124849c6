"""Runs one log twice: unchanged, and with each image mixed with earlier ones, as by temporal noise reduction."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import stream_sfm as sfm


def beside_blended(log: Path, share: float, frames: int) -> Iterator[tuple[sfm.FrameEstimate, sfm.FrameEstimate]]:
    """Yield estimates of the log as it is, and of the same frames, whose images are `share` those shown before."""
    source = sfm.open_log(log)
    sound, blended = sfm.Engine(source.rig), sfm.Engine(source.rig)
    shown: list[np.ndarray] = []
    for frame in source.frames(sfm.Selection(max_frames=frames)):
        new = [image.astype(np.float32) for image in (frame.left, frame.right)]
        pairs = zip(shown, new, strict=True)
        shown = [share * before + (1 - share) * image for before, image in pairs] if shown else new
        mixed = sfm.StereoFrame(frame.stamp_ns, *(np.rint(image).astype(np.uint8) for image in shown))
        yield sound.step(frame), blended.step(mixed)
