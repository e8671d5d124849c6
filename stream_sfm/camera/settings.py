"""The numbers of rectification and of lenses, each with its reason."""

import math

from ..record import record


@record
class CameraSettings:
    """For all cameras; what an image may be at all is in `models.py`."""

    # Rectified images. The focal length is that at which the whole image fits, so that a lens that bends keeps its
    # corners; but at least this fraction of the lens's own, chosen by hand: a wider view is bought with resolution in
    # the middle.
    min_focal_fraction: float = 0.9
    same_focal_fraction: float = 0.999  # of the lens's own, which is kept then: rectified images stay as they are
    max_shift_px: float = 1e-2  # of any pixel: smaller ones, a third of the views' noise floor, are left out
    # Depth after the rotation of a ray that had depth 1: at less an edge of the image lies beside or behind the
    # rectified camera, as with a lens of 180°.
    min_ray_depth: float = 0.2
    min_valid: float = 0.02  # of the area: with less image content there is nothing to track

    # The pair. x of the direction from left to right camera: below, the right camera is above, below, in front or
    # behind rather than beside; within as much of the other direction they are exchanged.
    beside: float = 0.7
    parallel: float = 1e-3  # sine of the angle between baseline and view: below, both look along one line
    usual_baseline_m: tuple[float, float] = (0.005, 5.0)  # from endoscopes to aircraft; else a unit was mistaken

    # Polynomials over the image: of rows of the camera's own image, and of what a longer focal length does.
    degree: int = 7  # in each coordinate
    nodes: int = 21  # places in each that it fits
    focal_step: float = 1e-3  # of the focal length, for differences

    # Lenses of other models, as the nearest equidistant one.
    widest_rad: float = math.radians(100)  # from the axis
    rings: int = 60  # of rays
    spokes: int = 48  # rays of a ring
    powers: int = 5  # odd ones of the angle
    most_apart_px: float = 0.5  # anywhere in the image; with 0.0004, as of KITTI-360, it is 0.33
    fewest: int = 200  # of the rays that must be in the image

    # Images of 16 bits.
    bright_share: float = 1e-3  # of the pixels that may be brighter than white: hot ones, a lamp


SETTINGS = CameraSettings()
