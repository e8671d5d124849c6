"""The check for doubled images finds copies at any displacement, and never suspects repetitive scenes."""

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.frontend.echo_check import EchoCheck
from tests.helpers.places import ROOM

SHARE = 0.3  # of the copy in the image


def twice(image: np.ndarray, x: int, y: int, share: float = SHARE) -> np.ndarray:
    """An image with a displaced copy of itself."""
    copy = np.roll(image, (y, x), axis=(0, 1))
    return np.rint((1 - share) * image + share * copy).astype(np.uint8)


def textured(seed: int, size: tuple[int, int] = (256, 320)) -> np.ndarray:
    """Noise whose spectrum falls off like that of natural images."""
    spectrum = np.fft.rfft2(np.random.default_rng(seed).normal(size=size))
    y, x = np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])
    image = np.fft.irfft2(spectrum / np.maximum(np.hypot(x, y), 1 / 64), s=size)
    return (128 + 35 * image / image.std()).clip(0, 255).astype(np.uint8)


def checked(left: np.ndarray, right: np.ndarray) -> EchoCheck:
    return EchoCheck().after(left, right)


@pytest.mark.parametrize("at_px", [(8, 0), (0, 11), (17, 5), (-9, 20)])
def test_the_displacement_of_a_copy_is_reported(at_px: tuple[int, int]) -> None:
    check = checked(twice(textured(0), *at_px), twice(textured(1), *at_px))
    assert check.at_px == at_px and "everything twice" in check.problem


def test_images_without_a_copy_are_not_suspected() -> None:
    assert not checked(textured(0), textured(1)).problem


def test_a_copy_in_one_image_only_is_no_echo_of_both() -> None:
    assert not checked(twice(textured(0), 8, 0), textured(1)).problem


def test_a_repetitive_scene_is_no_echo() -> None:
    """Tiles have a copy at their period in all frames and in both images, but also one at twice the period."""
    rng = np.random.default_rng(2)
    tiles = np.tile(textured(3, (32, 32)), (8, 10)).astype(float)
    left, right = ((tiles + 0.5 * (textured(n) - 128.0)).clip(0, 255) for n in rng.integers(10, 99, 2))
    assert not checked(left.astype(np.uint8), right.astype(np.uint8)).problem


def test_small_images_are_not_examined() -> None:
    assert not checked(twice(textured(0, (96, 128)), 8, 0), twice(textured(1, (96, 128)), 8, 0)).problem


def test_the_engine_does_not_trust_such_images() -> None:
    engine = sfm.Engine((log := sfm.open_log(ROOM)).rig)
    for frame in log.frames(sfm.Selection(max_frames=6)):
        left, right = (twice(image, 8, 0) for image in (frame.left, frame.right))
        estimate = engine.step(sfm.StereoFrame(frame.stamp_ns, left, right))
    assert estimate.status is sfm.Status.DEGRADED and "everything twice" in estimate.reason
