"""Numbers by which the front-end decides, each with its reason and its ends.

Few runs change one: they are settings so that they stand in one list, and so that each can be varied or switched off
alone (`tools/ablation.py`).
"""

from typing import Annotated

from .image_rules import EchoRules, FieldRules, GhostRules, ImageRules, SmearRules, StillRules
from .inertia_rules import InertiaRules
from .point_rules import PointRules, TemplateRules
from .section import Section, expert


class MotionRules(Section, frozen=True, kw_only=True):
    """Which motion is the camera's, and what the history of a track counts."""

    # After a sudden blur of 5 px 14 of 196 agreed, by chance, with a motion that was off by 7 cm.
    min_agreement: Annotated[float, expert("least share of votes in view that agree with a motion", 0, 1)] = 0.15
    # A camera rarely accelerates by more.
    jump_sigmas: Annotated[float, expert("a motion jumps beyond so many σ of the acceleration", 0.1, 1000)] = 4.0
    # Views that return do so within a second; after that too much has changed for flow.
    max_gap_s: Annotated[float, expert("how long the tracks of the last good frame are sought, s", 0, 100)] = 1.0
    # 0.93 and more in the first frames of calm scenes, 0.68 to 0.77 in a crowd, whether the motion is right or not.
    calm_start: Annotated[float, expert("share of new points that agree with a camera's motion", 0, 1)] = 0.8
    # Half a second for most cameras: with more, the last old tracks in a turn would outvote all new ones.
    full_history: Annotated[int, expert("frames of agreement beyond which history no longer counts", 1, 1000)] = 10
    # A body that enters the view is outvoted, but not for ever, once it is all that is left in most of the image.
    first_vote: Annotated[float, expert("vote of a track that never agreed, share of the largest", 1e-3, 1e6)] = 0.1
    # A tenth forgets depths that a wrong motion carried along. Less is slower to recover, more wastes earlier views.
    forgetting: Annotated[float, expert("growth per frame of the variance of inverse depth", 1, 10)] = 1.1
    # With 1, 41 frames of KITTI 06 are degraded.
    slides_most: Annotated[float, expert("multiple of the template drift that a track survives", 0, 100)] = 2.0
    # So many agree by noise with either motion.
    as_many: Annotated[float, expert("share of old tracks that must agree with the steadier motion", 0, 1)] = 0.9
    # Long enough to average, short enough to follow a camera that is put on a vehicle.
    unsteady_frames: Annotated[int, expert("frames over which changes of the motion are averaged", 1, 10_000)] = 30
    # A few frames say more than what is assumed of any camera.
    assumed_frames: Annotated[float, expert("frames that the assumed changes count for", 1, 10_000)] = 5.0
    # Where one set of tracks leaves the view, that does not say that the other was the background.
    ambiguity_lasts: Annotated[float, expert("how long an ambiguity lasts, times as long as it has", 0, 1000)] = 1.0
    # Fewer agree by chance.
    hidden_views: Annotated[int, expert("new tracks of a body that hides the background, at least", 2, 10**9)] = 12
    one_body: Annotated[bool, expert("refuse motions between those of two bodies")] = True
    poor_frames: Annotated[bool, expert("where most views fit badly, give all of them more noise")] = True
    # A jump that was a body's says nothing of the camera.
    most_unsteady: Annotated[float, expert("largest change counted, mean squares of earlier ones", 1, 1e6)] = 9.0
    # Squared distances of six unknowns: 6 on average.
    inertial_near: Annotated[float, expert("squared distance to inertia of a camera's motion", 0, 1e6)] = 20.0
    # Odds of 1800.
    inertial_apart: Annotated[float, expert("by which squared distances of two motions must differ", 0, 1e6)] = 15.0


class StartRules(Section, frozen=True, kw_only=True):
    """At the start of a map: which of two motions has its points behind those of the other."""

    # Fewer say nothing about a second motion.
    unexplained: Annotated[float, expert("share of disagreeing tracks that are asked for a motion", 0, 1)] = 0.2
    # Less along the ground, which lies behind and before its neighbours.
    behind: Annotated[float, expert("share of neighbours that must be in front", 0.5, 1)] = 0.95
    # Two determine a motion. Frames that a body leads have 1.4 to 8; on sound logs no other motion is found at all.
    clear_views: Annotated[float, expert("views that contradict the motion of the nearest points", 0, 1000)] = 2.0
    # Depths of neighbours on one surface differ by less.
    deeper: Annotated[float, expert("factor between two depths that differ", 1.01, 100)] = 1.25


class RepetitionRules(Section, frozen=True, kw_only=True):
    """Whether the scene repeats itself, so that another motion explains the images as well."""

    # Of each costs most of a millisecond.
    samples: Annotated[int, expert("tracks that are looked at", 1, 1000)] = 24
    # As for points of the coarse image.
    half_px: Annotated[int, expert("half width of the correlated patch, px of the half-size image", 2, 50)] = 6
    # As far as flow reaches.
    reach: Annotated[int, expert("look-alikes are sought within the width of the image over this", 1, 100_000)] = 3
    # As along the row (`points.match_lead`): what comes closer is a look-alike.
    lead: Annotated[float, expert("lead in correlation over what is not a look-alike", 0, 1)] = 0.06
    # A whole pixel of the half-size image.
    std_px: Annotated[float, expert("σ of the position of a look-alike, px", 0.1, 100)] = 2.0
    # A motion of fewer is chance.
    share: Annotated[float, expert("share of the look-alikes, by weight, that must move as one", 0, 1)] = 0.5
    # Along a facade of equal windows 8 and more of 96 look otherwise at the other place, before a wall of tiles hardly
    # any.
    compared: Annotated[int, expert("tracks whose patches are compared at both places", 1, 2000)] = 96
    # Correlations of a patch with itself, a frame later, are above.
    found: Annotated[float, expert("least correlation of a patch that is found again", 0, 1)] = 0.8
    # Five times the lead.
    less: Annotated[float, expert("by which the correlation at the other place must be lower", 0, 2)] = 0.3


class FlowRules(Section, frozen=True, kw_only=True):
    """Optical flow, and the rough motion that it shows."""

    # A guess on the large side.
    std_px: Annotated[float, expert("σ of a position by flow, for gating the rough motion, px", 0.01, 50)] = 0.5
    # Below, the next attempt is made, and then the best of all is taken.
    enough: Annotated[float, expert("share of the votes found that ends the search for a motion", 0, 1)] = 0.4
    # Windows of 15 px then cover an eighth as many image widths, and a motion of a third of the image is reached.
    # OpenCV leaves out levels that are smaller than the window.
    more_levels: Annotated[int, expert("further pyramid levels where the motion is not known", 0, 8)] = 3
    # Flow alone follows a patch that grows or shrinks by a quarter; with it, by 0.55 to 1.8.
    zoom: Annotated[float, expert("change of size that is tried, forwards and backwards", 1.01, 10)] = 1.4
    # OpenCV's default is 30; a start needs less.
    max_steps: Annotated[int, expert("most iterations of flow", 1, 1000)] = 20
    # OpenCV's default is 0.01.
    converged_px: Annotated[float, expert("step that ends them, half-size pixels", 1e-6, 10)] = 0.03
    # Of a window's gradient matrix per pixel, OpenCV's scale: a tenth of its default, for dark images.
    min_eigenvalue: Annotated[float, expert("least texture of a window that is followed", 0, 1)] = 1e-5
    # Corners of a patch's size are found there, and a search along the row is short. Front-end on images of 1241
    # columns 27 -> 19 ms, together with other savings.
    coarse_columns: Annotated[int, expert("columns of the coarse images, at most", 64, 100_000)] = 800
    # What is larger is light and shade.
    local_px: Annotated[float, expert("σ of the Gaussian taken out of quarter-size images, px", 1, 1000)] = 10.0
    # A blotch of one grey value is as strong as texture usually is then.
    contrast: Annotated[float, expert("factor on what is left in these images", 0.1, 255)] = 12.0
    # Of the quarter image, where 21 px are half an image then.
    wide_levels: Annotated[int, expert("pyramid levels for wide templates", 0, 8)] = 2
    # Chosen by hand: steps of automatic exposure are larger.
    same_gain: Annotated[float, expert("change of contrast below which exposure is the same", 0, 1e8)] = 0.05
    same_level_grey: Annotated[float, expert("change of the mean grey value below which it is", 0, 1e8)] = 4.0


class PairRules(Section, frozen=True, kw_only=True):
    """Whether left and right image, and the calibration, fit each other."""

    # Sample logs have 0.64 or more, the end of a bare corridor less; a stopped, exchanged or turned camera below 0.3.
    fit: Annotated[float, expert("share of the points agreeing on the left that agree on the right", 0, 1)] = 0.5
    # As many as no body has by chance.
    fewest_old: Annotated[int, expert("points from before a problem that end it, at least", 1, 2000)] = 8
    # A second for most cameras.
    good_frames: Annotated[int, expert("good frames in a row that end a problem", 1, 10_000)] = 20
    good_share: Annotated[float, expert("share of all points that agree in a good frame", 0, 1)] = 0.6
    # In real calibrations rows are off by up to 1.9 px in a corner.
    max_rows_px: Annotated[float, expert("largest row difference of left and right, px", 0.1, 1e8)] = 2.5
    # Real ones scatter around their polynomial by up to 0.3 px.
    max_scatter_px: Annotated[float, expert("largest scatter of the rows of matches, px", 0.05, 1e8)] = 0.5
    # 1.2 at most on any sample log, 5 to 30 with a wrong calibration.
    max_factor: Annotated[float, expert("largest variance of views over what images explain", 1, 1e8)] = 4.0
    # Principal points of real cameras are within 0.1 of the middle, those of a calibration of half the resolution lie
    # at a quarter, of twice the resolution in the corner. A part of an image has its own anywhere.
    same_place: Annotated[float, expert("share of the size by which a principal point may differ", 0, 0.5)] = 0.03


class StepRules(Section, frozen=True, kw_only=True):
    """Whether both images have been displaced at once."""

    # On sample logs, and hand-held ones, changes that the next frame undoes stay below a third of this.
    least_px: Annotated[float, expert("least size of a step, px", 0.1, 10_000)] = 2.0
    unusual: Annotated[float, expert("least size of a step, medians of the last changes", 1, 1e6)] = 6.0
    remembered: Annotated[int, expert("changes that are remembered", 1, 10_000)] = 20
    fewest: Annotated[int, expert("changes that it takes to know what is usual", 1, 10_000)] = 5
    # Noise and the camera's own motion.
    back: Annotated[float, expert("share of the change that may be left in the next frame", 0, 1)] = 0.5


class TurnRules(Section, frozen=True, kw_only=True):
    """A right camera that is knocked out of alignment."""

    # One in an hour.
    knocks: Annotated[float, expert("prior probability of a knock, per frame", 1e-300, 0.5)] = 1e-5
    # Rendered logs have 0.01 to 0.05 mrad, real ones 0.05 to 0.2.
    first_guess_rad: Annotated[float, expert("first guess of the usual turn, rad", 1e-7, 0.1)] = 1e-4
    guess_frames: Annotated[int, expert("frames that the first guess counts for", 1, 10_000)] = 5
    # Three σ of each axis.
    limit: Annotated[float, expert("χ² beyond which a frame counts no more for what is usual", 1, 1e6)] = 27.0
    # Within one window, and few enough for depths to stay valid.
    lasting_frames: Annotated[int, expert("frames with one turn before it is accepted", 1, 1000)] = 3
    same: Annotated[float, expert("share by which these turns may differ from their mean", 0, 10)] = 0.5
    # An ever-changing turn counts as usual then.
    patience_frames: Annotated[int, expert("frames with unusual turns, at most", 1, 1000)] = 8
    # Templates are not found from further away; then left and right do not fit.
    max_turn_px: Annotated[float, expert("largest turn that is believed, px", 0.1, 1000)] = 4.0
    # Three and a half for each of the nine unknowns.
    min_views: Annotated[int, expert("right views that a turn is found from, at least", 9, 2000)] = 30
    # Where a body covers them it explains fewer.
    agree: Annotated[float, expert("share of the right views that a turn must explain", 0, 1)] = 0.6
    gate: Annotated[float, expert("share of good views that its gate keeps", 0.5, 0.999999999999)] = 0.999
    # After a knock, views are off by ten standard deviations and more.
    steps: Annotated[int, expert("steps of reweighting that find a turn, at most", 1, 1000)] = 12
    # The measured turn is where the estimator starts; it is not used a second time.
    std_rad: Annotated[float, expert("prior σ of the turn by a knock, about each axis, rad", 1e-6, 0.5)] = 3e-3


class RowRules(Section, frozen=True, kw_only=True):
    """How row differences of left and right are learnt."""

    # Real calibrations were off by up to 0.8 px in the corners.
    std_px: Annotated[float, expert("prior σ of each coefficient of the rows, px", 1e-3, 100)] = 1.0
    # Lenses that warm up move rows by a pixel in some hundred frames.
    step_px: Annotated[float, expert("σ of the change of a coefficient per frame, px", 0, 10)] = 2e-3
    # Within a few frames their own scatter replaces it.
    std_match_px: Annotated[float, expert("σ of one match before any is seen, px", 1e-3, 100)] = 0.2
    # Cauchy weights hardly change after that.
    reweightings: Annotated[int, expert("reweightings of one frame's matches", 1, 100)] = 5
    # One good match in 16 000 is lost.
    gate_sigmas: Annotated[float, expert("σ that a match may be beside its row", 0.1, 1000)] = 4.0
    # Three times the scatter of good matches; below, few matches that agree by chance set the gate.
    least_gate_px: Annotated[float, expert("what it may be at least, px", 1e-3, 100)] = 0.3
    # All matches go by the same extrapolated velocities: 11 and 18 % on two rendered logs with a late camera.
    speed_error: Annotated[float, expert("share of itself by which a delay may be off", 0, 10)] = 0.2


class ErrorRules(Section, frozen=True, kw_only=True):
    """The noise of views, and how long the error of a template lasts."""

    # Beyond a fifth of the σ expected and five times it, something else is wrong.
    least_factor: Annotated[float, expert("least variance factor of views", 1e-6, 1)] = 0.05
    most_factor: Annotated[float, expert("largest variance factor of views", 1, 1e6)] = 30.0
    # With fewer, χ²/dof scatters by a third or more.
    min_dof: Annotated[int, expert("degrees of freedom of a frame that the factor learns from", 1, 10_000)] = 20
    # Views of a rendered wall scatter by about that.
    typical_std_px: Annotated[float, expert("σ of a view before anything is measured, px", 1e-3, 100)] = 0.15
    # With a quarter, estimates from halves of the tracks agree as well as their σ says, on rendered and on real logs.
    left_fraction: Annotated[float, expert("lasting error of the left side, share of the right one's", 0, 1)] = 0.25
    first_white: Annotated[
        float, expert("first guess of the white part of the error, σ² of the view", 1e-3, 100)
    ] = 1.0
    first_lasting: Annotated[float, expert("first guess of the lasting part", 0, 100)] = 0.3
    first_decay: Annotated[float, expert("first guess of what is left of it in the next frame", 0.01, 0.999)] = 0.92
    # About one frame's.
    guess_pairs: Annotated[float, expert("pairs of views that the first guess counts for", 1, 1e6)] = 200.0
    # A hundred frames: the errors are a property of cameras and scene and change slowly.
    memory_pairs: Annotated[float, expert("pairs of views that are remembered", 1, 1e8)] = 20_000.0
    # An older point has the least σ.
    remembered_points: Annotated[int, expert("points whose shared disparity error is remembered", 1, 10**7)] = (
        20_000
    )
    # Beyond, it may be a wrong match.
    most_row_sigmas: Annotated[float, expert("largest row difference of a view that counts, σ", 0.1, 1000)] = 3.0
    # By then information grows at a steady rate.
    oldest_views: Annotated[int, expert("views of a track beyond which more count as the same", 2, 10_000)] = 60
    # Images have noise.
    least_white: Annotated[float, expert("least share of white noise", 1e-3, 1)] = 0.05
    # What is less is white.
    least_decay: Annotated[float, expert("least decay of the lasting part", 0.01, 0.999)] = 0.5
    # What lasts longer cannot be distinguished within the life of a track.
    most_decay: Annotated[float, expert("largest decay of the lasting part", 0.01, 0.999)] = 0.98
    # σ₀ of eq. (18), of a patch whose halves agree. Measured on two rendered logs: with it the median error of local
    # structure is 0.5 and 1.6 times its σ, without it 2.6 and 2.8 times.
    std_shared_px: Annotated[float, expert("σ of the disparity error that a point's views share", 0, 10)] = 0.04
    # s of eq. (17). Measured where poses and depths are exact, by `python -m tools.track_errors`: a tenth to two
    # tenths, along the line of sight as across it.
    slide: Annotated[float, expert("share of a patch's change by which its position slides", 0, 10)] = 0.1
    # Over 6 m of a rendered corridor pitch errs by 0.4 mrad, three times its σ without it; in a rendered office of
    # 256 px poses then have a NEES of 22, not 11.
    alike: Annotated[float, expert("share of the slide of patches that all of a frame have alike", 0, 1)] = 0.75


class MonoRules(Section, frozen=True, kw_only=True):
    """With one camera: when a map begins, and what its depths count."""

    # A motion that turns more points around is wrong.
    min_in_front: Annotated[float, expert("least share of points in front of the camera", 0, 1)] = 0.5
    # Estimators also get the views from which depths were learnt. In simulation (tests/estimators/test_mono.py) the
    # mean NEES of the pose is then 3.8 and 3.7 for two motions, 6 expected; with 0.4 it was 8.9 and 6.9.
    depth_std_factor: Annotated[float, expert("factor on the σ of depths that estimators get", 0.01, 100)] = 2.0
    # Within one σ lies all from infinity to a quarter of the scene's distance: the first parallax outweighs it.
    unknown_depth: Annotated[float, expert("σ of an unknown inverse depth, medians of the scene", 0.01, 1000)] = 3.0
    # What is left of fewer may be one object that moves by itself.
    min_tracks: Annotated[int, expert("points followed since the opening frame, at least", 8, 2000)] = 30
    min_followed: Annotated[float, expert("and least share of those of the opening frame", 0, 1)] = 0.5
    # One good ray in 2 000 is lost.
    gate_sigmas: Annotated[float, expert("σ that a ray may be off its epipolar line", 0.1, 1000)] = 3.5
    # OpenCV's default is 0.999.
    ransac_confidence: Annotated[float, expert("probability of a clean RANSAC draw", 0.5, 0.999999)] = 0.9999
    # The usual width is 1.3, but RANSAC has taken the outliers out already.
    huber_sigmas: Annotated[float, expert("width of Huber's loss, σ", 0.1, 1000)] = 2.0
    # A map begins when these hold; with stricter limits it begins later, with looser ones its first depths are worse.
    min_agreement: Annotated[float, expert("share of rays that one motion must explain", 0, 1)] = 0.7
    min_significance: Annotated[float, expert("least median of inverse depth over its σ", 1, 1e6)] = 10.0
    max_std_direction_rad: Annotated[float, expert("largest σ of the motion's direction, rad", 1e-4, 10)] = 0.035
    # Nearer points were passed or matched wrong.
    min_depth: Annotated[float, expert("least depth now of what is at depth 1 first", 0, 1)] = 0.05


class Rules(Section, frozen=True, kw_only=True):
    """What the front-end decides by, and the window about inertia."""

    motion: MotionRules = MotionRules()
    start: StartRules = StartRules()
    repetition: RepetitionRules = RepetitionRules()
    flow: FlowRules = FlowRules()
    points: PointRules = PointRules()
    templates: TemplateRules = TemplateRules()
    pair: PairRules = PairRules()
    step: StepRules = StepRules()
    turn: TurnRules = TurnRules()
    rows: RowRules = RowRules()
    errors: ErrorRules = ErrorRules()
    ghosts: GhostRules = GhostRules()
    still: StillRules = StillRules()
    echo: EchoRules = EchoRules()
    smears: SmearRules = SmearRules()
    fields: FieldRules = FieldRules()
    images: ImageRules = ImageRules()
    mono: MonoRules = MonoRules()
    inertia: InertiaRules = InertiaRules()
