"""The rules that several files read: how images are prepared and followed, and the faults of images."""

from typing import Annotated

from ..config.section import Section, expert


class FlowRules(Section, frozen=True, kw_only=True):
    """Optical flow, and the rough motion from it."""

    # This is a cautious guess.
    std_px: Annotated[float, expert("σ of a position from flow, for gating the rough motion, px", 0.01, 50)] = 0.5
    # Below it the next attempt is made; in the end the best of all is taken.
    enough: Annotated[float, expert("share of the votes found that ends the search for a motion", 0, 1)] = 0.4
    # Windows of 15 px then cover eight times as much of the image, and motions of a third of the image are reached.
    # OpenCV skips levels that are smaller than the window.
    more_levels: Annotated[int, expert("additional pyramid levels if the motion is unknown", 0, 8)] = 3
    # Flow alone follows a patch that grows or shrinks by a quarter; with this, it follows factors of 0.55 to 1.8.
    zoom: Annotated[float, expert("change of scale that is tried, forwards and backwards", 1.01, 10)] = 1.4
    # OpenCV's default is 30; a start value needs fewer.
    max_steps: Annotated[int, expert("most iterations of flow", 1, 1000)] = 20
    # OpenCV's default is 0.01.
    converged_px: Annotated[float, expert("step that ends the iterations, half-size pixels", 1e-6, 10)] = 0.03
    # The eigenvalue is that of the gradient matrix per pixel, as OpenCV scales it: a tenth of its default, for dark
    # images.
    min_eigenvalue: Annotated[float, expert("least texture of a window that is followed", 0, 1)] = 1e-5
    # Corners of the size of a patch are found there, and a search along the row is short. Together with other
    # savings, the front-end takes 19 instead of 27 ms on images of 1241 columns.
    coarse_columns: Annotated[int, expert("largest number of columns of the coarse images", 64, 100_000)] = 800
    # Larger structures are light and shade.
    local_px: Annotated[float, expert("σ of the Gaussian subtracted from quarter-size images, px", 1, 1000)] = 10.0
    # A blotch of one grey value then becomes as strong as usual texture.
    contrast: Annotated[float, expert("gain of quarter-size images without their local mean", 0.1, 255)] = 12.0
    # These are levels of the quarter image; at the top, 21 px are half an image.
    wide_levels: Annotated[int, expert("pyramid levels for wide templates", 0, 8)] = 2
    # Chosen by hand: steps of automatic exposure are larger.
    same_gain: Annotated[float, expert("change of contrast below which the exposure is unchanged", 0, 1e8)] = 0.05
    same_level_grey: Annotated[float, expert("change of mean grey of an unchanged exposure", 0, 1e8)] = 4.0


class ImageRules(Section, frozen=True, kw_only=True):
    """Faults of images."""

    # Rectification and templates move a picture by less.
    overlay_px: Annotated[float, expert("largest shift of a picture laid over both images, px", 0, 100)] = 0.5
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
    fewest_slopes: Annotated[int, expert("least number of slopes that are compared", 1, 10**9)] = 100
