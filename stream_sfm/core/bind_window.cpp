// Python's view of window.hpp.

#include "binding.hpp"
#include "rig_records.hpp"
#include "window.hpp"

namespace binding {

void bind_window(nb::module_& m) {
    describe_taken<WindowState>(m);
    describe_taken<WindowViews>(m, R"(The views of a window: frame (V,), ids (V,), used (V,), z_px (V, 4), weight (V, 4) and whitening roots (V, 4, 4). The
frame's own amplitudes of σ = 1 shift a view by own (V, 4, e). Errors of the rig shift it by terms (V, 4, t), where
timing (V, 4, 2), or (V, 4, 0), is added to those of delay and readout, and by the parts of a field: moves (4, p) ⊗
field (V, K), m = t + p K.)");
    describe_taken<RigState>(m);
    describe_taken<PriorViews>(m);
    describe_returned<NormalBlocks>(m, R"(The normal equations of all views, eq. (26): blocks of the frames, of the points, and between them.

A frame has f = 6 + e unknowns: its pose, and e amplitudes of its own with a prior of σ = 1. `u` (F, f, f), `v` (P, 3,
3), `w` (P, 3, fF); right-hand sides `g_pose` (F, f), `g_point` (P, 3). For the rig's errors: `rig` (m, m), `rig_pose`
(F, f, m) with the frames, `rig_point` (P, 3, m) with the points, and `g_rig` (m,).)");
    describe_returned<SolvedWindow>(m, R"(The factored normal equations of [poses 6F | frames' own e F | modes], without the points (P,) and the rig's errors (m,).

`root` (n, n), upper triangular, is a root of the covariance of these variables given the rig's errors, and `by_rig` (n,
m) their Jacobian by these, K of eq. (72). `std_given` (P, 3, 3): root of the covariance of a point given all others; in
units of it, `reach` (P, 3, n + m): coupling to the other variables and to the rig's errors. Of these errors: mean (m,),
covariance and information (m, m) from all views; m is 0 if they are not among the unknowns.)");
    describe_returned<MovedWindow>(m, R"(The variables of a window after a `step` (6F + e F + k,): poses (F, 4, 4), the frames' own amplitudes (F, e), points q (P,
3) and amplitudes (k,) of the prior's modes, the rig's errors among them.)");
    describe_taken<SystemViews>(m);
    describe_returned<AbsorbedFrame>(m, R"(Points of a prior (N,): ascending ids, mean (N, 3), D (N, 3, 3) and modes (N, 3, k); the modes of world and inertial state
(r, k) with their step (r,); and information (m, m) and weighted sums (m,) about the rig's errors.)");
    describe_returned<WindowMarginals>(m, R"(The newest pose (4, 4) with its covariance, and points (P,): q in the camera (P, 3), its covariance (P, 3, 3) given the
rig's errors; metric points in the camera (P, 3) and in the world, each with covariances (P, 3, 3); and whether each is
finite: 1/Z differs from 0 by more than `known_sigmas` σ.)");
    def<&points_of_views>(m, "points_of_views", R"(Return homogeneous points (u, 4) of the used views of a window, each in its own camera and in front of it.

Views of points that are not in the state are ignored, here and in the following functions.)",
        "state"_a, "views"_a);
    def<&expected_views>(m, "expected_views", R"(Return views (V, 4): the expected ones with the rig's errors where used, the others as given.

Sides that were not seen, the right ones without `stereo`, are NaN.)",
        "pinholes"_a, "state"_a, "views"_a, "stereo"_a, "expected_px"_a);
    def<&timing_of_views>(m, "timing_of_views", R"(Return `timed_views` (V, 4, 2) for the used views, expected at (V, 4), with `motions` (F, 2, 6) of frames.)",
        "pinholes"_a, "exposed"_a, "state"_a, "views"_a, "expected_px"_a, "motions"_a, "timing"_a);
    def<&points_seen_again>(m, "points_seen_again", R"(Return the rows of views of known points, and these points with their drift.

Views have `ids` (v,) and variances (v, 3) of q by drift; `known` (n,) ids with q (n, 3) and covariances (n, 3, 3). Both
ids are ascending. Returns rows (k,), homogeneous points (k, 4), and their covariances (k, 4, 4), drift included.)",
        "ids"_a, "var_drift"_a, "known"_a, "q"_a, "cov_q"_a);
    def<&drift_covariances>(m, "_drift_covariances", R"(Return covariances (n, 3, 3) of q by drift in the reference camera, eq. (33); 0 for points that are not seen.

Points `ids` (n,) with q (n, 3) in anchors (n, 4, 4); variances (v, 3) of q in the camera for the ids `seen` (v,). Both
ids are ascending.)",
        "ids"_a, "ref_from_anchor"_a, "q"_a, "seen"_a, "var_drift"_a);
    def<&slides_of_views>(m, "_slides_of_views", R"(Return the variance (V,), px² a coordinate, of the slide of each view's patch since the middle of its track.

Views have `ids`, sorted by frame, and variances (V, 3) of q by drift; those of other tracks than `points`, ascending, are
0. A point does not move within the window, so it lies in the middle of where its patch has been. A view differs from the
one in the middle of its track by the slides between both, which add up as a random walk, eq. (26a).)",
        "points"_a, "ids"_a, "var_drift"_a, "f_px"_a);
    def<&views_within_gates>(m, "views_within_gates", R"(Return which views (V,) are used and agree with the state, each by its own covariance, which `weight` restores.

`var_drift` (V, 3): variances of q by drift; the slides of a view's patch are contained in this covariance, eq. (26a).
The gates are on the squared residuals of views with one side and with both.)",
        "pinholes"_a, "state"_a, "views"_a, "var_drift"_a, "gate_of_one"_a, "gate_of_both"_a);
    def<&squares_of_tracks>(m, "squares_of_tracks", R"(Return the sums (P,) of squared residuals of the views of each point, by their own covariances, and the numbers of
values.)",
        "pinholes"_a, "state"_a, "views"_a);
    def<&determined_points>(m, "determined_points", R"(Return which points `ids` (P,) are determined by the prior, which contains `known`, or by a used stereo view.

Views (V,) have ids `seen`, are `used` or not, and `stereo` or not. A point with one view counts while its track lives:
the views of the newest frame begin at row `newest`. Ids of points, and of views of a frame, are ascending.)",
        "ids"_a, "known"_a, "seen"_a, "used"_a, "stereo"_a, "newest"_a);
    def<&normal_blocks>(m, "normal_blocks", R"(Return the Gauss-Newton normal equations of views, eqs. (25), (26) and (71).

`with_rig`: whether the rig's errors are among the unknowns.)",
        "pinholes"_a, "state"_a, "views"_a, "with_rig"_a);
    def<&poses_by_parts>(m, "poses_by_parts", R"(Return information (parts, 6F, 6F) and right-hand sides (parts, 6F) of poses by `parts` of the points, given all else.

`part` (P,): the part of each point. Points are eliminated, eq. (27), with `reach` (P, 3, n), poses first, and `given`
(P, 3), as `window_system` returns them.)",
        "pinholes"_a, "state"_a, "views"_a, "reach"_a, "given"_a, "part"_a, "parts"_a);
    def<&eliminate_points>(m, "eliminate_points", R"(Eliminate points from normal equations, eq. (27): V (P, 3, 3), and W (P, 3, n) with the others.

Returns lower roots L (P, 3, 3) of V⁻¹ = L Lᵀ, and LᵀW. Raises LinAlgError if the information is not definite.)",
        "v"_a, "w"_a);
    def<&window_step>(m, "window_step", R"(Return a step of all variables of a window: the factored normal equations, the variables after it, and gᵀδ.

Eqs. (26), (27), (30) and (71), at the `amplitudes` (k,) of the prior's modes. `with_rig`: whether the rig's errors are
among the unknowns; they move to where they are held, and stay otherwise. `about_state` (6F + 17, …) and
`weighted_state`: information about poses and inertial state, (0, 0) without. The last result is the predicted decrease
of the sum of squares. Raises LinAlgError if the information is not definite.)",
        "pinholes"_a, "state"_a, "views"_a, "prior"_a, "amplitudes"_a, "with_rig"_a, "about_state"_a, "weighted_state"_a);
    def<&window_with_rig_moved>(m, "window_with_rig_moved", R"(Return the variables of a window after its rig's errors have moved by `change` (m,), and all others with them, eq. (72).)",
        "state"_a, "amplitudes"_a, "solved"_a, "change"_a);
    def<&points_alone>(m, "points_alone", R"(Return points from the views of one frame alone: mean (n, 3), covariance (n, 3, 3), and Jacobians.

The Jacobians are ∂q by amplitudes of the frame's own (n, 3, e) and by the rig's errors (n, 3, m). Blocks are as in
`NormalBlocks`, at q (n, 3); the mean is for errors of the rig changed by `rig_step` (m,). Raises LinAlgError if the
views do not determine a point.)",
        "v"_a, "w"_a, "g_point"_a, "rig_point"_a, "q"_a, "rig_step"_a);
    def<&absorb_frame>(m, "absorb_frame", R"(Return what the prior knows after the views of the oldest frame of a window, the new reference, eqs. (31) to (36a).

Points of a map (P,) seen from that frame; its views (V,), `stereo` if both sides were seen, with variances (V, 3) of q by
drift; `seen_later` (P,): points that later frames see. `world_modes` (r, s): modes of the world and of an inertial state
in that camera, by [the frame's own e | modes before | pose 6 | others with prior information | rig m]; `about` (s, s)
and `weighted` (s,): further information, (0, 0) without. A mode is left out if it adds less than the share `negligible`
of the variance by the points' own noise. Raises LinAlgError if the information is not definite.)",
        "pinholes"_a, "state"_a, "views"_a, "stereo"_a, "var_drift"_a, "seen_later"_a, "prior"_a, "amplitudes"_a, "world_modes"_a,
        "about"_a, "weighted"_a, "negligible"_a);
    def<&truncate_modes>(m, "_truncate_modes", R"(Return D (n, 3, 3), modes (n, 3, k) of points and of the world (r, k) without negligible ones, eqs. (36) and (36a).

r modes represent the world exactly, and the last `of_rig` stay.)",
        "cov"_a, "modes"_a, "world_modes"_a, "of_rig"_a, "negligible"_a);
    def<&whiten_blocks>(m, "_whiten_blocks", R"(Return L⁻¹ B (n, 3, k) of L Lᵀ = `cov` (n, 3, 3), lower triangles. Raises LinAlgError if one is not definite.)",
        "cov"_a, "b"_a);
    def<&reflections>(m, "_reflections", R"(Return W and V (n, r) of the rotation Q = I - W Vᵀ whose first r columns span the `columns` (n, r), r ≤ n.)",
        "columns"_a);
    def<&minor_directions>(m, "_minor_directions", R"(Return directions (n, r) along which variables with a `covariance` (n, n) hardly vary; they are not orthonormal.

Of r variables what the n - r others do not explain, which is of a variance below `least`. The others are chosen one
by one, always the one that is explained least so far.)",
        "covariance"_a, "least"_a);
    def<&newest_pose_covariance>(m, "newest_pose_covariance", R"(Return the covariance (6, 6) of the newest pose in the world, eq. (28); perturbations are on its right.)",
        "state"_a, "system"_a);
    def<&window_marginals>(m, "window_marginals", R"(Return the newest pose, and the points in this camera and in the world, each with covariances, eqs. (28) and (37) to (41).

`world_from_ref` (4, 4); `cov_more` (6, 6): added to the pose, and to the points seen from it. A point is finite if 1/Z
exceeds `known_sigmas` σ.)",
        "state"_a, "system"_a, "world_from_ref"_a, "cov_more"_a, "known_sigmas"_a);
    def<&window_motions>(m, "window_motions", R"(Return motions (F, 4, 4) from the newest frame to the reference and to every other one, covariances, and ∂ by the rig.

Eq. (74) for `true_cams` (F, 4, 4), of which `root` (6F, n) is a root of the covariance given the rig's errors, and
`by_rig` (6F, m) the Jacobian by these. `by_span` (b,): factors on σ over 1 … b frames, with which the columns between both
of `modes` are multiplied; the columns before them already have the last one, and those after them none. Apparent rotations of
σ `std_turns_rad` (F,) about each axis of `cams_from_ref` are added with a share `apparent_turns` of their variance, eq.
(17b).)",
        "cams_from_ref"_a, "true_cams"_a, "root"_a, "by_rig"_a, "cov_rig"_a, "by_span"_a, "modes"_a, "std_turns_rad"_a, "apparent_turns"_a);
    def<&followed_pose>(m, "followed_pose", R"(Return the pose that follows the one `before` by a motion, and is pulled to the filter's `world_from_cam`, eq. (41a).

It keeps the share `left` of what it is apart, at most `most_sigmas` σ, which is added to its covariance; with it, points
(n, 3) in the camera, in the world, and their covariances (n, 3, 3).)",
        "before"_a, "previous_from_newest"_a, "world_from_cam"_a, "cov_pose"_a, "points_in_cam"_a, "cov_points_in_world"_a, "left"_a,
        "most_sigmas"_a);
    def<&widened_points>(m, "widened_points", R"(Return covariances (n, 3, 3) of points in the world, with `cov` (6, 6) added to the pose that sees them.

Points (n, 3) in the camera; the perturbation is on the right of world_from_cam (4, 4), eq. (45).)",
        "points_in_cam"_a, "cov_points_in_world"_a, "world_from_cam"_a, "cov"_a);
}

}  // namespace binding
