"""Thresholds for images that are not proper views of a scene, each with its reason and its bounds."""

from typing import Annotated

from .section import Section, expert


class GhostRules(Section, frozen=True, kw_only=True):
    """Whether earlier images show through."""

    # Slower views look too alike to tell; with 0.7 hardly more ghosts are found.
    least_px: Annotated[float, expert("least motion between two frames of an examined patch, px", 0.1, 1000)] = 1.5
    # By then the motion has changed, but the view of the point hardly.
    back_frames: Annotated[int, expert("frames between the two views of a patch that are compared", 1, 100)] = 4
    # Each costs about 6 µs.
    patches: Annotated[int, expert("most patches of a frame", 1, 2000)] = 64
    fewest: Annotated[int, expert("least patches of a frame that says anything", 1, 2000)] = 5
    # What rounding leaves in smoothed images.
    noise_grey: Annotated[float, expert("least σ of what is left of a patch", 0.1, 1000)] = 1.0
    least_square: Annotated[float, expert("least square of a change of a patch", 1e-12, 1e6)] = 1e-3
    # Cameras that average frames mix 0.15 and more, of which a quarter shows where motion hardly changes.
    share: Annotated[float, expert("least share of the previous image that counts as showing through", 0, 1)] = 0.04
    # In 330 frames of sound logs, real and rendered, none then has more than 3 nats. With noise reduction of 0.2
    # to 0.5, two moving frames have 12.
    std_share: Annotated[
        float, expert("σ of the share of the previous image from frame to frame in sound images", 1e-6, 1)
    ] = 0.02
    # On a road, 0.59 of the frames are so.
    steady: Annotated[float, expert("share of frames whose steady motion hides a ghost", 1e-3, 0.999)] = 0.6


class ImageRules(Section, frozen=True, kw_only=True):
    """Faults of images."""

    # Rectification and templates move a picture by less.
    overlay_px: Annotated[float, expert("largest shift of a picture that is laid over both images, px", 0, 100)] = (
        0.5
    )
    # Where only one in ten points is not on such a picture, these show nothing.
    overlay_share: Annotated[float, expert("share of the points on such a picture that is reported", 0, 1)] = 0.9
    # A recorder treats all images alike, so that the first ones tell.
    first_looks: Annotated[int, expert("telling frames that are examined first, and remembered", 1, 10_000)] = 40
    every: Annotated[int, expert("frames from one examined frame to the next, after the first", 1, 10**9)] = 100
    # As improbable as 4.5 σ; one clear frame or some unclear ones have it.
    bound_nats: Annotated[float, expert("evidence that begins or ends a suspicion, nats", 0.1, 1e8)] = 12.0
    # An image without one brighter pixel shows at most the noise of the sensor. White is as far below 255.
    black_grey: Annotated[int, expert("grey value below which an image is black", 0, 127)] = 8
    # Blur by 9 px leaves 0.2 to 0.47 of the sharpness, and dark images have little contrast. Nearly all views of
    # one log that are one or two seconds apart have more.
    alike: Annotated[float, expert("least ratio of contrast and sharpness of two views of one place", 0, 1)] = 0.5
    # Left and right are the same image if nearly all pixels on slopes differ by no more than another encoding of
    # the same pixel would. In a stereo pair this requires that nothing is near enough for a quarter of a pixel of
    # disparity.
    slope_grey: Annotated[int, expert("least difference of grey values two pixels apart on a slope", 1, 255)] = 16
    spacing_px: Annotated[int, expert("spacing of the rows that are compared, px", 1, 1000)] = 8
    same_grey: Annotated[int, expert("largest difference of one pixel in both images, grey values", 0, 255)] = 2
    same_share: Annotated[float, expert("share of slopes that are the same in one image", 0, 1)] = 0.95
    fewest_slopes: Annotated[
        int, expert("least number of slopes that tell whether both images are one", 1, 10**9)
    ] = 100
