"""Settings of a map, each with its reason: when a keyframe is kept, and what counts as a recognised place."""

import math

from ..record import record


@record
class PlaceSettings:
    """Settings for all rigs: lengths are in units of the median depth of a view."""

    # A keyframe is due. At 0.1 and 8° a corridor has a fifth more keyframes and costs a third more.
    moved_depths: float = 0.15
    turned_rad: float = math.radians(11)
    # Share of points in common with the last keyframe below which much of the view is new. Without it, a camera put
    # back into a map of a block has an error of 70 mm instead of 17.
    new_view: float = 0.5
    min_frames: int = 2  # between keyframes; with 1, a corridor there and back has a sixth more keyframes and cost
    # σ of a rotation beyond which a motion is unknown: nothing is linear there, and GTSAM finds no solution for a
    # graph with such motions beside others of 0.1 mrad.
    unknown_rad: float = 0.3
    # Factor on the variance of the own error of a motion, and of a loop: successive ones see the same structure, so
    # their errors add up to more than independent ones. In seven rendered worlds, errors of successive motions and
    # of successive loops have correlations of 0.2 to 0.5, and 0.1 to 0.4 with one in between. The NEES of the maps
    # (6 is expected) is 1.6 to 13.9 with a factor of 2 on motions alone, and 0.8 to 7.1 with 3 on both.
    shared_structure: float = 3.0

    # The data of a keyframe.
    max_points: int = 150  # with patches; an engine reports 60 to 140 of 200 on most sample logs, 20 on bare walls
    radius_px: int = 7  # of the aligned patches
    min_inverse_depth: float = 1e-3  # 1/m, of features: nothing beyond a kilometre

    # Which keyframes are examined.
    nearest: int = 64  # by predicted pose, whose covariances are examined: a query costs the same in any map
    # From farther away a place is rarely found, and its motion is biased. If a prediction is less certain than
    # that, another place that looks the same is possible.
    max_offset_depths: float = 0.5
    max_angle_rad: float = math.radians(40)
    # Least excess of the path from an older keyframe over the straight line. Without a detour, the same points are
    # seen a second time, as happens 42 times on the log backyard, which does not return.
    min_detour_depths: float = 0.25
    candidates: int = 3  # with one, cameras are located in the wrong one of five identical rooms
    apart: int = 3  # in keyframes: nearer ones show the same
    # Number of words. All of 480 places of random descriptors with a tenth of their bits changed are found; with
    # 256 words, 1 in 15 is missed, and 1 in 25 with trained words.
    words: int = 512

    # What is verified.
    max_ratio: float = 0.85  # of the distances of features to the best and the second best match
    min_views: int = 15  # with 25, a corridor there and back has a recall of 0.69 instead of 0.88
    # Of the 4 × 4 cells of the image that must hold accepted views, so that a single poster is not enough. Without
    # it, one of 26 pairs taken for the same place in a corridor is not.
    min_cells: int = 5
    # Each round warps the patches by the motion of the last; with 2 the NEES of kitti00_mid is 287 instead of 225.
    passes: int = 3
    # Of a view: patches are assumed to face the camera, as their slopes are unknown. The NEES of loops is 1 to 6.
    std_px: float = 0.2

    # What counts as a loop.
    agreeing: int = 3  # loops of different keyframes, if another place is possible
    max_pending: int = 30  # loops that wait for others that agree
    # Loops first get ten times their σ: GTSAM's annealing starts with residuals of at most 1000 σ, which true loops
    # exceed after bad odometry; three of eight such graphs lost every loop.
    spreads: tuple[float, float] = (10.0, 1.0)
    outdated: float = 0.5  # change of a common error since the last solution, in units of its σ then
    search_frames: int = 30  # after a loss, in which keyframes are due sooner; later only if a place looks familiar
    waiting: int = 2  # keyframes, one of which is being processed
    max_keyframes: int = 1000  # some 60 MB
    thinned: float = 0.1  # of all keyframes, at once, if there are too many


SETTINGS = PlaceSettings()
