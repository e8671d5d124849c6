"""Thresholds of the front-end and of all rules, each with its reason and its bounds.

They are for measurements and may change in any version: one list, in which each can be varied or switched off alone
(`tools/ablation.py`).
"""

from typing import Annotated

from .dense_rules import DenseRules
from .inertia_rules import InertiaRules
from .picture_rules import GhostRules, ImageRules
from .point_rules import PointRules, TemplateRules
from .reported_rules import ReportedRules
from .robust_rules import RobustRules
from .section import Section, expert


class MotionRules(Section, frozen=True, kw_only=True):
    """Which motion is that of the camera, and how the history of a track counts."""

    # After a sudden blur of 5 px, 14 of 196 tracks agreed by chance with a motion that was wrong by 7 cm.
    min_agreement: Annotated[float, expert("least share of votes in view that agree with a motion", 0, 1)] = 0.15
    # A camera rarely accelerates by more.
    jump_sigmas: Annotated[float, expert("a jump exceeds this multiple of σ of the acceleration", 0.1, 1000)] = 4.0
    # Views that come back do so within a second; after that too much has changed for optical flow.
    max_gap_s: Annotated[float, expert("time to seek the tracks of the last good frame, s", 0, 100)] = 1.0
    # It is 0.93 or more in the first frames of calm scenes, and 0.68 to 0.77 in a crowd, with a right or wrong
    # motion.
    calm_start: Annotated[float, expert("share of points that agree with a camera's motion", 0, 1)] = 0.8
    # It is half a second for most cameras. With more, the last old tracks in a turn would outvote all new ones.
    full_history: Annotated[int, expert("frames of agreement beyond which history no longer counts", 1, 1000)] = 10
    # A body that enters the view is outvoted, but not for ever once it is all that is left in most of the image.
    first_vote: Annotated[float, expert("vote of a track that never agreed, share of the largest", 1e-3, 1e6)] = 0.1
    # A tenth forgets depths from a wrong motion. Less is slower to recover; more wastes earlier views.
    forgetting: Annotated[float, expert("growth per frame of the variance of inverse depth", 1, 10)] = 1.1
    # With 1, 41 frames of KITTI 06 are degraded.
    slides_most: Annotated[float, expert("multiple of the template drift that a track survives", 0, 100)] = 2.0
    # Because of noise, not all of them agree even with the right motion.
    as_many: Annotated[float, expert("share of old tracks that must agree with the steadier motion", 0, 1)] = 0.9
    # This is long enough to average, and short enough to follow a camera that is put on a vehicle.
    unsteady_frames: Annotated[int, expert("frames over which changes of the motion are averaged", 1, 10_000)] = 30
    # A few frames say more than the assumptions about any camera.
    assumed_frames: Annotated[float, expert("weight of the assumed changes of motion, frames", 1, 10_000)] = 5.0
    # These are odds of 10, beyond which a second motion leaves no doubt either (`robust.ambiguous_share`).
    confirmed_nats: Annotated[float, expert("evidence of new points that confirms a motion, nats", 0.01, 1e6)] = 2.3
    # Fewer agree by chance.
    hidden_views: Annotated[int, expert("least number of new tracks of a body in front", 2, 10**9)] = 12
    one_body: Annotated[bool, expert("refuse motions between those of two bodies")] = True
    poor_frames: Annotated[bool, expert("give all views more noise if most of them fit badly")] = True
    # A jump of a moving body says nothing about the camera.
    most_unsteady: Annotated[
        float, expert("cap on a squared change of motion, multiple of the earlier mean", 1, 1e6)
    ] = 9.0
    # Squared distances of six unknowns are 6 on average.
    inertial_near: Annotated[float, expert("largest squared distance of a motion from inertia", 0, 1e6)] = 20.0
    # This corresponds to odds of 1800.
    inertial_apart: Annotated[
        float, expert("least difference between two motions' squared distances from inertia", 0, 1e6)
    ] = 15.0


class StartRules(Section, frozen=True, kw_only=True):
    """At the start of a map: which of two motions has its points behind the points of the other."""

    # Fewer say nothing about a second motion.
    unexplained: Annotated[float, expert("share of disagreeing tracks from which a motion is sought", 0, 1)] = 0.2
    # The share is smaller along the ground, which lies behind and in front of its neighbours.
    behind: Annotated[float, expert("share of neighbours that must be in front of points behind them", 0.5, 1)] = (
        0.95
    )
    # One start in a thousand follows a body, and 5 σ are 14 more.
    body: Annotated[float, expert("log-odds from which points that agree are on a body in front", 0, 1e6)] = 21.0
    # Depths of neighbours on one surface differ by less.
    deeper: Annotated[float, expert("factor between two depths that differ", 1.01, 100)] = 1.25


class RepetitionRules(Section, frozen=True, kw_only=True):
    """Whether the scene is repetitive, so that another motion explains the images equally well."""

    # Each costs most of a millisecond.
    samples: Annotated[int, expert("number of tracks that are examined for look-alikes", 1, 1000)] = 24
    # This is as for points of the coarse image.
    half_px: Annotated[int, expert("half width of the correlated patch, px of the half-size image", 2, 50)] = 6
    # This is as far as optical flow reaches.
    reach: Annotated[int, expert("search range of look-alikes is the width over this", 1, 100_000)] = 3
    # This is as along the row (`points.match_lead`): a patch with a smaller lead is a look-alike.
    lead: Annotated[float, expert("lead in correlation over a patch that is not a look-alike", 0, 1)] = 0.06
    # This is a whole pixel of the half-size image.
    std_px: Annotated[float, expert("σ of the position of a look-alike, px", 0.1, 100)] = 2.0
    # With fewer, a motion may be chance.
    share: Annotated[float, expert("share of the look-alikes, by weight, that must move as one", 0, 1)] = 0.5
    # Along a facade of equal windows, 8 or more of 96 look different at the other place; along a tiled wall hardly
    # any do.
    compared: Annotated[int, expert("tracks whose patches are compared at both places", 1, 2000)] = 96
    # The correlation of a patch with itself, a frame later, is higher.
    found: Annotated[float, expert("least correlation of a patch that is found again", 0, 1)] = 0.8
    # This is five times the lead.
    less: Annotated[float, expert("least drop of the correlation at a look-alike's place", 0, 2)] = 0.3


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
    contrast: Annotated[float, expert("gain of quarter-size images after the local mean is removed", 0.1, 255)] = (
        12.0
    )
    # These are levels of the quarter image; at the top, 21 px are half an image.
    wide_levels: Annotated[int, expert("pyramid levels for wide templates", 0, 8)] = 2
    # Chosen by hand: steps of automatic exposure are larger.
    same_gain: Annotated[float, expert("change of contrast below which the exposure is unchanged", 0, 1e8)] = 0.05
    same_level_grey: Annotated[
        float, expert("change of mean grey below which the exposure is unchanged", 0, 1e8)
    ] = 4.0


class PairRules(Section, frozen=True, kw_only=True):
    """Whether the left image, the right image and the calibration fit each other."""

    # Sample logs have 0.64 or more, the end of a bare corridor less; a stopped, swapped or turned camera is below
    # 0.3.
    fit: Annotated[float, expert("share of the points agreeing on the left that agree on the right", 0, 1)] = 0.5
    # No moving body has as many by chance.
    fewest_old: Annotated[int, expert("least number of points from before a problem that end it", 1, 2000)] = 8
    # One frame with a problem has this evidence. New points that fit end it within a second for most cameras.
    bound_nats: Annotated[float, expert("evidence that begins or ends a problem, nats", 0.1, 1e6)] = 7.0
    memory_frames: Annotated[float, expert("frames over which new points show that images fit", 1, 1e6)] = 30.0
    good_share: Annotated[float, expert("share of all points that agree in a good frame", 0, 1)] = 0.6
    # With real calibrations, rows differ by up to 1.9 px in a corner.
    max_rows_px: Annotated[float, expert("largest row difference of left and right, px", 0.1, 1e8)] = 2.5
    # Real matches scatter around their polynomial by up to 0.3 px.
    max_scatter_px: Annotated[float, expert("largest scatter of the rows of matches, px", 0.05, 1e8)] = 0.5
    # It is 1.2 at most on any sample log, and 5 to 30 with a wrong calibration.
    max_factor: Annotated[float, expert("largest variance of views over that by image noise", 1, 1e8)] = 4.0
    # Principal points of real cameras are within 0.1 of the middle. In a calibration for half the resolution they
    # lie at a quarter of the size, for twice the resolution in the corner. In a cropped image they can be anywhere.
    same_place: Annotated[float, expert("share of the size by which a principal point may differ", 0, 0.5)] = 0.03


class TurnRules(Section, frozen=True, kw_only=True):
    """A right camera that is knocked out of alignment."""

    # About one knock per hour at 30 Hz.
    knocks: Annotated[float, expert("prior probability of a knock, per frame", 1e-300, 0.5)] = 1e-5
    # It is 0.01 to 0.05 mrad on rendered logs, and 0.05 to 0.2 mrad on real ones.
    first_guess_rad: Annotated[
        float, expert("first guess of the usual rotation between frames, rad", 1e-7, 0.1)
    ] = 1e-4
    guess_frames: Annotated[int, expert("weight of the first guess of the usual rotation, frames", 1, 10_000)] = 5
    # This is 3 σ on each axis.
    limit: Annotated[float, expert("cap on χ² of a frame in the usual rotation", 1, 1e6)] = 27.0
    # Three frames fit in one window and keep depths valid.
    lasting_frames: Annotated[
        int, expert("frames with one rotation of the right camera before it is accepted", 1, 1000)
    ] = 3
    same: Annotated[float, expert("tolerance of consecutive rotations, relative to their mean", 0, 10)] = 0.5
    # After that, an ever-changing rotation counts as usual.
    patience_frames: Annotated[int, expert("largest number of frames with unusual rotations", 1, 1000)] = 8
    # Templates are not found from farther away; left and right then do not fit each other.
    max_turn_px: Annotated[float, expert("largest rotation that is accepted, px", 0.1, 1000)] = 4.0
    # This is three to four for each of the nine unknowns.
    min_views: Annotated[int, expert("least number of right views that show a rotation", 9, 2000)] = 30
    # If a body covers them, it explains fewer.
    agree: Annotated[float, expert("share of the right views that a rotation must explain", 0, 1)] = 0.6
    gate: Annotated[
        float, expert("share of good right views that the gate of a rotation keeps", 0.5, 0.999999999999)
    ] = 0.999
    # After a knock, views are wrong by ten standard deviations or more.
    steps: Annotated[int, expert("largest number of reweighting steps for a rotation", 1, 1000)] = 12
    # The estimator only starts from the measured rotation, so that it is not counted twice.
    std_rad: Annotated[float, expert("prior σ of the rotation by a knock, about each axis, rad", 1e-6, 0.5)] = 3e-3


class RowRules(Section, frozen=True, kw_only=True):
    """How row differences of left and right are learnt."""

    # Real calibrations were wrong by up to 0.8 px in the corners.
    std_px: Annotated[float, expert("prior σ of each coefficient of the row difference, px", 1e-3, 100)] = 1.0
    # Lenses that warm up move rows by a pixel in some hundred frames.
    step_px: Annotated[float, expert("σ of the change of a coefficient per frame, px", 0, 10)] = 2e-3
    # Within a few frames the scatter of the matches replaces it.
    std_match_px: Annotated[float, expert("σ of one match before any is seen, px", 1e-3, 100)] = 0.2
    # After that, Cauchy weights hardly change.
    reweightings: Annotated[int, expert("reweightings of one frame's matches", 1, 100)] = 5
    # One good match in 16 000 is lost.
    gate_sigmas: Annotated[float, expert("largest distance of a match from its row, σ", 0.1, 1000)] = 4.0
    # This is three times the scatter of good matches. With less, a few matches that agree by chance would set the
    # gate.
    least_gate_px: Annotated[float, expert("least gate of a match about its row, px", 1e-3, 100)] = 0.3
    # All matches use the same extrapolated velocities. The error is 11 and 18 % on two rendered logs with a late
    # camera.
    speed_error: Annotated[float, expert("relative error of a delay", 0, 10)] = 0.2
    # A shaken camera turns so fast, and within some frames the other way.
    std_turning_rad_s: Annotated[float, expert("σ of an unknown turn rate of the camera, rad/s", 0, 100)] = 1.0


class ErrorRules(Section, frozen=True, kw_only=True):
    """The noise of views, and how long the error of a template lasts."""

    # Outside a fifth and five times the expected σ, something else is wrong.
    least_factor: Annotated[float, expert("least variance factor of views", 1e-6, 1)] = 0.05
    most_factor: Annotated[float, expert("largest variance factor of views", 1, 1e6)] = 30.0
    # With fewer, χ²/dof scatters by a third or more.
    min_dof: Annotated[int, expert("degrees of freedom of a frame that the factor learns from", 1, 10_000)] = 20
    # Views of a rendered wall scatter by about this much.
    typical_std_px: Annotated[float, expert("σ of a view before anything is measured, px", 1e-3, 100)] = 0.15
    # With a quarter, estimates from halves of the tracks agree within their σ, on rendered and on real logs.
    left_fraction: Annotated[float, expert("lasting error of the left side, share of the right one", 0, 1)] = 0.25
    first_white: Annotated[float, expert("first guess of the white part of the error, σ²", 1e-3, 100)] = 1.0
    first_lasting: Annotated[float, expert("first guess of the lasting part of the error, σ²", 0, 100)] = 0.3
    first_decay: Annotated[float, expert("first guess of the decay of lasting errors per frame", 0.01, 0.999)] = (
        0.92
    )
    # One frame has about as many.
    guess_pairs: Annotated[float, expert("weight of the first guess of lasting errors, pairs of views", 1, 1e6)] = (
        200.0
    )
    # A hundred frames: the errors are a property of cameras and scene and change slowly.
    memory_pairs: Annotated[float, expert("pairs of views that are remembered", 1, 1e8)] = 20_000.0
    # Older points get the least σ.
    remembered_points: Annotated[int, expert("points whose shared disparity error is remembered", 1, 10**7)] = (
        20_000
    )
    # Beyond it the match may be wrong.
    most_row_sigmas: Annotated[float, expert("largest row difference of a view that counts, σ", 0.1, 1000)] = 3.0
    # From then on information grows at a steady rate.
    oldest_views: Annotated[int, expert("views of a track beyond which more count the same", 2, 10_000)] = 60
    # Images always have noise.
    least_white: Annotated[float, expert("least share of white noise", 1e-3, 1)] = 0.05
    # An error with a smaller decay is white.
    least_decay: Annotated[float, expert("least decay of the lasting part", 0.01, 0.999)] = 0.5
    # Longer durations cannot be distinguished within the life of a track.
    most_decay: Annotated[float, expert("largest decay of the lasting part", 0.01, 0.999)] = 0.98
    # This is σ₀ of eq. (18), for a patch whose halves agree. On two rendered logs the median error of local
    # structure is 0.5 and 1.6 times its σ with it, and 2.6 and 2.8 times without.
    std_shared_px: Annotated[float, expert("σ of the disparity error that a point's views share", 0, 10)] = 0.04
    # This is s of eq. (17). With exact poses and depths, `python -m tools.track_errors` gives a tenth to two
    # tenths, both along the line of sight and across it.
    slide: Annotated[float, expert("share of a patch's change by which its position slides", 0, 10)] = 0.1
    # s_b of eq. (17c). The largest NEES of poses (6 degrees of freedom) on logs blurred by up to 6 px is 21 with it and
    # 61 without; with a tenth it is 64.
    slide_blurred: Annotated[float, expert("share of a change of sharpness by which a patch slides", 0, 10)] = 0.2
    # Without it, over 6 m of a rendered corridor, the pitch error is 0.4 mrad, three times its σ; in a rendered
    # office of 256 px the NEES of poses is 22 instead of 11.
    alike: Annotated[float, expert("share of the slide that all patches of a frame have in common", 0, 1)] = 0.75


class MonoRules(Section, frozen=True, kw_only=True):
    """With one camera: when a map begins, and the weight of its depths."""

    # A motion that puts more points behind the camera is wrong.
    min_in_front: Annotated[float, expert("least share of points in front of the camera", 0, 1)] = 0.5
    # Estimators also get the views from which depths were learnt. In simulation (tests/estimators/test_mono.py) the
    # mean NEES of the pose is then 3.8 and 3.7 for two motions (6 is expected); with 0.4 it was 8.9 and 6.9.
    depth_std_factor: Annotated[float, expert("factor on the σ of depths that estimators get", 0.01, 100)] = 2.0
    # One σ covers everything from infinity to a quarter of the distance of the scene, so the first parallax
    # outweighs it.
    unknown_depth: Annotated[float, expert("σ of an unknown inverse depth, medians of the scene", 0.01, 1000)] = 3.0
    # With fewer, the rest may be a single moving object.
    min_tracks: Annotated[int, expert("least number of points tracked since the opening frame", 8, 2000)] = 30
    min_followed: Annotated[float, expert("least share of the points of the opening frame", 0, 1)] = 0.5
    # One good ray in 2 000 is lost.
    gate_sigmas: Annotated[float, expert("largest distance of a ray from its epipolar line, σ", 0.1, 1000)] = 3.5
    # OpenCV's default is 0.999.
    ransac_confidence: Annotated[float, expert("probability of a clean RANSAC draw", 0.5, 0.999999)] = 0.9999
    # The usual width is 1.3, but RANSAC has already removed the outliers.
    huber_sigmas: Annotated[float, expert("width of Huber's loss, σ", 0.1, 1000)] = 2.0
    # A map begins when these hold; with stricter limits it begins later, with looser ones its first depths are worse.
    min_agreement: Annotated[float, expert("share of rays that one motion must explain", 0, 1)] = 0.7
    min_significance: Annotated[float, expert("least median of inverse depth over its σ", 1, 1e6)] = 10.0
    max_std_direction_rad: Annotated[float, expert("largest σ of the motion's direction, rad", 1e-4, 10)] = 0.035
    # Nearer points were passed or mismatched.
    min_depth: Annotated[float, expert("least current depth, share of the first depth", 0, 1)] = 0.05


class Rules(Section, frozen=True, kw_only=True):
    """Thresholds for measurements, which may change in any version."""

    motion: MotionRules = MotionRules()
    start: StartRules = StartRules()
    repetition: RepetitionRules = RepetitionRules()
    flow: FlowRules = FlowRules()
    points: PointRules = PointRules()
    templates: TemplateRules = TemplateRules()
    pair: PairRules = PairRules()
    turn: TurnRules = TurnRules()
    rows: RowRules = RowRules()
    errors: ErrorRules = ErrorRules()
    ghosts: GhostRules = GhostRules()
    images: ImageRules = ImageRules()
    mono: MonoRules = MonoRules()
    inertia: InertiaRules = InertiaRules()
    robust: RobustRules = RobustRules()
    reported: ReportedRules = ReportedRules()
    dense: DenseRules = DenseRules()
