"""What is wrong with the images of a frame: black, white, frozen, covered, without texture."""

import cv2
import numpy as np

from .. import core
from ..config.image_rules import ImageRules
from .prepared import Image, PreparedImages


def are_alike(images: PreparedImages, previous: PreparedImages, alike: float) -> bool:
    """Return whether the left image is about as sharp and as rich in contrast as the previous one.

    If so, what was seen there would be found again; where it is not, the image shows something else. `alike`: least
    share of contrast and sharpness that one has of the other.
    """
    contrast, before = (float(x.left.astype(np.float32).std()) for x in (images, previous))
    edges, edges_before = _edges(images.left) * before, _edges(previous.left) * contrast
    return min(contrast, before) > alike * max(contrast, before) and (
        min(edges, edges_before) > np.sqrt(alike) * max(edges, edges_before)
    )


def _edges(image: Image) -> float:
    return float(cv2.Laplacian(image, cv2.CV_32F).std())


def are_one_image(left: Image, right: Image, rules: ImageRules) -> bool:
    """Return whether left and right, as the cameras delivered them, are the same image: no pair has no disparity."""
    if left.shape != right.shape:
        return False
    slopes, same = core.same_slopes(left, right, rules.spacing_px, rules.slope_grey, rules.same_grey)
    return slopes >= rules.fewest_slopes and same > rules.same_share * slopes


def image_note(
    images: PreparedImages,
    previous: PreparedImages | None,
    n_tracked: int,
    n_in_both: int,
    enough: int,
    black_grey: int,
) -> str:
    """Say what is wrong with the images; empty when nothing is.

    `n_tracked` points are tracked in the left image, `n_in_both` of them are matched in the right one too; with less
    than `enough` the images are looked at for the cause: one without a pixel of `black_grey` is black.
    """
    if n_in_both < enough:
        for name, image in (("left", images.left), ("right", images.right)):
            if problem := _without_contrast(image, black_grey):
                return f"the {name} image is {problem}"
    if problem := frozen(images, previous):
        return problem
    if n_in_both >= enough:
        return ""
    if n_tracked >= enough and previous is not None and _same(images.right, previous.right):
        return "the right image is that of the frame before, to the bit: is the right camera frozen?"
    if n_tracked < enough:
        return f"{n_tracked} points can be matched in the images: too little texture, or blurred"
    return (
        f"only {n_in_both} points are found in both images: is one camera covered, are left and right exchanged, or "
        "the images not of one moment?"
    )


def frozen(images: PreparedImages, previous: PreparedImages | None) -> str:
    """Say that the left image, or both, are those of the frame before; empty where that is not so."""
    if previous is None or not _same(images.left, previous.left):
        return ""
    if _same(images.right, previous.right):
        return "the images are those of the frame before, to the bit: are the cameras frozen?"
    return "the left image is that of the frame before, to the bit: is the left camera frozen?"


def _without_contrast(image: Image, black_grey: int) -> str:
    if image.max() < black_grey:
        return "black"
    return "white" if image.min() > 255 - black_grey else ""


def _same(image: Image, other: Image) -> bool:
    """Whether two images are equal; one row distinguishes nearly all that are not."""
    middle = len(image) // 2
    return image[middle].tobytes() == other[middle].tobytes() and bool((image == other).all())
