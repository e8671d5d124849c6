"""Thresholds for rejecting images that are not proper views of a scene, each with its reason and its bounds."""

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
    remembered: Annotated[int, expert("frames that are judged together", 1, 10_000)] = 40
    every: Annotated[int, expert("after the first frames, examine every n-th", 1, 10_000)] = 2
    # A camera that stands still or moves steadily gives no new evidence.
    lasting_frames: Annotated[int, expert("frames that a suspicion lasts", 1, 10_000)] = 60
    # Sound logs, real and rendered, some blurred, dark, compressed or with sensor patterns, have shares of at most
    # 0.01, which are at most 4.1 σ above zero. In the first frames the share is large and uncertain.
    share: Annotated[float, expert("least share of the previous image in one, less its uncertainty", 0, 1)] = 0.0033
    sigmas: Annotated[float, expert("this uncertainty, in σ", 0.1, 1e8)] = 3.5


class SmearRules(Section, frozen=True, kw_only=True):
    """Whether patches are smeared by more than a shutter can."""

    # Below it, tracks are hardly more accurate; above most_px, the ghost is a separate picture, which GhostRules
    # find.
    least_px: Annotated[float, expert("least motion between two frames of an examined patch, px", 0.01, 1000)] = 0.1
    most_px: Annotated[float, expert("largest motion of such a patch, px", 0.1, 1000)] = 3.0
    # In dim light tracks of a standing camera seem to move by 0.15 px, and by more where noise looks like a smear.
    typical_px: Annotated[float, expert("least median motion in a frame that is judged, px", 0, 1000)] = 0.2
    # By then the view of a point has changed.
    oldest: Annotated[int, expert("frames back to the slow view, at most", 1, 1000)] = 20
    patches: Annotated[int, expert("most patches of a frame", 1, 2000)] = 128
    fewest: Annotated[int, expert("least patches of a frame that says anything", 1, 2000)] = 16
    # What rounding leaves in smoothed images.
    noise_grey: Annotated[float, expert("least σ of what is left of a patch", 0.1, 1000)] = 0.5
    least_square: Annotated[float, expert("least square of a change of a patch", 1e-12, 1e6)] = 1e-3
    # Patches seen from another place differ by this.
    std_px2: Annotated[float, expert("σ of the smear of a patch beside its noise, px²", 1e-4, 1e6)] = 0.05
    remembered: Annotated[int, expert("frames that are judged together", 1, 10_000)] = 20
    # Each costs about 2 ms.
    every: Annotated[int, expert("after the first frames, examine every n-th", 1, 10_000)] = 16
    lasting_frames: Annotated[int, expert("frames that a suspicion lasts", 1, 10_000)] = 100
    # Sound logs, real and rendered, have at most 1.9 σ, most of them negative values.
    variance: Annotated[float, expert("least smear beyond a shutter's, less its uncertainty, frames²", 0, 1e6)] = (
        0.0125
    )
    # Patches differ, and frames that are compared with the same slow one share its noise.
    sigmas: Annotated[float, expert("this uncertainty, in σ", 0.1, 1e8)] = 3.5
    # Patches of sound logs have up to 0.005; if tracks follow the half at rest, they have 0.017 or more.
    other: Annotated[float, expert("least share of another image in patches, less its uncertainty", 0, 1)] = 0.01
    other_sigmas: Annotated[float, expert("this uncertainty, in σ", 0.1, 1e8)] = 2.0


class StillRules(Section, frozen=True, kw_only=True):
    """Whether something is drawn over both images."""

    # Every row and column would take eight times as long, and edges are longer than the spacing.
    spacing_px: Annotated[int, expert("spacing of the examined rows and columns, px", 1, 1000)] = 8
    # Overlays stay for longer.
    every: Annotated[int, expert("examine every n-th frame", 1, 100)] = 2
    # This is well above noise.
    edge_grey: Annotated[int, expert("difference of grey values two pixels apart at an edge", 1, 255)] = 16
    # Another encoding of the same pixels differs by this.
    same_grey: Annotated[int, expert("largest difference of an unchanged pixel, grey values", 0, 255)] = 3
    same_step_grey: Annotated[int, expert("largest change of the step of such an edge, grey values", 0, 255)] = 4
    # In comparison with the last image only, up to 0.0116 of the edges of rendered yards and corridors seem to be
    # drawn: distant edges, while the camera hardly turns.
    apart_frames: Annotated[int, expert("frames back to an earlier image that edges are compared with", 1, 100)] = 4
    # If fewer edges move, the camera stands still, and overlays cannot be told apart.
    moving: Annotated[float, expert("share of edges that must change for a frame to be judged", 0, 1)] = 0.2
    remembered: Annotated[int, expert("examined frames that are judged together", 1, 10_000)] = 5
    fewest: Annotated[int, expert("least number of edges for a judgement", 1, 10**9)] = 500
    # Sound logs, rendered and real, have up to 0.0033; overlays that mislead estimates have 0.02 or more.
    drawn: Annotated[float, expert("least share of edges that stay in place, left and right", 0, 1)] = 0.008


class FieldRules(Section, frozen=True, kw_only=True):
    """Whether alternate rows are of two moments."""

    # Sound logs, real and rendered, have at most 0.03 in both images; interlaced ones with motion have 0.04 to 6.
    combed: Annotated[float, expert("excess of odd differences, share of those two rows apart", 0, 100)] = 0.06
    stride: Annotated[int, expert("examine every n-th line", 1, 1000)] = 2
    bands: Annotated[int, expert("bands of rows that are judged separately", 3, 1000)] = 10
    # A line that is drawn across the image is in one or two of them.
    bands_left_out: Annotated[int, expert("number of bands with the largest excess that are ignored", 1, 2)] = 2
    # Images without texture have less.
    least_grey2: Annotated[float, expert("least row difference that counts, grey values squared", 1e-3, 1e6)] = 1.0
    # Each costs a fifth of a millisecond.
    every: Annotated[int, expert("examine every n-th of the frames of `still.every`", 1, 10_000)] = 2
    # Static parts are not combed.
    lasting_frames: Annotated[int, expert("examined frames that a suspicion lasts", 1, 10_000)] = 15


class EchoRules(Section, frozen=True, kw_only=True):
    """Whether both images show everything twice."""

    # A larger part of the image costs more and shows no more.
    middle_px: Annotated[int, expert("largest side of the examined middle, px", 8, 4096)] = 256
    # Copies at a smaller displacement cannot be distinguished from blur or from the sampling of texture.
    least_px: Annotated[float, expert("least displacement of the copy, px", 0.1, 1000)] = 5.5
    largest_px: Annotated[int, expert("largest displacement across and down, px", 4, 64)] = 48
    blur_px: Annotated[float, expert("σ of the Gaussian that keeps only light and shade, px", 0.1, 100)] = 2.0
    # Noise and rounding leave this much.
    floor: Annotated[float, expert("least power of a frequency, share of the mean", 1e-9, 1)] = 1e-3
    # On 134 sound logs and renders the largest is 0.10, in single frames 0.13. A copy of a fifth has about 0.2.
    strength: Annotated[float, expert("least strength of the copy, share of the image itself", 0, 1)] = 0.16
    remembered: Annotated[int, expert("frames that are judged together", 1, 1000)] = 4
    # Each costs about 2 ms.
    every: Annotated[int, expert("examine every n-th frame", 1, 10_000)] = 20


class ImageRules(Section, frozen=True, kw_only=True):
    """Faults of images."""

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
    fewest_slopes: Annotated[int, expert("least number of slopes for this judgement", 1, 10**9)] = 100
