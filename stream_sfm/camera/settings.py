"""Settings of rectification and of lenses, each with its reason."""

import math

from ..record import record


@record
class CameraSettings:
    """Settings for all cameras."""

    # A camera. The most pixels of an image are in `models.py`.
    edge_px: tuple[int, int] = (16, 2**15 - 1)  # smaller images hold no patch; OpenCV's maps have 16 bits
    max_k_px: float = 1e6  # per element of K: a telescope on the largest image has a tenth of it
    min_focal: float = 0.05  # of the longer edge: a pinhole then sees 168°, a fisheye more than the full sphere
    max_skew_px: float = 0.1  # OpenCV's lens models have no skew; this much moves no pixel by a tenth of a pixel

    # Where the calibration of a recording is sought.
    levels: int = 3  # of folders around it
    most_near: int = 50  # files of a folder that may be calibrations; more are something else

    # Rectified images. The focal length is the one at which the whole image fits, so that a distorted image keeps
    # its corners, but at least this fraction of the original one. Chosen by hand: a wider view costs resolution in
    # the middle.
    min_focal_fraction: float = 0.9
    same_focal_fraction: float = 0.999  # of the original one, which is then kept: rectified images stay as they are
    max_shift_px: float = 1e-2  # of any pixel: smaller shifts, a third of the noise floor of views, are ignored
    # Depth of a ray after the rotation, if it had depth 1 before. With less, an edge of the image lies beside or
    # behind the rectified camera, as with a lens of 180°.
    min_ray_depth: float = 0.2
    min_valid: float = 0.02  # of the area: with less there is nothing to track

    # The pair. x of the direction from the left to the right camera: with less, the right camera is above, below,
    # in front or behind rather than beside. As far in the other direction, the cameras are swapped.
    beside: float = 0.7
    parallel: float = 1e-3  # sine of the angle between baseline and view: with less, both look along one line
    usual_baseline_m: tuple[float, float] = (0.005, 5.0)  # from endoscopes to aircraft; otherwise the unit is wrong

    # Baseline of the virtual right camera beside a single one, in units of the first motion. Its views hardly count. As
    # a length it converts a drift of patches to depths, eq. (33), and is about the distance of a first scene.
    virtual_baseline: float = 10.0

    # Polynomials over the image: of raw rows, and of the effect of a longer focal length.
    degree: int = 7  # per coordinate
    nodes: int = 21  # fitted places per coordinate
    focal_step: float = 1e-3  # share of the focal length, for finite differences

    # Lenses of other models, replaced by the nearest equidistant one.
    widest_rad: float = math.radians(100)  # from the axis
    rings: int = 60  # number of rings of rays
    spokes: int = 48  # rays per ring
    powers: int = 5  # odd powers of the angle
    most_apart_px: float = 0.5  # anywhere in the image; with 0.0004, as of KITTI-360, it is 0.33
    fewest: int = 200  # least number of rays in the image

    # Refinements. A single log does not show by how much logs of one rig differ. Six drives with KITTI's cameras differ
    # by 0.2 to 0.9 prior σ in each term, a hundred times their own variance.
    logs_differ: float = 0.4  # prior σ of each error
    logs_weight: float = 2.0  # the number of logs as which this guess counts
    # σ before any log, prior σ, of disparity errors that all logs share: KITTI's are 6 in one term. Those of lenses are
    # hardly seen without their prior.
    common_disparity: float = 3.0
    rounds: int = 50  # of variational Bayes
    row_rounds: int = 2  # of mending rows; the second one removes a per cent of the first

    # A refinement is checked on frames from which it was not made. Share of the error that these find without it: with
    # one that helps they find less. A smaller error is not worth a refinement, whose σ every later run would carry.
    helps: float = 0.9
    worth_px: float = 0.05
    sigma_grows: float = 1.5  # factor on σ of the end, at most; with a right refinement it shrinks
    least_frames: int = 24  # of a part; fewer do not show whether its own parts agree

    # 16-bit images.
    bright_share: float = 1e-3  # share of pixels that may be brighter than white: hot pixels, lamps


SETTINGS = CameraSettings()
