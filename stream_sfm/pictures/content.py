"""What is wrong with the images of one frame: black, white, frozen, covered or without texture."""

import cv2
import numpy as np

from ..geometry.medians import median
from .prepared import Image, PreparedImages
from .rules import ImageRules


def are_alike(images: PreparedImages, previous: PreparedImages, rules: ImageRules) -> bool:
    """Return whether the left image has about the sharpness and contrast of the previous one.

    If so, points of the previous image would be found again if the place were the same.
    """
    contrast, before = (float(x.left.astype(np.float32).std()) for x in (images, previous))
    edges, edges_before = _edges(images.left) * before, _edges(previous.left) * contrast
    return min(contrast, before) > rules.alike * max(contrast, before) and (
        min(edges, edges_before) > np.sqrt(rules.alike) * max(edges, edges_before)
    )


def _edges(image: Image) -> float:
    return float(cv2.Laplacian(image, cv2.CV_32F).std())


def image_note(
    images: PreparedImages,
    previous: PreparedImages | None,
    n_tracked: int,
    n_in_both: int,
    enough: int,
    rules: ImageRules,
) -> str:
    """Return what is wrong with the images, or an empty string.

    `n_tracked` points are tracked in the left image, and `n_in_both` of them are matched in the right one. If there are
    fewer than `enough`, the images are examined for the cause.
    """
    if n_in_both < enough:
        for name, image in (("left", images.left), ("right", images.right)):
            if problem := _without_contrast(image, rules.black_grey):
                return f"the {name} image is {problem}"
    if problem := frozen(images, previous):
        return problem
    if n_in_both >= enough:
        return ""
    if n_tracked >= enough and previous is not None and _same(images.right, previous.right):
        return "the right image is identical to that of the previous frame: is the right camera frozen?"
    if n_tracked < enough:
        return f"{n_tracked} points can be matched in the images: too little texture, or blurred"
    return (
        f"only {n_in_both} points are found in both images: is one camera covered, are left and right exchanged, or "
        "are the images not of one moment?"
    )


def frozen(images: PreparedImages, previous: PreparedImages | None) -> str:
    """Return a note if the left image, or both, repeat the previous frame's; otherwise an empty string."""
    if previous is None or not _same(images.left, previous.left):
        return ""
    if _same(images.right, previous.right):
        return "the images are identical to those of the previous frame: are the cameras frozen?"
    return "the left image is identical to that of the previous frame: is the left camera frozen?"


def _without_contrast(image: Image, black_grey: int) -> str:
    if image.max() < black_grey:
        return "black"
    return "white" if image.min() > 255 - black_grey else ""


def _same(image: Image, other: Image) -> bool:
    """Whether two images are equal, but for a constant brightness as of an exposure corrected in a held image.

    One row shows the difference of nearly all that are not.
    """
    row = slice(len(image) // 2, len(image) // 2 + 1)
    return _but_for_brightness(image[row], other[row]) and _but_for_brightness(image, other)


def _but_for_brightness(image: Image, other: Image) -> bool:
    """Whether images are equal, or differ by a constant of two grey levels or more, which rectification rounds.

    Two images of a camera at rest also differ by their noise, and black or white pixels do not show the constant.
    """
    if image.tobytes() == other.tobytes():
        return True
    shows = (image > 1) & (image < 254) & (other > 1) & (other < 254)
    apart = image[shows].astype(np.int16) - other[shows]
    if 2 * apart.size < image.size:
        return False
    constant = int(median(apart.astype(float)))
    return abs(constant) >= 2 and float((np.abs(apart - constant) <= 1).mean()) > 0.98
