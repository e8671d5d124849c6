"""The numbers of a map, each with its reason: when a keyframe is kept, and what counts as a place seen again."""

import math

from ..record import record


@record
class PlaceSettings:
    """For all rigs: lengths are in units of the median depth of a view."""

    # A keyframe is due. At 0.1 and 8° a corridor has a fifth more keyframes and costs a third more.
    moved_depths: float = 0.15
    turned_rad: float = math.radians(11)
    # Share of the points in common with the last keyframe, below which much of the view is new. Without it a camera put
    # back into a map of a block is off by 70 mm instead of 17.
    new_view: float = 0.5
    min_frames: int = 2  # between keyframes; at 1 a corridor there and back has, and costs, a sixth more
    # σ of a rotation beyond which a motion is not known: nothing is linear there, and of a graph with such motions
    # beside others of 0.1 mrad GTSAM finds no solution.
    unknown_rad: float = 0.3
    # Factor on the variance of a motion's own error, and of a loop's: successive ones see the same structure, so their
    # errors add up to more than independent ones. In seven rendered worlds the errors of successive motions, and of
    # successive loops, have correlations of 0.2 to 0.5, of the next but one of 0.1 to 0.4. NEES of their maps, 6
    # expected: 1.6 to 13.9 with a factor of 2 on motions alone, 0.8 to 7.1 with 3 on both.
    shared_structure: float = 3.0

    # What is kept of a keyframe.
    max_points: int = 150  # with patches; an engine reports 60 to 140 of 200 on most sample logs, 20 on bare walls
    radius_px: int = 7  # of the patches that are aligned
    min_inverse_depth: float = 1e-3  # 1/m, of features: nothing beyond a kilometre

    # Which keyframes are looked at.
    nearest: int = 64  # by predicted pose, whose covariances are looked at: a query costs the same in any map
    # From further away a place is found rarely, and its motion is biased. Where a prediction is less certain than that,
    # another place could be meant that looks the same.
    max_offset_depths: float = 0.5
    max_angle_rad: float = math.radians(40)
    # Of the way from an older keyframe, beyond the straight line: without a detour the same points are seen a second
    # time, as 42 times on the log backyard, which does not return.
    min_detour_depths: float = 0.25
    candidates: int = 3  # with one, cameras are put into the wrong one of five identical rooms
    apart: int = 3  # keyframes: nearer ones show the same
    # Descriptors that stand for all. Of 480 places of random descriptors, of which a tenth of the bits changes, all are
    # found; with 256 words 1 in 15 is not, and 1 in 25 where words are trained.
    words: int = 512

    # What is verified.
    max_ratio: float = 0.85  # of the distances of features to the best and to the second best match
    min_views: int = 15  # at 25 a corridor there and back has a recall of 0.69 instead of 0.88
    # Of the 4 × 4 cells of the image, that must hold accepted views: not one poster alone. Without it one of 26 pairs
    # that are taken for the same place in a corridor is not.
    min_cells: int = 5
    # Each warps the patches by the motion of the last; with 2 the NEES of kitti00_mid is 287 instead of 225.
    passes: int = 3
    # Of a view: the patch's plane faces the camera here, and its slope is not known. NEES of loops is 1 to 6.
    std_px: float = 0.2

    # What counts as a loop.
    agreeing: int = 3  # loops of different keyframes, where another place could be meant
    max_pending: int = 30  # loops that wait for others that agree
    search_frames: int = 30  # after a loss, in which keyframes are wanted soon; later only if a place looks known
    waiting: int = 2  # keyframes, of which one is being worked on
    thinned: float = 0.1  # of all keyframes, at once, where there are too many


SETTINGS = PlaceSettings()
