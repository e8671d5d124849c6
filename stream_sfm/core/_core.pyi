# The compiled core as Python calls it, written by tools/build/stub.py from the module. Arrays of another type or order
# are copied; one of a wrong shape is a ValueError (TypeError: of a wrong number of axes). Images are (h, w) grey;
# what lies beyond their border is as its rim.

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Grey = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Lines = NDArray[np.int16]
Image = NDArray[np.float32] | NDArray[np.uint8]
Pixels = NDArray[np.integer]
Ids = NDArray[np.int64]
Mask = NDArray[np.bool_]

class PhysicalAxes(Protocol):
    # Axes of the physical camera: the `rotation` (3, 3) of points into them, and σ of errors that no view shows, of
    # lengths as a share of themselves, and of the axes about x and y.
    @property
    def rotation(self) -> Array: ...
    @property
    def std_scale(self) -> float: ...
    @property
    def std_axes_rad(self) -> float: ...

class Field(Protocol):
    # A field over the image: nodes of its grid, columns (U,) and rows (V,), its length, and the root (K, K); K = U
    # V.
    @property
    def u_px(self) -> Array: ...
    @property
    def v_px(self) -> Array: ...
    @property
    def length_px(self) -> float: ...
    @property
    def root(self) -> Array: ...

class Rows(Protocol):
    # What is known of rows: amplitudes (7 + K,) of polynomial, delay and field with their covariance, the scatter
    # of matches and the largest difference of rows.
    @property
    def projection(self) -> Pinholes: ...
    @property
    def field(self) -> Field: ...
    @property
    def mean(self) -> Array: ...
    @property
    def cov(self) -> Array: ...
    @property
    def scatter_px(self) -> float: ...
    @property
    def max_px(self) -> float: ...

class ExposedRows(Protocol):
    # In which rows of the cameras' own images views are: size of the rectified image, and coefficients (s, k, k) of
    # one polynomial for both sides or of one for each.
    @property
    def size_px(self) -> tuple[float, float]: ...
    @property
    def coefficients(self) -> Array: ...

class Timing(Protocol):
    # Delay and readout, seconds: mean (2,) and covariance (2, 2), and the twist (6,) in the frame before, None if
    # unknown.
    @property
    def row_of(self) -> ExposedRows: ...
    @property
    def mean(self) -> Array: ...
    @property
    def cov(self) -> Array: ...
    @property
    def twist(self) -> Array | None: ...

class Mixture(tuple[Array, Array, float]):
    # Errors of a rig as a mixture over what may be exactly zero: mean (m,), covariance (m, m), and p that lenses
    # are wrong.
    mean: Array
    cov: Array
    p_wrong: float

class RightSides(Protocol):
    # Where right sides are sought: the rows, a turn (3,) of the right camera, which is taken out of what is
    # measured there, and the twist (6,) of the points, per second.
    @property
    def rows(self) -> Rows: ...
    @property
    def turn_rad(self) -> Array: ...
    @property
    def twist(self) -> Array: ...

class TemplateConfig(Protocol):
    # Half width of templates and how far from its start one may be found, in their pixels; the largest deviation of
    # grey differences.
    @property
    def window_radius_px(self) -> int: ...
    @property
    def max_realignment_px(self) -> float: ...
    @property
    def max_photometric_error(self) -> float: ...

class ViewNoise(Protocol):
    # Pixels that share one noise value, and the variance factor of views.
    @property
    def shared_pixels(self) -> float: ...
    @property
    def factor(self) -> float: ...

class TemplateKind(Protocol):
    # A kind of templates: image pixels per pixel, and pixels between samples.
    @property
    def scale(self) -> int: ...
    @property
    def spacing_px(self) -> int: ...
    @property
    def config(self) -> TemplateConfig: ...
    @property
    def noise(self) -> ViewNoise: ...

class Tracks(Protocol):
    # Homogeneous points (n, 4) of tracks at unit depth, variances (n,) of 1/Z, covariances (n, 2, 2) px² of left
    # positions, anchor cameras (n, 4, 4), velocities (n, 2) px/s on the left and slopes (n, 2) of 1/Z there, and
    # image pixels (n,) per pixel of the template.
    @property
    def points(self) -> Array: ...
    @property
    def var_rho(self) -> Array: ...
    @property
    def cov_left_px(self) -> Array: ...
    @property
    def anchor_from_start(self) -> Array: ...
    @property
    def anchor_velocity_px_s(self) -> Array: ...
    @property
    def slopes(self) -> Array: ...
    @property
    def scale(self) -> Pixels: ...

class Templates(Protocol):
    # Templates of one kind: left and right image of their pixels (None: without right sides), stored patches as in
    # `warp_patches`, and where in the left image (h, w) a whole patch shows the scene.
    @property
    def left(self) -> Image: ...
    @property
    def right(self) -> Image | None: ...
    @property
    def stored(self) -> Image: ...
    @property
    def area(self) -> Mask: ...
    @property
    def kind(self) -> TemplateKind: ...

class Pinholes(Protocol):
    # A rectified pair, with the size of its images, px.
    @property
    def f_px(self) -> float: ...
    @property
    def cx_left_px(self) -> float: ...
    @property
    def cx_right_px(self) -> float: ...
    @property
    def cy_px(self) -> float: ...
    @property
    def baseline_m(self) -> float: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...

class Views(Protocol):
    # Points with their views: homogeneous `points` (n, 4) with `cov_points` (n, 4, 4), or (0, 4, 4) where they are
    # exact, views `z_px` (n, 4), NaN where a side is missing, with `cov_px` (n, 4, 4), errors that all views share
    # (n, 4, j), and gates (n,) of squared residuals.
    @property
    def projection(self) -> Pinholes: ...
    @property
    def points(self) -> Array: ...
    @property
    def cov_points(self) -> Array: ...
    @property
    def z_px(self) -> Array: ...
    @property
    def cov_px(self) -> Array: ...
    @property
    def shared(self) -> Array: ...
    @property
    def gate(self) -> Array: ...

class Fitted(tuple[Array, Array, Mask, float, int, float, bool, Array, float, Array, Array]):
    # A motion (4, 4), its covariance (6, 6), accepted views (n,), and of these χ² and degrees of freedom; the
    # `spread` of squared residuals; whether enough views agree and determine the motion (`ok`); squared residuals
    # (n,), `share` of the votes, amplitudes (j,) of shared errors and their covariance (j, j).
    cam_from_ref: Array
    cov_pose: Array
    accepted: Mask
    chi2: float
    dof: int
    spread: float
    ok: bool
    squared_residuals: Array
    share: float
    amplitudes: Array
    cov_amplitudes: Array

class Second(tuple[Array, Array, Mask, float]):
    # A second motion (4, 4), its covariance (6, 6), the views (n,) that agree with it only, and their odds.
    cam_from_ref: Array
    cov_pose: Array
    views: Mask
    odds: float

class ResectionRules(Protocol):
    # The settings of a resection, as in `RobustConfig`.
    @property
    def calm_share(self) -> float: ...
    @property
    def calm_spread(self) -> float: ...
    @property
    def beyond_gates(self) -> float: ...
    @property
    def ambiguous_share(self) -> float: ...
    @property
    def halves_apart(self) -> float: ...
    @property
    def shared_noise(self) -> float: ...
    @property
    def max_odds(self) -> float: ...
    @property
    def second_views(self) -> int: ...

class Wanted(Protocol):
    # Whether a second motion is looked for; whether most views agree with the start already, and whether it has
    # been decided that no other motion than that is looked for.
    @property
    def second(self) -> bool: ...
    @property
    def start_is_close(self) -> bool: ...
    @property
    def start_is_decided(self) -> bool: ...

class WindowState(Protocol):
    # The state of a window: poses (F, 4, 4); of the points ids (P,), ascending, anchors (P, 4, 4) and q (P, 3); the
    # rig's errors (m,); amplitudes (F, e) of each frame's own.
    @property
    def cams_from_ref(self) -> Array: ...
    @property
    def ids(self) -> Pixels: ...
    @property
    def ref_from_anchor(self) -> Array: ...
    @property
    def q(self) -> Array: ...
    @property
    def rig_error(self) -> Array: ...
    @property
    def own(self) -> Array: ...

class WindowViews(Protocol):
    # Its views: frame (V,), ids (V,), used (V,), z_px (V, 4), weight (V, 4) and whitening roots (V, 4, 4).
    # Amplitudes of σ = 1 that each frame has of its own move a view by own (V, 4, e). Errors of the rig move it by
    # terms (V, 4, t), of which those of delay and readout get timing (V, 4, 2) added, or (V, 4, 0), and by the
    # parts of a field: moves (4, p) ⊗ field (V, K), m = t + p K.
    @property
    def frame(self) -> Pixels: ...
    @property
    def ids(self) -> Pixels: ...
    @property
    def used(self) -> Mask: ...
    @property
    def z_px(self) -> Array: ...
    @property
    def weight(self) -> Array: ...
    @property
    def root(self) -> Array: ...
    @property
    def own(self) -> Array: ...
    @property
    def terms(self) -> Array: ...
    @property
    def timing(self) -> Array: ...
    @property
    def field(self) -> Array: ...
    @property
    def moves(self) -> Array: ...

class RigKnowledge(Protocol):
    # Information (m, m) about errors of the rig, and weighted sums (m,) of their amplitudes.
    @property
    def information(self) -> Array: ...
    @property
    def weighted(self) -> Array: ...

class Prior(Protocol):
    # Points of a prior (N,): mean (N, 3), D (N, 3, 3) and modes F (N, 3, k), of which the last m are those of the
    # rig's errors.
    @property
    def mean(self) -> Array: ...
    @property
    def cov(self) -> Array: ...
    @property
    def modes(self) -> Array: ...
    @property
    def rig(self) -> RigKnowledge: ...

class NormalBlocks(tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array]):
    # The normal equations of all views, eq. (26): blocks of the frames, of the points, and between them. A frame
    # has f = 6 + e unknowns: its pose, and e amplitudes of its own with their prior of σ = 1. `u` (F, f, f), `v`
    # (P, 3, 3), `w` (P, 3, fF); right-hand sides `g_pose` (F, f), `g_point` (P, 3). Of the rig's errors `rig` (m,
    # m), with the frames `rig_pose` (F, f, m), with the points `rig_point` (P, 3, m), and `g_rig` (m,).
    u: Array
    v: Array
    w: Array
    g_pose: Array
    g_point: Array
    rig: Array
    rig_pose: Array
    rig_point: Array
    g_rig: Array

class CovariancePart(Protocol):
    # One of two parts of the joint covariance of points, a pose and the world, as in normal_equations.py.
    @property
    def root(self) -> Array: ...
    @property
    def reach(self) -> Array: ...
    @property
    def covariant(self) -> Array: ...
    @property
    def with_both(self) -> Array: ...
    @property
    def both(self) -> Array: ...

class AbsorbedPoints(tuple[Ids, Array, Array, Array]):
    # Points of a prior (N,): ids, which are ascending, mean (N, 3), D (N, 3, 3) and modes (N, 3, k).
    ids: Ids
    mean: Array
    cov: Array
    modes: Array

class PointMarginals(tuple[Array, Array, Array, Array, Array, Array, Mask]):
    # Points (P,): q in the camera (P, 3), its covariance (P, 3, 3) given the rig's errors; metric points in the
    # camera (P, 3) and in the world, each with covariances (P, 3, 3); and which are finite: 1/Z is so many σ away
    # from 0.
    q_in_cam: Array
    cov_q_in_cam: Array
    points_in_cam: Array
    cov_points: Array
    points_in_world: Array
    cov_points_in_world: Array
    finite: Mask

class Intervals(Protocol):
    # Intervals (n) between frames: `rotation` (n, 3, 3), velocity and position `motion` (n, 6), Jacobians `by_bias`
    # (n, 9, 6) and `by_clock` (n, 9), `cov` (n, 9, 9), and at which `biases` (n, 6) and `clock` offsets (n,) they
    # were integrated, over how many `seconds` (n,).
    @property
    def rotation(self) -> Array: ...
    @property
    def motion(self) -> Array: ...
    @property
    def by_bias(self) -> Array: ...
    @property
    def by_clock(self) -> Array: ...
    @property
    def cov(self) -> Array: ...
    @property
    def biases(self) -> Array: ...
    @property
    def clock(self) -> Array: ...
    @property
    def seconds(self) -> Array: ...

class Preintegrated(tuple[Array, Array, Array, Array, Array, Array]):
    # The motion of an inertial unit between two times, in its axes at the first one: `rotation` (3, 3), velocity
    # and position `motion` (2, 3) without gravity, their Jacobians `by_bias` (9, 6) and `by_clock` (3, 3), by the
    # time of both ends, and their covariances (9, 9) by either sensor, of (rotation on the right, velocity,
    # position).
    rotation: Array
    motion: Array
    by_bias: Array
    by_clock: Array
    cov_gyro: Array
    cov_accel: Array

RECORDS: dict[str, tuple[bool, str, list[tuple[str, str]]]]  # is returned; help; fields, types

def absorbed_points(
    ids: Pixels,
    std_given: Array,
    moved: Array,
    given: Array,
    q: Array,
    stays: Mask,
    ids_new: Pixels,
    mean_new: Array,
    cov_new: Array,
    modes_new: Array,
) -> AbsorbedPoints: ...
def absorbing_system(
    blocks: NormalBlocks, prior: Prior, ref_from_anchor: Array, q: Array, amplitudes: Array
) -> tuple[Array, Array, Array, Array, Array, Array]: ...
def align_patches(
    image: Image,
    starts_px: Array,
    inverse: Image,
    information: Array,
    level: Image,
    radius_px: int,
    spacing_px: int,
) -> tuple[Array, Mask, Array]: ...
def align_tracks(
    right_sides: RightSides,
    timing: Timing,
    tracks: Tracks,
    slots: Pixels,
    cam_from_previous: Array,
    cam_from_start: Array,
    left_px: Array,
    agree: Mask,
    ordinary: Templates,
    wide: Templates | None | None,
) -> tuple[Mask, Ids, Array, Array, Array, Array, Array]: ...
def among(ids: Pixels, known: Pixels) -> Mask: ...
def corner_strength(image: Image) -> Grey: ...
def cov_of_timed_pose(
    pinholes: Pinholes, exposed: ExposedRows, points_in_cam: Array, size: Array, cov_twist: Array
) -> Array: ...
def disparity_effects(pinholes: Pinholes, points: Array, cam_from_previous: Array, z_px: Array) -> Array: ...
def drawn_edges(
    left: Lines, last: Lines, earlier: Lines, right: Lines, edge_grey: int, same_grey: int, same_step_grey: int
) -> tuple[int, int, int]: ...
def drift_covariances(ids: Pixels, ref_from_anchor: Array, q: Array, seen: Pixels, var_drift: Array) -> Array: ...
def effects_of_turn(pinholes: Pinholes, right_px: Array) -> Array: ...
def eliminate_points(v: Array, w: Array) -> tuple[Array, Array]: ...
def expected_views(
    pinholes: Pinholes, state: WindowState, views: WindowViews, stereo: Mask, expected_px: Array
) -> Array: ...
def field_basis(field: Field, left_px: Array) -> Array: ...
def fit_motion(views: Views, cam_from_ref: Array, amplitudes: Array, votes: Array, anneal: bool) -> Fitted: ...
def fit_turn(
    views: Views, cam_from_ref: Array, usual: Array, std_knock_rad: float
) -> tuple[Array, Array, Mask, float, float]: ...
def gates_of_views(z_px: Array, of_one_side: float, of_both: float) -> Array: ...
def ghost_sums(
    now: Image, last: Image, earlier: Image, now_px: Array, last_px: Array, earlier_px: Array, noise_grey: float
) -> Array: ...
def gradient_matrices(information: Array, spacing_px: int) -> Array: ...
def inertial_motion(interval: Intervals, state: Array, cam_from_imu: Array) -> tuple[Array, Array]: ...
def inertial_rows(
    intervals: Intervals, cams: Array, velocities: Array, state: Array, cam_from_imu: Array
) -> tuple[Array, Array]: ...
def inside_area(area: Mask, at_px: Array) -> Mask: ...
def invert_triangle(lower: Array, scale: Array) -> Array: ...
def leaving_views(
    pinholes: Pinholes,
    state: WindowState,
    views: WindowViews,
    stereo: Mask,
    var_drift: Array,
    seen_later: Mask,
    known: Pixels,
    cov: Array,
) -> tuple[Ids, Mask, Array, Array, Array, NormalBlocks, Ids, tuple[Array, Array, Array, Array]]: ...
def linearise_views(views: Views, cam_from_ref: Array) -> tuple[Array, Array]: ...
def log_evidence(information: Array, weighted: Array, variances: Array) -> Array: ...
def match_along_rows(left: Image, right: Image, points_px: Pixels, first: int, last: int) -> tuple[Array, Mask]: ...
def match_new_points(
    left: Image,
    right: Image,
    stored: Image,
    templates: TemplateKind,
    right_sides: RightSides,
    corners_px: Pixels,
    slots: Pixels,
    disparity_px: Array,
    tolerance_px: float,
    std_grey: float,
    max_apart_px: float,
) -> tuple[Ids, Array, Array, Array, Array]: ...
def motion_of_flow(
    pinholes: Pinholes,
    tracks: Tracks,
    votes: Array,
    left_px: Array,
    found: Mask,
    cam_from_previous: Array,
    std_flow_px: float,
    gate: float,
    rules: ResectionRules,
) -> tuple[bool, Array, Mask, float]: ...
def new_corners(
    strength: Image, allowed: Mask, taken_px: Array, wanted: int, distance_px: float, min_strength: float
) -> Ids: ...
def normal_blocks(pinholes: Pinholes, state: WindowState, views: WindowViews, with_rig: bool) -> NormalBlocks: ...
def on_one_row(rows: Rows, left_px: Array, right_px: Array, row_speed_px_s: Array, scale: float) -> Mask: ...
def orthonormalise(poses: Array) -> Array: ...
def patch_changes(patches: Image) -> Grey: ...
def place_new_points(
    right_sides: RightSides,
    timing: Timing,
    z_px: Array,
    cov_px: Array,
    scale: float,
    least_sigmas: float,
    max_std_px: float,
) -> tuple[Ids, Array, Array, Array]: ...
def point_marginals(
    ref_from_anchor: Array,
    q: Array,
    own: CovariancePart,
    by_rig: CovariancePart,
    world_from_ref: Array,
    cam_from_ref: Array,
    known_sigmas: float,
) -> PointMarginals: ...
def point_motions(poses: Array, seconds: Array) -> Array: ...
def points_alone(
    v: Array, w: Array, g_point: Array, rig_point: Array, q: Array, rig_step: Array
) -> tuple[Array, Array, Array, Array]: ...
def points_of_views(state: WindowState, views: WindowViews) -> Array: ...
def points_seen_again(
    ids: Pixels, usable: Mask, var_drift: Array, known: Pixels, q: Array, cov_q: Array
) -> tuple[Ids, Array, Array]: ...
def polynomial_rows(exposed: ExposedRows, z_px: Array) -> Array: ...
def pose_adjoint(poses: Array) -> Array: ...
def pose_exp(xi: Array) -> Array: ...
def pose_inverse(poses: Array) -> Array: ...
def pose_log(poses: Array) -> Array: ...
def poses_by_parts(
    pinholes: Pinholes, state: WindowState, views: WindowViews, part: Pixels, parts: int
) -> tuple[Array, Array]: ...
def predict_tracks(
    pinholes: Pinholes,
    timing: Timing,
    twist: Array,
    tracks: Tracks,
    cam_from_previous: Array,
    cam_from_start: Array,
    left_px: Array,
    agree: Mask,
) -> tuple[Array, Array, Array, Array, Array]: ...
def preintegrate(
    seconds: Array, gyro: Array, accel: Array, widened: Array, biases: Array, densities: Array
) -> Preintegrated: ...
def project_points(pinholes: Pinholes, points: Array) -> Array: ...
def quaternions(rotations: Array) -> Array: ...
def reported_motions(
    axes: PhysicalAxes, poses: Array, cov: Array, by_terms: Array
) -> tuple[Array, Array, Array]: ...
def reported_points(
    axes: PhysicalAxes, points: Array, cov_points: Array, std_shared: Array, frame_from_cam: Array
) -> tuple[Array, Array]: ...
def resect(
    views: Views,
    cam_from_ref: Array,
    votes: Array,
    rules: ResectionRules,
    wanted: Wanted,
    predicted: Array | None | None,
) -> tuple[Fitted, Second | None]: ...
def rig_effects(
    pinholes: Pinholes, root: Array, field: Field, z_px: Array, age_s: Array
) -> tuple[Array, Array]: ...
def rig_mixture(
    mean: Array,
    cov: Array,
    size: Array,
    lenses: int,
    is_zero: Mask,
    log_prior: Array,
    counts: float,
    known_wrong: bool,
) -> Mixture: ...
def rotation_vectors(rotations: Array) -> Array: ...
def row_errors_of_tracks(
    known: Pixels, ages: Pixels, rows: Array, ids: Pixels, z_px: Array, cov_px: Array
) -> tuple[Ids, Array, Array]: ...
def row_terms(pinholes: Pinholes, field: Field, left_px: Array, row_speed_px_s: Array) -> Array: ...
def scaled_by_diagonal(matrix: Array) -> tuple[Array, Array]: ...
def seen_points(pinholes: Pinholes, z_px: Array) -> Array: ...
def shifts_by_timing(
    pinholes: Pinholes, exposed: ExposedRows, points: Array, twist: Array, mean: Array
) -> Array: ...
def store_patches(stored: Image, image: Image, points_px: Pixels, slots: Pixels) -> None: ...
def template_drift(points: Array, cam_from_previous: Array, scale: Pixels, slide: float) -> Array: ...
def templates_fit(warps: Array, radius: float, half: float) -> Mask: ...
def timed_views(
    pinholes: Pinholes,
    exposed: ExposedRows,
    points_in_cam: Array,
    motion: Array,
    timing: Array,
    z_px: Array | None | None,
) -> Array: ...
def times_among(ids: Pixels, others: Pixels, counted: Mask) -> Ids: ...
def timing_of_views(
    pinholes: Pinholes,
    exposed: ExposedRows,
    state: WindowState,
    views: WindowViews,
    expected_px: Array,
    motions: Array,
    timing: Array,
) -> Array: ...
def timing_unknowns(
    pinholes: Pinholes,
    exposed: ExposedRows,
    points_before: Array,
    twist_before: Array,
    points: Array,
    twist: Array,
    mean: Array,
    cov: Array,
    std_twist: Array,
) -> Array: ...
def track_covariances(
    cov_left_px: Array, var_rho: Array, drift_px: Array, focal_px: float, baseline_m: float
) -> Array: ...
def unfilter_png(filtered: Image, pixel: int) -> Bytes: ...
def union_of(ids: Pixels) -> Ids: ...
def unknown_errors(
    timing: Timing, rows: Rows, before: Array, now: Array, z_px: Array, twist: Array, std_twist: Array
) -> tuple[Array, Array]: ...
def update_depths(
    pinholes: Pinholes, tracks: Tracks, cam_from_previous: Array, z_px: Array, cov_px: Array, forgetting: float
) -> tuple[Array, Array, Array]: ...
def velocities(pinholes: Pinholes, points_in_cam: Array, twists: Array) -> Array: ...
def view_covariances(
    gradients: Array, error_left: Array, error_right: Array, shared_pixels: float, scale: float, factor: float
) -> Array: ...
def view_inflation(ages: Pixels, ratio_left: float, ratio_right: float, decay: float) -> Array: ...
def view_residuals(views: Views, root: Array, amplitudes: Array, cams_from_ref: Array) -> tuple[Array, Array]: ...
def views_within_gates(
    pinholes: Pinholes, state: WindowState, views: WindowViews, gate_of_one: float, gate_of_both: float
) -> Mask: ...
def warp_patches(
    stored: Image, slots: Pixels, anchor_from_now: Array, radius_px: int, spacing_px: int
) -> tuple[Grey, Array, Grey]: ...
def whiten_blocks(cov: Array, b: Array) -> Array: ...
def whitening_of_views(z_px: Array, cov_px: Array) -> Array: ...
def window_system(
    blocks: NormalBlocks, prior: Prior, known: Pixels, q: Array, amplitudes: Array
) -> tuple[Array, Array, Array, Array, Array, Array]: ...
