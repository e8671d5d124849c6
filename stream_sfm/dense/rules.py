"""The rules of dense stereo and surfaces."""

from typing import Annotated

from ..config.section import Section, expert


class DenseRules(Section, frozen=True, kw_only=True):
    """Dense stereo and surfaces (`stream-sfm surface`)."""

    # Chosen by hand: twice the range of the points, for surfaces close to the camera. Each frame narrows it.
    max_disparity_fraction: Annotated[float, expert("largest disparity, share of the width", 0.01, 0.9)] = 0.5
    # OpenCV recommends 3 to 11 for semi-global matching; larger blocks are smoother and lose thin objects.
    block_px: Annotated[int, expert("edge of the matched block, pixels, odd", 3, 21)] = 7
    # OpenCV recommends 5 to 15. The lowest is enough, because the left-right check and σ also reject mismatches.
    uniqueness_percent: Annotated[int, expert("margin of a match over the second best, percent", 0, 50)] = 5
    # As for the points (`frontend.smoothing_px`): interpolation between pixels is biased in sharper images.
    smoothing_px: Annotated[float, expert("σ of the Gaussian before the sub-pixel step, pixels", 0, 5)] = 1.0
    # Chosen by hand: a larger window averages more noise, but rounds off the edges of objects.
    window_radius_px: Annotated[int, expert("half width of the window of the sub-pixel step, pixels", 2, 30)] = 6
    # Enough for the range of disparities, at a fraction of the cost.
    search_width_px: Annotated[int, expert("approximate width of the range-search image, px", 32, 10_000)] = 320
    # This is the rounding, which smoothing hides.
    least_noise_grey: Annotated[float, expert("least σ of a grey value", 1e-3, 255)] = 1.0
    # A pixel beside a depth edge must have texture of its own.
    own_px: Annotated[int, expert("edge of the window in which a pixel must have texture, pixels", 1, 31)] = 5
    # A uniform error of half a pixel has a σ of 0.29.
    std_start_px: Annotated[float, expert("σ of the disparity before the sub-pixel step", 1e-3, 1000)] = 0.3
    # It covers lens model and interpolation. With it, σ matches the errors of rendered frames
    # (tools/surface_accuracy.py).
    std_bias_px: Annotated[float, expert("σ of the disparity error that all frames share, pixels", 0, 10)] = 0.06
    # Chosen by hand: a less certain disparity may be a mismatch.
    max_std_px: Annotated[float, expert("leave out pixels with a larger σ of disparity", 1e-3, 100)] = 1.0
    # Chosen by hand: beyond it, depth is too uncertain to show a shape.
    max_relative_std: Annotated[float, expert("leave out pixels with a larger relative σ of depth", 1e-4, 1)] = 0.05
    # The limit of fusion in human stereo vision (Burt and Julesz 1980); a steeper step is the edge of an object.
    max_disparity_step_px: Annotated[float, expert("largest step between connected pixels", 0.01, 1000)] = 1.0
    # About 160 MB; beyond it the edge is doubled, which leaves about a quarter of the voxels of a surface.
    max_voxels: Annotated[
        int, expert("most voxels of a fused surface; beyond it they are enlarged", 10_000, 100_000_000)
    ] = 4_000_000
    # The truncation distance of a fused surface.
    reach_voxels: Annotated[int, expert("voxels on either side of a surface that keep its distance", 1, 16)] = 2
    # Some finer voxels would receive no pixel.
    voxel_footprints: Annotated[float, expert("edge of automatic voxels, px at the median depth", 0.1, 1000)] = 2.0
    # Distances with a larger σ would be truncated by the reach, and so be biased.
    max_std_voxels: Annotated[float, expert("largest σ of a distance, voxels", 0.01, 1000)] = 3.0
    # Mismatches rarely agree in three frames.
    min_frames: Annotated[int, expert("least number of frames that see a point of a fused surface", 1, 10_000)] = 3
