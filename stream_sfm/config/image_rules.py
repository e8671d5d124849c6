"""Numbers by which images are refused that show no new view of a scene, each with its reason and its ends."""

from typing import Annotated

from .section import Section, expert


class GhostRules(Section, frozen=True, kw_only=True):
    """Whether earlier images show through."""

    # Slower views are too much like themselves to tell; with 0.7 hardly more ghosts are found.
    least_px: Annotated[float, expert("motion between two frames of patches that are looked at, px", 0.1, 1000)] = (
        1.5
    )
    # Motion has changed then, the view of the point hardly.
    back_frames: Annotated[int, expert("frames between the two views of a patch that are compared", 1, 100)] = 4
    # Each costs some 6 µs.
    patches: Annotated[int, expert("most patches of a frame", 1, 2000)] = 64
    fewest: Annotated[int, expert("least patches of a frame that says anything", 1, 2000)] = 5
    # What rounding leaves in smoothed images.
    noise_grey: Annotated[float, expert("least σ of what is left of a patch", 0.1, 1000)] = 1.0
    least_square: Annotated[float, expert("least square of a change of a patch", 1e-12, 1e6)] = 1e-3
    remembered: Annotated[int, expert("frames that are judged together", 1, 10_000)] = 40
    every: Annotated[int, expert("frames from one examined to the next, after the first ones", 1, 10_000)] = 2
    # Without new evidence, which there is none of while the camera stands or moves steadily.
    lasting_frames: Annotated[int, expert("frames that a suspicion lasts", 1, 10_000)] = 60
    # Sound logs, real and rendered, some blurred, dark, encoded or with a pattern of the sensor, have shares of at most
    # 0.01, which are at most 4.1 σ above zero. In the first frames a share is large, and uncertain.
    share: Annotated[float, expert("least share of the image before in one, less its uncertainty", 0, 1)] = 0.0033
    sigmas: Annotated[float, expert("how many σ its uncertainty is", 0.1, 1e8)] = 3.5


class SmearRules(Section, frozen=True, kw_only=True):
    """Whether patches are smeared by more than a shutter can."""

    # Below, tracks are hardly more accurate than that; above, the ghost is a second picture, which is looked for.
    least_px: Annotated[
        float, expert("motion between two frames of patches that are looked at, px", 0.01, 1000)
    ] = 0.1
    most_px: Annotated[float, expert("and at most, px", 0.1, 1000)] = 3.0
    # In dim light tracks of a standing camera seem to move by 0.15 px, and by more where noise looks like a smear.
    typical_px: Annotated[float, expert("least median motion in a frame that says anything, px", 0, 1000)] = 0.2
    # By then the view of a point has changed.
    oldest: Annotated[int, expert("frames back to the slow view, at most", 1, 1000)] = 20
    patches: Annotated[int, expert("most patches of a frame", 1, 2000)] = 128
    fewest: Annotated[int, expert("least patches of a frame that says anything", 1, 2000)] = 16
    # What rounding leaves in smoothed images.
    noise_grey: Annotated[float, expert("least σ of what is left of a patch", 0.1, 1000)] = 0.5
    least_square: Annotated[float, expert("least square of a change of a patch", 1e-12, 1e6)] = 1e-3
    # What patches differ by that are seen from elsewhere.
    std_px2: Annotated[float, expert("σ of the smear of a patch beside its noise, px²", 1e-4, 1e6)] = 0.05
    remembered: Annotated[int, expert("frames that are judged together", 1, 10_000)] = 20
    # Each costs some 2 ms.
    every: Annotated[int, expert("frames from one examined to the next, after the first ones", 1, 10_000)] = 16
    lasting_frames: Annotated[int, expert("frames that a suspicion lasts", 1, 10_000)] = 100
    # Sound logs, real and rendered, have at most 1.9 σ, most of them less than none.
    variance: Annotated[float, expert("least smear beyond a shutter's less its uncertainty, frames²", 0, 1e6)] = (
        0.0125
    )
    # Of patches that differ; frames that are compared with the same slow one share its noise.
    sigmas: Annotated[float, expert("how many σ its uncertainty is", 0.1, 1e8)] = 3.5
    # Patches of sound logs have up to 0.005; where tracks stay with the half that is at rest, from 0.017 on.
    other: Annotated[float, expert("least share of another picture in patches, less its uncertainty", 0, 1)] = 0.01
    other_sigmas: Annotated[float, expert("how many σ this uncertainty is", 0.1, 1e8)] = 2.0


class StillRules(Section, frozen=True, kw_only=True):
    """Whether something is drawn over both images."""

    # Of every row and column it would take eight times as long, and edges are longer than that.
    spacing_px: Annotated[int, expert("spacing of the rows and columns that are looked at, px", 1, 1000)] = 8
    # What is drawn stays for longer.
    every: Annotated[int, expert("frames from one that is looked at to the next", 1, 100)] = 2
    # Well above noise.
    edge_grey: Annotated[int, expert("difference of grey values two pixels apart at an edge", 1, 255)] = 16
    # Of another encoding of the same pixels.
    same_grey: Annotated[int, expert("grey values that the same pixel may differ by", 0, 255)] = 3
    same_step_grey: Annotated[int, expert("grey values that the step of the same edge may differ by", 0, 255)] = 4
    # Compared with the last image only, up to 0.0116 of the edges of rendered yards and corridors seem to be drawn:
    # what is far, in a camera that hardly turns.
    apart_frames: Annotated[int, expert("frames back to an earlier image that edges are compared with", 1, 100)] = 4
    # With fewer edges moving the camera stands, and what is drawn does not show.
    moving: Annotated[float, expert("share of edges that must change for a frame to be judged", 0, 1)] = 0.2
    remembered: Annotated[int, expert("frames looked at that are judged together", 1, 10_000)] = 5
    fewest: Annotated[int, expert("edges that it takes to say anything", 1, 10**9)] = 500
    # Sound logs, rendered and real, have up to 0.0033; overlays that lead estimates astray have from 0.02 on.
    drawn: Annotated[float, expert("least share of edges that stay, left and right", 0, 1)] = 0.008


class FieldRules(Section, frozen=True, kw_only=True):
    """Whether rows are of two moments in turn."""

    # Sound logs, real and rendered, have at most 0.03 in both images; interlaced ones that move 0.04 to 6.
    combed: Annotated[float, expert("excess of odd differences, share of those two rows apart", 0, 100)] = 0.06
    stride: Annotated[int, expert("lines from one that is looked at to the next", 1, 1000)] = 2
    bands: Annotated[int, expert("bands of rows that are judged apart", 3, 1000)] = 10
    # A line that is drawn across the image is in one or two.
    bands_left_out: Annotated[int, expert("bands with the largest excess, which do not count", 1, 2)] = 2
    # Images without texture have less.
    least_grey2: Annotated[float, expert("least row difference that counts, grey values squared", 1e-3, 1e6)] = 1.0
    # Each costs a fifth of a millisecond.
    every: Annotated[int, expert("one of so many frames of which still.every takes lines", 1, 10_000)] = 2
    # What stands is not combed.
    lasting_frames: Annotated[int, expert("such frames that a suspicion lasts", 1, 10_000)] = 15


class EchoRules(Section, frozen=True, kw_only=True):
    """Whether both images show everything twice."""

    # More of the image costs more, and shows no more.
    middle_px: Annotated[int, expert("side of the middle that is looked at, at most, px", 8, 4096)] = 256
    # Nearer copies cannot be distinguished from blur and from how texture is sampled.
    least_px: Annotated[float, expert("least displacement of the copy, px", 0.1, 1000)] = 5.5
    largest_px: Annotated[int, expert("largest displacement across and down, px", 4, 64)] = 48
    blur_px: Annotated[float, expert("σ of the Gaussian beyond which all is light and shade, px", 0.1, 100)] = 2.0
    # As noise and rounding leave it.
    floor: Annotated[float, expert("least power of a frequency, share of the mean", 1e-9, 1)] = 1e-3
    # Of 134 sound logs and renders the largest is 0.10, of single frames 0.13. A copy of a fifth has some 0.2.
    strength: Annotated[float, expert("least strength of the copy, share of the image itself", 0, 1)] = 0.16
    remembered: Annotated[int, expert("frames that are judged together", 1, 1000)] = 4
    # Each costs some 2 ms.
    every: Annotated[int, expert("frames from one that is looked at to the next", 1, 10_000)] = 20


class ImageRules(Section, frozen=True, kw_only=True):
    """What is wrong with images."""

    # An image without one brighter pixel shows at most the sensor's noise; white is as far below 255.
    black_grey: Annotated[int, expert("grey value below which an image is black", 0, 127)] = 8
    # Blur by 9 px leaves 0.2 to 0.47 of the sharpness, dark images little of the contrast; of views of one log that
    # are one or two seconds apart nearly all have more.
    alike: Annotated[float, expert("contrast and sharpness of views of one place, share of each other", 0, 1)] = 0.5
    # Left and right are one image where nearly all pixels with a slope differ by no more than another encoding of the
    # same pixel does. In a pair they do so only where nothing is nearer than a quarter of a pixel of disparity shows.
    slope_grey: Annotated[int, expert("difference of grey values two pixels apart that is a slope", 1, 255)] = 16
    spacing_px: Annotated[int, expert("spacing of the rows that are compared, px", 1, 1000)] = 8
    same_grey: Annotated[int, expert("grey values that one pixel of both images may differ by", 0, 255)] = 2
    same_share: Annotated[float, expert("share of slopes that are the same in one image", 0, 1)] = 0.95
    fewest_slopes: Annotated[int, expert("slopes that it takes to say so", 1, 10**9)] = 100
