"""Thresholds for new points and for finding them in later images, each with its reason and its bounds."""

from typing import Annotated

from .section import Section, expert


class PointRules(Section, frozen=True, kw_only=True):
    """New points in an image pair."""

    # It is as accurate as every frame (medians over three starts on four logs), and a replay takes 3 % less CPU.
    period: Annotated[int, expert("search for new points in every n-th frame", 1, 100)] = 2
    # In the other frames, points are sought only if more than this share is missing.
    urgent_fraction: Annotated[float, expert("missing share of max_tracks that does not wait", 0, 1)] = 0.6
    # On KITTI this saves 1.2 of 16 ms with unchanged figures. Every second time, and on bare walls, it is the whole
    # row.
    search_factor: Annotated[float, expert("length of the search on a row, largest disparities", 1, 1000)] = 1.5
    search_margin_px: Annotated[
        float, expert("margin that is added to the length of the search on a row, px", 0, 10_000)
    ] = 16.0
    # This covers a whole-pixel match and its neighbour.
    match_tolerance_px: Annotated[float, expert("largest error of a match, px of the coarse image", 0.5, 50)] = 2.0
    # With a larger offset, a depth edge crosses the patch. On renders, RMS structure error over σ fell from 7.3 to
    # 2.7.
    max_halves_apart_px: Annotated[float, expert("largest offset of an inner half's match, px", 0.01, 1e8)] = 0.5
    # This is a guess that allows for the noise that neighbours share.
    std_grey: Annotated[float, expert("σ of a grey difference of left and right patch", 0.1, 1e8)] = 4.0
    # Up to twice as many are added. In a corridor with bare corners drift is 14 % without them, 0.2 % with them.
    bare_fraction: Annotated[float, expert("share of max_tracks below which templates are wide", 0, 1)] = 0.25
    # A slope of a quarter of a grey value per pixel, twice what noise and rounding leave in the reduced image.
    min_wide_response: Annotated[float, expert("least eigenvalue of the gradients of wide templates", 1e-12, 1)] = (
        1e-6
    )
    # This is half of the default patch, and so the same size in half-size images.
    match_radius_px: Annotated[int, expert("half width of the window correlated along the row, px", 1, 100)] = 5
    # Smoothing gives neighbours the same noise. There are as many matches as with all samples, in a third of the
    # time.
    match_spacing_px: Annotated[
        int, expert("spacing of the samples of a window correlated along the row, px", 1, 100)
    ] = 2
    # Chosen by hand: higher values reject blurred or slanted patches; lower ones admit wrong matches, most of which
    # the alignment and the check of halves reject.
    match_correlation: Annotated[float, expert("least correlation of a match", -1, 1)] = 0.75
    match_lead: Annotated[float, expert("lead in correlation over the best match elsewhere on the row", 0, 2)] = (
        0.06
    )
    match_neighbours_px: Annotated[
        int, expert("neighbours of a match that do not compete with it, px", 0, 1000)
    ] = 2
    # Chosen by hand: on most surfaces the disparity changes more slowly.
    std_slope: Annotated[float, expert("prior σ of the disparity slope across a patch, px per px", 1e-3, 10)] = 0.15
    # Chosen by hand: a patch of 21 px then spans 10 px of disparity, more than a single surface does.
    max_slope: Annotated[float, expert("largest disparity slope, px per px", 0, 0.99)] = 0.5
    # χ² with two degrees of freedom at 0.999: an insignificant slope adds more noise than it removes bias.
    significant_slope: Annotated[float, expert("χ² beyond which a slope counts", 0, 1e8)] = 13.8
    # Further steps change no figure of the logs with ground truth.
    slant_steps: Annotated[int, expert("Gauss-Newton steps that find a slope", 1, 100)] = 3
    # Beyond it, it is another match.
    max_slant_shift_px: Annotated[float, expert("largest shift of a match by its slope, px", 0, 100)] = 2.0
    # Chosen by hand. With a fixed limit, an exposure cut to a quarter would leave no corner.
    dim_fraction: Annotated[float, expert("share of the strongest response that makes a corner", 0, 1)] = 0.02
    peak_part: Annotated[int, expert("a corner is the strongest within the least distance over this", 1, 1000)] = 3
    # A cell has room for one corner at least.
    cell_distances: Annotated[float, expert("least edge of a cell, distances of corners", 0, 1000)] = 2.0
    # More candidates are weaker and cost time.
    candidates: Annotated[int, expert("candidates per corner wanted", 1, 10_000)] = 12


class TemplateRules(Section, frozen=True, kw_only=True):
    """How templates are found in new images, and how certain their positions are."""

    # Measured on four logs over four starts: for a rendered one, pose NEES falls from 16.4 to 10.8 and aligned ATE
    # from 1.19 to 0.74 mm; the others are unchanged. 0.6 to 1.0 are nearly as good.
    weights_width: Annotated[float, expert("σ of the weights over a patch, its radii", 0.05, 1e6)] = 0.8
    # Two or three are usually enough; an image that is more blurred than the template takes more.
    steps: Annotated[int, expert("Gauss-Newton steps of an alignment, at most", 1, 1000)] = 20
    # Chosen by hand: with a larger ratio the steps do not converge.
    step_ratio: Annotated[float, expert("largest ratio of each step to the previous one", 0.01, 1)] = 0.7
    # After a step, a tenth of it is left, which is below the noise floor of a view.
    converged_px: Annotated[float, expert("step that ends an alignment, px", 1e-6, 10)] = 0.05
    # Chosen by hand: no exposure changes by more within a track.
    max_gain: Annotated[float, expert("largest factor on grey values, or its inverse", 1, 1e6)] = 10.0
    # Chosen by hand: below it the image shows something else.
    min_explained: Annotated[float, expert("least share of image variance that a template explains", 0, 1)] = 0.5
    # Steps of automatic exposure are larger.
    same_level: Annotated[float, expert("change of grey levels below which exposure is the same", 0, 1e8)] = 0.05
    # The light on a single patch may change by a fifth.
    same_exposure: Annotated[float, expert("largest difference of the log gains under one light", 0, 100)] = 0.18
    # This many do not agree by chance.
    exposure_views: Annotated[int, expert("least views that show another exposure or light", 1, 10_000)] = 12
    exposures: Annotated[int, expert("largest number of lights on the templates of a frame", 1, 100)] = 3
    # This is σ₀ of eq. (15), chosen by hand: the error of interpolation and rectification, even in a perfect match.
    std_floor_px: Annotated[float, expert("least σ of a position, px", 0, 10)] = 0.03
    # Rounding to whole grey values alone leaves 0.4 between two images.
    least_error_grey: Annotated[float, expert("least σ of a grey difference", 1e-3, 255)] = 0.5
    # The covariance of such a side is then so large that it has no effect.
    unknown_error_grey: Annotated[float, expert("σ of grey differences of a side that is missing", 1, 1e6)] = 255.0
    # σ of a position along an edge stays within 32 times the σ across it.
    edge_damping: Annotated[float, expert("damping of a gradient matrix, share of its trace", 0, 1)] = 1e-3
    # Below it, the patch has grown by more than √5 and shows detail that the template lacks.
    least_area: Annotated[float, expert("least area of a template that a pixel covers, pixels", 0, 1)] = 0.2
