# The compiled core as Python calls it. Arrays of another type or order are copied; one of a wrong shape is a ValueError
# (TypeError: of a wrong number of axes). Images are (h, w) grey values; what lies beyond their border is as its rim.

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Grey = NDArray[np.float32]
Image = NDArray[np.float32] | NDArray[np.uint8]
Pixels = NDArray[np.integer]
Ids = NDArray[np.int64]
Mask = NDArray[np.bool_]
Pinholes = tuple[float, float, float, float, float]  # f, cx left and right, cy, px; baseline, metres
# A field over the image: nodes of its grid, columns (U,) and rows (V,), its length, px, and the root (K, K); K = U V.
Field = tuple[Array, Array, float, Array]
# What is known of rows: size of the image, field, amplitudes (7 + K,) of polynomial, delay and field with their
# covariance, the scatter of matches and the largest difference of rows, px.
Rows = tuple[tuple[float, float], Field, Array, Array, float, float]
# Where right sides are sought: the pair, its rows, a turn (3,) rad of the right camera, which is taken out of what is
# measured there, and the twist (6,) of the points, per second.
RightSides = tuple[Pinholes, Rows, Array, Array]
# In which rows of the cameras' own images views are: size of the rectified image, and coefficients (s, k, k) of one
# polynomial for both sides or of one for each.
ExposedRows = tuple[tuple[float, float], Array]
# Delay and readout, seconds: their rows, mean (2,) and covariance (2, 2), and the twist (6,) in the frame before.
Timing = tuple[ExposedRows, Array, Array, Array]
# A kind of templates: image pixels per pixel; half width, distance of samples, and how far from its start a patch may
# be found, in pixels of the template; the largest deviation of grey differences; pixels that share one noise value, and
# the variance factor of views.
TemplateKind = tuple[int, int, int, float, float, float, float]
# Templates of one kind: left and right image of their pixels (None: without right sides), stored patches as in
# `warp_patches`, and where in the left image (h, w) a whole patch shows the scene.
Templates = tuple[Image, Image | None, Image, Mask, TemplateKind]
# Axes of the physical camera: the rotation (3, 3) of points into them, and σ of errors that no view shows, of lengths
# as a share of themselves, and of the axes about x and y, radians.
PhysicalAxes = tuple[Array, float, float]
# Points with their views: homogeneous points (n, 4) with covariances (n, 4, 4), or (0, 4, 4) where they are exact,
# views (n, 4), NaN where a side is missing, with covariances (n, 4, 4), errors that all views share (n, 4, j), and
# gates (n,) of squared residuals.
Views = tuple[Pinholes, Array, Array, Array, Array, Array, Array]
# A motion (4, 4), its covariance (6, 6), accepted views (n,), and of these χ² and degrees of freedom; the spread of
# squared residuals; whether enough views agree and determine the motion; squared residuals (n,), share of the votes,
# amplitudes (j,) of shared errors and their covariance (j, j).
Fitted = tuple[Array, Array, Mask, float, int, float, bool, Array, float, Array, Array]
# A second motion (4, 4), its covariance (6, 6), the views (n,) that agree with it only, and their odds.
Second = tuple[Array, Array, Mask, float]
# Size of the image; share of the votes below which the global search is made; gates beyond which a view disagrees, how
# many that do make a second motion, and the share of the evidence from which it makes the first one ambiguous; whether
# most views agree with the start already, and whether no motion of other views is looked for.
ResectionRules = tuple[tuple[float, float], float, float, int, float, bool, bool]
# Homogeneous points (n, 4), and their twist (6,).
MovingPoints = tuple[Array, Array]
# A rig's errors: of which pair, its size, units of the terms per amplitude (t, t), and the field.
RigModel = tuple[Pinholes, tuple[float, float], Array, Field]
# Homogeneous points (n, 4) of tracks at unit depth, variances (n,) of 1/Z, covariances (n, 2, 2) px² of left positions,
# anchor cameras (n, 4, 4), velocities (n, 2) px/s on the left and slopes (n, 2) of 1/Z there, and image pixels (n,) per
# pixel of the template.
Tracks = tuple[Array, Array, Array, Array, Array, Array, Pixels]
# The state of a window: poses (F, 4, 4); of the points ids (P,), ascending, anchors (P, 4, 4) and q (P, 3); the rig's
# errors (m,).
WindowState = tuple[Array, Pixels, Array, Array, Array]
# Its views: frame (V,), ids (V,), used (V,), z_px (V, 4), weight (V, 4) and whitening roots (V, 4, 4). Errors of the
# rig move a view by terms (V, 4, t), of which those of delay and readout get timing (V, 4, 2) added, or (V, 4, 0), and
# by the parts of a field: moves (4, p) ⊗ field (V, K), m = t + p K.
WindowViews = tuple[Pixels, Pixels, Mask, Array, Array, Array, Array, Array, Array, Array]
# Points of a prior: known (N,), their rows among those of the window, mean (N, 3), D (N, 3, 3) and modes F (N, 3, k).
# The last m modes are those of the rig's errors: information (m, m) and weighted sums (m,) of their amplitudes.
PriorPoints = tuple[Pixels, Array, Array, Array, Array, Array]
# Points that enter it: ids (n,), mean (n, 3), covariances (n, 3, 3), and ∂q by the rig's errors (n, 3, m).
NewPoints = tuple[Ids, Array, Array, Array]

def match_along_rows(left: Image, right: Image, points_px: Pixels, first: int, last: int) -> tuple[Array, Mask]:
    """Whole-pixel disparities (n,) of pixels `points_px` (n, 2) of the left image, and where they are unique matches.

    Images of one pyramid level, of one size; disparities from `first` to `last`, pixels of that level.
    """

def unfilter_png(filtered: NDArray[np.uint8], pixel: int) -> NDArray[np.uint8]:
    """Bytes (h, w) of a PNG image with one or two a `pixel`, from rows (h, 1 + w) that begin with their filter.

    Raises ValueError for a filter that does not exist.
    """

def corner_strength(image: Image) -> Grey:
    """The smaller eigenvalue of the gradient matrix (Shi and Tomasi 1994) at every pixel (h, w); 255 is white."""

def new_corners(
    strength: Grey, allowed: Mask, taken_px: Array, wanted: int, distance_px: float, min_strength: float
) -> Ids:
    """Find up to `wanted` corners (k, 2) in whole pixels, `distance_px` from each other and from `taken_px` (m, 2).

    The image is cut into cells of about one wanted point each; a cell's corners are ranked, and all first ranks come
    before all second ranks. `strength` (h, w) of each pixel as a corner, and its least value `min_strength`, which is
    less in images without contrast; `allowed` (h, w).
    """

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
) -> tuple[Ids, Array, Array, Array, Array]:
    """Find corners of the left image, whole pixels (n, 2), in the right one, by disparities (n,), in templates' pixels.

    Their templates, in `slots` (n,) of `stored`, are aligned as if their surfaces faced the camera, within
    `tolerance_px` of the start; then with the slant that left and right patch clearly show, where `std_grey` is the
    deviation of one grey difference, with the pixels that share one noise value counted in; and their inner halves
    alone, as a patch across a depth edge follows the stronger side. Returns of those that fit: their slots (m,); in
    image pixels, views (m, 4) with covariances (m, 4, 4), eq. (15); slopes (m, 2) = (∂d/∂u, ∂d/∂v) of the disparity;
    and how far apart (m,) whole patch and inner half are matched, at most `max_apart_px` of the templates.
    """

def place_new_points(
    right_sides: RightSides,
    timing: Timing,
    z_px: Array,
    cov_px: Array,
    scale: float,
    least_sigmas: float,
    max_std_px: float,
) -> tuple[Ids, Array, Array, Array]:
    """Return which new views (n, 4) lie on their rows, in front of the cameras: their rows (k,) in the table.

    With covariances (n, 4, 4), by templates of that `scale`. An inverse depth is at least so many of its σ, and the σ
    of a left position at most `max_std_px`. Also returns the views (k, 4) without the rows' differences; and without
    the timing, their points (k, 4) and the variances (k,) of 1/Z.
    """

def among(ids: Ids, known: Ids) -> Mask:
    """Return which of `ids` (n,) are in `known`, which is ascending."""

def times_among(ids: Pixels, others: Pixels, counted: Mask) -> Ids:
    """Return how often each of `ids` (n,), which are ascending, is in those of `others` (m,) that are `counted`."""

def union_of(ids: Ids) -> Ids:
    """Return ids (n,), in any order, ascending and each once."""

def store_patches(stored: Image, image: Image, points_px: Pixels, slots: Pixels) -> None:
    """Cut patches around whole pixels (n, 2) into `stored` (slots, side, side), at `slots` (n,)."""

def warp_patches(
    stored: Image, slots: Pixels, anchor_from_now: Array, radius_px: int, spacing_px: int
) -> tuple[Grey, Array, Grey]:
    """Patches (n) of 2 `radius_px` + 1 pixels as today's image should show them, of those of `slots` (n,) in `stored`.

    Warps (n, 3, 2) of pixel offsets: W above h of δ = W u / (1 + h·u). Returns, of k × k samples `spacing_px` apart,
    the weighted pseudo-inverse (n, 3, k²) of their slopes along u and v and of their grey values, each of mean zero;
    the products (n, 3, 3) of these; and the mean grey value (n,).
    """

def align_patches(
    image: Image, starts_px: Array, inverse: Grey, information: Array, level: Grey, radius_px: int, spacing_px: int
) -> tuple[Array, Mask, Array]:
    """Find patches, as `warp_patches` returns them, in an image, from starts (n, 2).

    Returns positions (n, 2), whether each was found (n,), and the deviation (n,) of the grey differences that are left,
    in grey values of the template, inf where it was not found; eq. (15).
    """

def gradient_matrices(information: Array, spacing_px: int) -> Array:
    """Return gradient matrices (n, 2, 2), grey², eq. (14), of products (n, 3, 3) as `warp_patches` returns them."""

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
    wide: Templates | None,
) -> tuple[Mask, Ids, Array, Array, Array, Array, Array]:
    """Find tracks (n) with templates in `slots` (n,) in new images, where `predict_tracks` puts them.

    In the left image, and what is found there in the right one, in the row where it should be. Returns which should be
    in view (n,), and of those found at least on the left: their rows (k,), points (k, 4), views (k, 4), NaN where the
    right side was not found in its row, their covariances (k, 4, 4), eq. (15), views (k, 4) with right sides that miss
    their row, and what has been taken out of all these (k, 4) px, for the timing.
    """

def predict_tracks(
    pinholes: Pinholes,
    timing: Timing,
    twist: Array,
    tracks: Tracks,
    cam_from_previous: Array,
    cam_from_start: Array,
    left_px: Array,
    agree: Mask,
) -> tuple[Array, Array, Array, Array, Array]:
    """Return where a motion (4, 4) puts tracks (n), and how their patches look in the camera `cam_from_start` (4, 4).

    Points (n, 4), positions (n, 2) and right columns (n,) at which they start: those of `left_px` (n, 2) that `agree`
    (n,) with the motion, or where it puts them. And warps (n, 3, 2) of pixel offsets, now to anchor, for the left and
    for the right image. Around the anchor the surface is P(δ) = (x + δ₁, y + δ₂, 1, ρ + slopes·δ), and its image now is
    u = A δ / (1 + n·δ) with n the relative change of depth: exact for a plane. Inverted, δ = W u / (1 + h·u) with
    W = A⁻¹ and h = −Wᵀn; a warp is W above h. Points now move with a `twist` (6,): a shutter that reads out shears
    patches, eq. (14b).
    """

def update_depths(
    pinholes: Pinholes, tracks: Tracks, cam_from_previous: Array, z_px: Array, cov_px: Array, forgetting: float
) -> tuple[Array, Array, Array]:
    """Return points (n, 4) after a motion (4, 4), put where they were seen, and the variances (n,) of their 1/Z.

    Views (n, 4) with covariances (n, 4, 4). 1/Z by a scalar Kalman update where the right side is seen; its variance
    has grown by a factor before. Also returns the covariances (n, 2, 2) of the left sides.
    """

def templates_fit(warps: Array, radius: float, half: float) -> Mask:
    """Return which warps (n, 3, 2) keep a window inside a stored patch, and show no detail that the patch lacks.

    Half widths of the window and of the patch, in pixels of the template.
    """

def inside_area(area: Mask, at_px: Array) -> Mask:
    """Return which positions (n, 2) lie in an area (h, w); those that are not finite do not."""

def view_covariances(
    gradients: Array, error_left: Array, error_right: Array, shared_pixels: float, scale: float, factor: float
) -> Array:
    """Return the covariances (n, 4, 4) px² of views, eq. (15), times a `factor`.

    Gradient matrices (n, 2, 2) of templates, and deviations (n,) of grey differences on either side, inf where it was
    not found. `shared_pixels` have one noise value; a template's pixel is `scale` image pixels wide.
    """

def row_errors_of_tracks(
    known: Ids, ages: Ids, rows: Array, ids: Ids, z_px: Array, cov_px: Array, counts: bool
) -> tuple[Ids, Array, Array]:
    """Return ages (n,) of tracks in views, at most 59, and their row differences (n, k), the latest first, eq. (68).

    Tracks `ids` (n,) with views (n, 4) and covariances (n, 4, 4); those of the frame before, `known` (m,), with ages
    and row differences (m, k). All ids ascend; `counts`: whether this frame adds to the ages. Differences are in
    standard deviations, at most 3, without what a whole frame shares, and NaN without a right side. Also returns sums
    (6,): of squares of the differences of two successive frames, half of both, of their products, and of how many; and
    of tracks that were seen k frames ago, too: of these products, of the products of the differences now and then, and
    of how many.
    """

def view_inflation(ages: Ids, ratio_left: float, ratio_right: float, decay: float) -> Array:
    """Return by how much (n, 2) the variances of views of tracks with these ages (n,) are to be multiplied, eq. (69).

    For an estimator that adds up the views of a track as if they were independent: then each says as much as it adds.
    In units of the white part of its errors, the lasting part of either side has a `ratio`, and its `decay` per view.
    """

def template_drift(points: Array, cam_from_previous: Array, scale: Pixels, radius: float) -> Array:
    """Return σ (n,) px of how far templates of homogeneous points (n, 4) slid during a motion (4, 4), eq. (17).

    `radius`: half their width, in pixels of the templates, of which each has `scale` (n,) of the image.
    """

def seen_points(pinholes: Pinholes, z_px: Array) -> Array:
    """Return points (n, 4) = (X/Z, Y/Z, 1, 1/Z) where views (n, 4) have seen them: by left ray and disparity."""

def project_points(pinholes: Pinholes, points: Array) -> Array:
    """Return the views (n, 4) of homogeneous points (n, 4), eq. (8)."""

def linearise_views(views: Views, cam_from_ref: Array) -> tuple[Array, Array]:
    """Return roots (n, 4, 4) that whiten the views of points, and the whitened Jacobian (n, 4, 6 + j).

    Under a motion (4, 4). The Jacobian is that of a left perturbation and of the amplitudes of what is shared. Where
    the motion leaves nothing predicted, root and Jacobian are zero. Raises LinAlgError where a covariance is not
    definite.
    """

def view_residuals(views: Views, root: Array, amplitudes: Array, cams_from_ref: Array) -> tuple[Array, Array]:
    """Return whitened residuals (m, n, 4) under motions (m, 4, 4), and their squared norms (m, n).

    Amplitudes (j,) of shared errors. Squares are inf of points behind the camera, and of those that
    predicted nothing where `root` was linearised.
    """

def fit_motion(views: Views, cam_from_ref: Array, amplitudes: Array, votes: Array, anneal: bool) -> Fitted:
    """Return the motion of the views that agree with one near it, eqs. (22) and (23).

    Start: motion (4, 4) and amplitudes (j,). `anneal`: with Cauchy weights first. `votes` (n,): how much each view
    counts in the share. Raises LinAlgError as `linearise_views`.
    """

def resect(
    views: Views, cam_from_ref: Array, votes: Array, rules: ResectionRules, predicted: Array | None
) -> tuple[Fitted, Second | None]:
    """Return the motion of the views, whatever the start (4, 4), and what others agree on, eqs. (20) to (23).

    With `votes` (n,). Where too few agree with what a start led to, the whole space of motions is searched, for the one
    with the largest support: each view gives its vote, less the share of the gate that its squared residual uses up;
    the extent that the agreeing views have in the image adds a little. Samples depend on the number of views only.
    With a predicted motion (4, 4) it is that of one rigid scene: where halves of the views disagree, near and far, left
    and right or upper and lower ones, the motion is sought again from theirs and from the predicted one.
    """

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
) -> tuple[bool, Array, Mask, float]:
    """Return the motion (4, 4) of tracks by left positions (n, 2), known to σ, that flow has `found` (n,), eq. (20).

    σ in pixels of the templates. Returns whether there is one, the motion, which tracks agree (n,), and their share of
    the `votes` (n,) of what was found. Start (4, 4); `gate` of squared residuals.
    """

def effects_of_turn(pinholes: Pinholes, right_px: Array) -> Array:
    """Return what a turn of the right camera does at positions (n, 2) in its image: (n, 2, 3) px per radian."""

def fit_turn(
    views: Views, cam_from_ref: Array, usual: Array, std_knock_rad: float
) -> tuple[Array, Mask, float, float]:
    """Return the turn of the right camera (3,) rad that views show, and which (n,) agree, eq. (72d).

    By a few steps of reweighting, together with the motion (4, 4). And by how much likelier it is a knock of σ
    `std_knock_rad` than a `usual` one, of covariance (3, 3): a logarithm, eq. (72f); and χ² of the latter. The views
    have no shared errors.
    """

def rig_effects(model: RigModel, z_px: Array, age_s: Array) -> tuple[Array, Array]:
    """Return what amplitudes of 1 do to views (n, 4): of the terms (n, 4, t), and the field's basis (n, K), eq. (70).

    Of cameras that stand still; `age_s` (n,) or (1,): for how long errors have grown, eq. (72d). A missing side has no
    terms.
    """

def field_basis(field: Field, left_px: Array) -> Array:
    """Return exp(−d²/(2ℓ²)) between positions (n, 2) and a grid's nodes, times its root: (n, K).

    ℓ is the field's length. 0 where a position is not finite.
    """

def rig_mixture(
    mean: Array,
    cov: Array,
    size: Array,
    lenses: int,
    is_zero: Mask,
    log_prior: Array,
    counts: float,
    known_wrong: bool,
) -> tuple[Array, Array, float]:
    """Return mean (m,) and covariance (m, m) of a rig's errors as a mixture, and the probability that lenses are wrong.

    N(`mean` (m,), `cov` (m, m)) by all views, with the sizes (m,) so far. The first `lenses` terms are of lenses; the
    next n may be 0 in the combinations `is_zero` (c, n) of log probability `log_prior` (c,), for which the share
    `counts` of their information counts; the others are of a field, which goes with the lenses. `known_wrong`: lenses
    have errors. Raises LinAlgError where the arguments are not finite.
    """

def point_motions(poses: Array, seconds: Array) -> Array:
    """Return how points move in each of a few cameras: twists ξ̇ and their change ξ̈ per second (n, 2, 6).

    A point X at the time of a pose is Exp(t ξ̇ + ½ t² ξ̈) X after t seconds. Poses (n, 4, 4), camera from reference, at
    ascending `seconds` (n,); from polynomials through the poses of the frames around each. Zero for a single one.
    """

def velocities(pinholes: Pinholes, points_in_cam: Array, twists: Array) -> Array:
    """Return how views of homogeneous points (n, 4) move (n, 4), px/s, with `twists` (n, 6), or (1, 6) for all."""

def timed_views(
    pinholes: Pinholes, exposed: ExposedRows, points_in_cam: Array, motion: Array, timing: Array, z_px: Array | None
) -> Array:
    """Return what delay and readout do to views of homogeneous points (n, 4): (n, 4, 2) px/s, eqs. (70a) and (70c).

    `motion` (2, 6) of the points, as of `point_motions`; `timing` (2,) s: delay and readout for which the result is
    exact to second order. `z_px` (n, 4): at places whose rows count, where the points are projected if there are none;
    to a side with NaN nothing is done.
    """

def shifts_by_timing(pinholes: Pinholes, exposed: ExposedRows, points: Array, twist: Array, mean: Array) -> Array:
    """Return by how much (n, 4) px delay and readout, seconds (2,), shift views of homogeneous points (n, 4)."""

def timing_unknowns(
    pinholes: Pinholes,
    exposed: ExposedRows,
    before: MovingPoints,
    now: MovingPoints,
    mean: Array,
    cov: Array,
    std_twist: Array,
) -> Array:
    """Return errors (n, 4, j) px, of σ = 1, of changes of views by delay and readout, N(`mean` (2,), `cov` (2, 2)), s.

    A constant delay or readout shows where the velocity has changed; and what either of them does shows where the
    velocity is not known, by `std_twist` (6,). Principal components, without those that do not matter beside the noise
    of a good view. Raises LinAlgError where `cov` is not definite.
    """

def unknown_errors(
    pinholes: Pinholes,
    timing: Timing,
    rows: Rows,
    before: Array,
    now: Array,
    z_px: Array,
    twist: Array,
    std_twist: Array,
) -> tuple[Array, Array]:
    """Return errors of views (n, 4) that are unknown: (n, 4, j) px of σ = 1.

    Those of `timing_unknowns`, of homogeneous points (n, 4) in the frame before and now, which move with `twist` (6,);
    and those of the rows of right sides. Also returns the covariance (3, 3) of the turn of the right camera that rows
    and delay feign. Raises LinAlgError where a covariance is not definite.
    """

def cov_of_timed_pose(
    pinholes: Pinholes, exposed: ExposedRows, points_in_cam: Array, size: Array, cov_twist: Array
) -> Array:
    """Return the covariance (6, 6) of a pose, seen by homogeneous points (n, 4), by a twist with (6, 6), eq. (70b).

    By a delay and by a readout of `size` (2,), s.
    """

def reported_motions(axes: PhysicalAxes, poses: Array, cov: Array, by_terms: Array) -> tuple[Array, Array, Array]:
    """Return poses (n, 4, 4) in axes of the physical camera, with covariances (n, 6, 6) and what common errors do.

    `cov` (n, 6, 6) of the perturbations on their right gets that of errors that no view shows. Their perturbations, and
    those of further errors, of which they are `by_terms` (n, 6, t): (n, 6, 3 + t). Eqs. (7) and (73a).
    """

def reported_points(
    axes: PhysicalAxes, points: Array, cov_points: Array, std_shared: Array, frame_from_cam: Array
) -> tuple[Array, Array]:
    """Return points (n, 3) in axes of the physical camera, with covariances (n, 3, 3), eqs. (18) and (73).

    They were seen from a camera (4, 4) in their frame; σ of their inverse depths (n,), 1/m, by an error that all views
    of a point share. `cov_points` (n, 3, 3) gets that of errors that no view shows.
    """

def track_covariances(
    cov_left_px: Array, var_rho: Array, drift_px: Array, focal_px: float, baseline_m: float
) -> Array:
    """Return the covariances (n, 4, 4) of points (X/Z, Y/Z, 1, 1/Z), after a drift of σ (n,) px; none if (0,)."""

def whitening_of_views(z_px: Array, cov_px: Array) -> Array:
    """Return R (n, 4, 4) with RᵀR the information of views (n, 4) with (n, 4, 4), eq. (11).

    A side that is not finite has none. Raises LinAlgError for a covariance that is not definite.
    """

def gates_of_views(z_px: Array, of_one_side: float, of_both: float) -> Array:
    """Return the gate (n,) of each view (n, 4)."""

def log_evidence(information: Array, weighted: Array, variances: Array) -> Array:
    """Return by how much likelier errors are N(0, variance) than 0, as logarithms (s, n), eq. (72a).

    Of n independent ones, from the information that views have about each and their sum weighted by it.
    """

def points_of_views(state: WindowState, views: WindowViews) -> Array:
    """Return homogeneous points (u, 4) of the used views of a window, each in its own camera and in front of it.

    Views of points that the state does not have are left out, here and in what follows.
    """

def expected_views(
    pinholes: Pinholes, state: WindowState, views: WindowViews, stereo: Mask, expected_px: Array
) -> Array:
    """Return views (V, 4) where the used ones are expected, with the rig's errors; the others as they are given.

    NaN for sides that were not seen, those on the right without `stereo`.
    """

def timing_of_views(
    pinholes: Pinholes,
    exposed: ExposedRows,
    state: WindowState,
    views: WindowViews,
    expected_px: Array,
    motions: Array,
    timing: Array,
) -> Array:
    """Return the `timed_views` (V, 4, 2) of the used ones, expected at (V, 4), with `motions` (F, 2, 6) of frames."""

def q_by_reference(ref_from_anchor: Array, q: Array) -> Array:
    """Return ∂q/∂ξ (n, 3, 6) where points P in the reference camera become Exp(ξ)·P and their anchors stay, eq. (31).

    q (n, 3) in anchors (n, 4, 4).
    """

def points_seen_again(
    ids: Pixels, usable: Mask, var_drift: Array, known: Pixels, q: Array, cov_q: Array
) -> tuple[Ids, Array, Array]:
    """Return which views (v,) are usable and of points that are known, and these points as they are by now.

    Views of `ids` (v,) with variances (v, 3) of q by drift; `known` (n,) ids with q (n, 3) and covariances (n, 3, 3),
    both ascending. Returns rows (k,), homogeneous points (k, 4), and their covariances (k, 4, 4), drift included.
    """

def drift_covariances(ids: Pixels, ref_from_anchor: Array, q: Array, seen: Pixels, var_drift: Array) -> Array:
    """Return covariances (n, 3, 3) of q by a drift in the reference camera, eq. (33); 0 of points that are not seen.

    Points `ids` (n,) with q (n, 3) in anchors (n, 4, 4); variances (v, 3) of q in the camera of those `seen` (v,). Both
    sets of ids are ascending.
    """

def views_within_gates(
    pinholes: Pinholes, state: WindowState, views: WindowViews, gate_of_one: float, gate_of_both: float
) -> Mask:
    """Return which views (V,) are used and agree with the state, each by its own covariance, as `weight` has it.

    Gates of squared residuals of views from one side, and from both.
    """

def normal_blocks(pinholes: Pinholes, state: WindowState, views: WindowViews) -> tuple[Array, ...]:
    """Return the Gauss-Newton normal equations of views, eqs. (25), (26) and (71): the arrays of `NormalBlocks`."""

def row_terms(size: tuple[float, float], field: Field, left_px: Array, row_speed_px_s: Array) -> Array:
    """Return what amplitudes of 1 do to v_left − v_right (n, 7 + K) of views at (n, 2), eq. (19).

    A polynomial of second order, and a delay, of views that move across the rows by (n,), or all by (1,), px/s; then
    the field.
    """

def row_offsets(rows: Rows, left_px: Array, row_speed_px_s: Array) -> Array:
    """Return v_left − v_right (n,) of correct matches at left positions (n, 2), px; speeds as in `row_terms`."""

def on_one_row(rows: Rows, left_px: Array, right_px: Array, row_speed_px_s: Array, scale: float) -> Mask:
    """Return whether left and right positions (n, 2), the right ones corrected by `row_offsets`, lie on one row.

    Speeds as in `row_terms`. The gate is `scale` times as wide.
    """

def polynomial_rows(exposed: ExposedRows, z_px: Array) -> Array:
    """Return Σ c x^a y^b (n, 4) at both sides of views (n, 4), x and y from −1 to 1 over the image."""

def pose_exp(xi: Array) -> Array:
    """Return the poses (n, 4, 4) Exp(ξ) of tangents (n, 6), eq. (3)."""

def pose_log(poses: Array) -> Array:
    """Return the tangents (n, 6) of poses (n, 4, 4); the inverse of `pose_exp`."""

def pose_inverse(poses: Array) -> Array:
    """Return the inverses of poses (n, 4, 4)."""

def pose_adjoint(poses: Array) -> Array:
    """Return Ad(T) (n, 6, 6) of poses (n, 4, 4), eq. (4)."""

def rotation_vectors(rotations: Array) -> Array:
    """Return rotation vectors (n, 3) of norm ≤ π of rotation matrices (n, 3, 3)."""

def quaternions(rotations: Array) -> Array:
    """Return unit quaternions (n, 4) = (x, y, z, w), w ≥ 0, of rotation matrices (n, 3, 3)."""

def orthonormalise(poses: Array) -> Array:
    """Return poses (n, 4, 4) with their rotations, which nearly are such, projected onto SO(3)."""

def whiten_blocks(cov: Array, b: Array) -> Array:
    """Return L⁻¹ B (n, 3, k) of L Lᵀ = `cov` (n, 3, 3), lower triangles. Raises LinAlgError if one is not definite."""

def invert_triangle(lower: Array, scale: Array) -> Array:
    """Return the inverse (n, n) of a lower triangle, its columns multiplied by `scale` (n,)."""

def scaled_by_diagonal(matrix: Array) -> tuple[Array, Array]:
    """Return S A S (n, n) with a diagonal of ones, and that of S (n,), which is 1 where A's is not positive."""

def eliminate_points(v: Array, w: Array) -> tuple[Array, Array]:
    """Eliminate points from normal equations, eq. (27): V (P, 3, 3), and W (P, 3, n) with the others.

    Returns lower roots L (P, 3, 3) of V⁻¹ = L Lᵀ, and LᵀW. Raises LinAlgError where information is not definite.
    """

def window_system(
    blocks: tuple[Array, ...], prior: PriorPoints, q: Array, amplitudes: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Eliminate points from the normal equations of [poses 6F | modes k], eqs. (27), (30) and (71).

    `blocks`: the arrays of `NormalBlocks`, at q (P, 3), of a prior at `amplitudes` (k,).
    Returns H (n, n), its lower triangle, without the points; L⁻¹F (N, 3, k) with D = L Lᵀ, whose products with itself
    are to be added; lower roots (P, 3, 3) of the covariances of points given the others; rootsᵀ times what couples
    points to these (P, 3, n), whose products are to be subtracted; rootsᵀ times the right-hand sides of points (P, 3);
    and that of the others (n,). Raises LinAlgError where information is not definite.
    """

def points_alone(
    v: Array, g_point: Array, rig_point: Array, q: Array, rig_step: Array
) -> tuple[Array, Array, Array]:
    """Return points by their views alone: mean (n, 3), covariance (n, 3, 3), and ∂q by the rig's errors (n, 3, m).

    Blocks as in `NormalBlocks`, at q (n, 3); the mean is that with errors of the rig that are off by (m,) from there.
    Raises LinAlgError where the views do not determine a point.
    """

def leaving_views(
    pinholes: Pinholes,
    state: WindowState,
    views: WindowViews,
    stereo: Mask,
    var_drift: Array,
    seen_later: Mask,
    known: Pixels,
    cov: Array,
) -> tuple[Ids, Mask, Array, Array, Array, tuple[Array, ...], Ids, tuple[Array, Array, Array]]:
    """Return what the views of the oldest frame, which is the reference camera now, say about points of a map (P,).

    Views (V,), `stereo` where both sides were seen, with variances (V, 3) of q by drift; points that are `seen_later`
    (P,). The prior: `known` (N,), the rows of its points, with D (N, 3, 3). Returns rows (n,) of the points of the
    prior that are seen by the frame or later, and of these which (n,) later; D (n, 3, 3) with their drift, anchors
    (n, 4, 4) and q (n, 3); the arrays of `NormalBlocks` by their views; and ids of the other points that the frame
    sees in stereo and that are seen later, with these `points_alone`.
    """

def absorbing_system(
    blocks: tuple[Array, ...], prior: PriorPoints, ref_from_anchor: Array, q: Array, amplitudes: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return the `window_system` (k + 6 modes) of one frame that is the new reference, eqs. (31) to (35).

    Six modes of its pose, about which nothing is known, come before those of the rig's errors. Points q (n, 3), all of
    them of the prior, in anchors (n, 4, 4) as the frame has them.
    """

def absorbed_points(
    ids: Pixels, std_given: Array, moved: Array, given: Array, q: Array, stays: Mask, new: NewPoints
) -> tuple[Ids, Array, Array, Array]:
    """Return the points of the prior after a frame, ids ascending: with mean (N, 3), D (N, 3, 3) and modes (N, 3, k).

    Those that stay (n,), linearised at q (n, 3): roots (n, 3, 3) of their covariances given the modes, in units of
    these their steps (n, 3) and what the new modes and their step take from them (n, 3, k + 1); and the new ones.
    """

def point_marginals(
    ref_from_anchor: Array,
    q: Array,
    std_given: Array,
    own: tuple[Array, Array, Array, Array],
    by_rig: tuple[Array, Array, Array, Array],
    world_from_ref: Array,
    cam_from_ref: Array,
    known_sigmas: float,
) -> tuple[Array, Array, Array, Array, Array, Array, Mask]:
    """Return points in the newest camera and in the world, each with covariances, eqs. (28) and (37) to (41).

    Points: anchors (P, 4, 4), q (P, 3), and roots (P, 3, 3) of their covariances given all else. Parts of the joint
    covariance as in `CovariancePart`, given the rig's errors and by them; poses (4, 4). Returns q in the camera (P, 3),
    its covariance (P, 3, 3) given the rig's errors; metric points in the camera (P, 3) and in the world, each with
    covariances (P, 3, 3); and which (P,) are finite: 1/Z is so many standard deviations away from 0.
    """

# Intervals (n) between frames: rotations (n, 3, 3), velocity and position (n, 6), Jacobians by biases (n, 9, 6) and by
# the clock (n, 9), covariances (n, 9, 9), and at which biases (n, 6) and clock offsets (n,) they were integrated, over
# how many seconds (n,).
Intervals = tuple[Array, Array, Array, Array, Array, Array, Array, Array]

def preintegrate(
    seconds: Array, gyro: Array, accel: Array, widened: Array, biases: Array, densities: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return the motion of an inertial unit between two times, eqs. (78) and (79), in its axes at the first one.

    Samples (n, 3), rad/s and m/s², at ascending times (n,), of which the first and the last bound the interval;
    `widened` (n − 1,): factors on the variance of each step; biases (6,) of gyroscope and accelerometer, and their
    noise densities (2,). Returns the rotation (3, 3), velocity and position (2, 3) without gravity, their Jacobians
    (9, 6) by the biases and (3, 3) by the time of both ends, and their covariances (9, 9) by either sensor, of
    (rotation on the right, velocity, position).
    """

def inertial_rows(
    intervals: Intervals, cams: Array, velocities: Array, state: Array, cam_from_imu: Array
) -> tuple[Array, Array]:
    """Return whitened residuals (9n,) of intervals in a row and their Jacobian (9n, 9n + 17), eq. (80).

    Cameras (n + 1, 4, 4), the first of which is the reference, with velocities (n + 1, 3) in their own axes; the state
    (17,) of the reference. Columns: poses 6n, perturbed on the left, the state, velocities 3n. The reference is fixed,
    and its velocity is that of the state. Raises LinAlgError where a covariance is not definite.
    """

def inertial_motion(interval: Intervals, state: Array, cam_from_imu: Array) -> tuple[Array, Array]:
    """Return previous_from_now (4, 4) and the state (17,) at the end of one interval, by samples alone, eq. (81)."""
