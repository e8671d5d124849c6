"""What is wrong with the images of a frame: black, white, frozen, covered, without texture."""

from .prepared import Image, PreparedImages

_FEW_POINTS = 8  # with fewer the images are looked at for the cause; as many as the default of `robust.min_inliers`
_BLACK_GREY = 8  # of 255: an image without one brighter pixel shows at most the sensor's noise
_WHITE_GREY = 247  # as far below 255


def image_note(images: PreparedImages, previous: PreparedImages | None, n_tracked: int, n_in_both: int) -> str:
    """Say what is wrong with the images; empty when nothing is.

    `n_tracked` points are tracked in the left image, `n_in_both` of them are matched in the right one too.
    """
    if n_in_both < _FEW_POINTS:
        for name, image in (("left", images.left), ("right", images.right)):
            if problem := _without_contrast(image):
                return f"the {name} image is {problem}"
    if previous is not None and images.equals(previous):
        return "the images are those of the frame before, to the bit: are the cameras frozen?"
    if n_in_both >= _FEW_POINTS:
        return ""
    if n_tracked < _FEW_POINTS:
        return f"{n_tracked} points can be matched in the images: too little texture, or blurred"
    return (
        f"only {n_in_both} points are found in both images: is one camera covered, are left and right exchanged, or "
        "the images not of one moment?"
    )


def _without_contrast(image: Image) -> str:
    if image.max() < _BLACK_GREY:
        return "black"
    return "white" if image.min() > _WHITE_GREY else ""
