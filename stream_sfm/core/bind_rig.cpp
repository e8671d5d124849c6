// Python's view of rig.hpp.

#include "binding.hpp"
#include "rig.hpp"

namespace binding {

void bind_rig(nb::module_& m) {
    describe_taken<Field>(m, R"(A field over the image: nodes of its grid, columns (U,) and rows (V,), its length, and the root (K, K); K = U V.)");
    describe_taken<RowModel>(m, R"(What is known of rows: amplitudes (7 + K,) of polynomial, delay and field with their covariance, the scatter of matches
and the largest difference of rows.)");
    describe_taken<ExposedRows>(m, R"(In which rows of the cameras' own images views are: size of the rectified image, and coefficients (s, k, k) of one
polynomial for both sides or of one for each.)");
    describe_taken<Timing>(m, R"(Delay and readout, seconds: mean (2,) and covariance (2, 2), and the twist (6,) in the frame before, None if unknown.)");
    describe_returned<Mixture>(m, R"(Errors of a rig as a mixture over what may be exactly zero: mean (m,), covariance (m, m), and p that lenses are wrong.)");
    def<&rig_effects>(m, "rig_effects", R"(Return what amplitudes of 1 do to views (n, 4): of the terms (n, 4, t), and the field's basis (n, K), eq. (70).

`root` (t, t): units of the terms per amplitude. Of cameras that stand still; `age_s` (n,) or (1,): for how long errors have grown, eq. (72d). A missing side has no
terms.)",
        "pinholes"_a, "root"_a, "field"_a, "z_px"_a, "age_s"_a);
    def<&disparity_effects>(m, "disparity_effects", R"(Return what the disparity's error does to views (n, 4) of points (n, 4) measured with it: (n, 4, 6) px per px.

The right side of a view has the error, and so has the inverse depth of its point, as of the previous camera.)",
        "pinholes"_a, "points"_a, "cam_from_previous"_a, "z_px"_a);
    def<&field_basis>(m, "field_basis", R"(Return exp(−d²/(2ℓ²)) between positions (n, 2) and a grid's nodes, times its root: (n, K).

ℓ is the field's length. 0 where a position is not finite.)",
        "field"_a, "left_px"_a);
    def<&rig_mixture>(m, "rig_mixture", R"(Return mean (m,) and covariance (m, m) of a rig's errors as a mixture, and the probability that lenses are wrong.

N(`mean` (m,), `cov` (m, m)) by all views, with the sizes (m,) so far. The first `lenses` terms are of lenses; the
next n may be 0 in the combinations `is_zero` (c, n) of log probability `log_prior` (c,), for which the share
`counts` of their information counts, and `counts_of_lenses` of that about lenses; the others are of a field,
which goes with the lenses, of which a `share_alone` errs in one term only. `known_wrong`: lenses have errors. Raises LinAlgError where the arguments are not finite.)",
        "mean"_a, "cov"_a, "size"_a, "lenses"_a, "is_zero"_a, "log_prior"_a, "counts"_a, "counts_of_lenses"_a, "share_alone"_a, "known_wrong"_a);
    def<&velocities>(m, "velocities", R"(Return how views of homogeneous points (n, 4) move (n, 4), px/s, with `twists` (n, 6), or (1, 6) for all.)",
        "pinholes"_a, "points_in_cam"_a, "twists"_a);
    def<&timed_views>(m, "timed_views", R"(Return what delay and readout do to views of homogeneous points (n, 4): (n, 4, 2) px/s, eqs. (70a) and (70c).

`motion` (2, 6) of the points, as of `point_motions`; `timing` (2,) s: delay and readout for which the result is
exact to second order. `z_px` (n, 4): at places whose rows count, where the points are projected if there are none;
to a side with NaN nothing is done.)",
        "pinholes"_a, "exposed"_a, "points_in_cam"_a, "motion"_a, "timing"_a, "z_px"_a.none());
    def<&shifts_by_timing>(m, "shifts_by_timing", R"(Return by how much (n, 4) px delay and readout, seconds (2,), shift views of homogeneous points (n, 4).)",
        "pinholes"_a, "exposed"_a, "points"_a, "twist"_a, "mean"_a);
    def<&timing_unknowns>(m, "timing_unknowns", R"(Return errors (n, 4, j) px, of σ = 1, of changes of views by delay and readout, N(`mean` (2,), `cov` (2, 2)), s.

Of homogeneous points (n, 4) and their twists (6,), in the frame before and now.
A constant delay or readout shows where the velocity has changed; and what either of them does shows where the
velocity is not known, by `std_twist` (6,). Principal components, without those that do not matter beside the noise
of a good view. Raises LinAlgError where `cov` is not definite.)",
        "pinholes"_a, "exposed"_a, "points_before"_a, "twist_before"_a, "points"_a, "twist"_a, "mean"_a, "cov"_a, "std_twist"_a);
    def<&unknown_errors>(m, "unknown_errors", R"(Return errors of views (n, 4) that are unknown: (n, 4, j) px of σ = 1.

Those of `timing_unknowns`, of homogeneous points (n, 4) in the frame before and now, which move with `twist` (6,);
and those of the rows of right sides. Also returns the covariance (3, 3) of the turn of the right camera that rows
and delay feign. Raises LinAlgError where a covariance is not definite.)",
        "timing"_a, "rows"_a, "before"_a, "now"_a, "z_px"_a, "twist"_a, "std_twist"_a);
    def<&cov_of_timed_pose>(m, "cov_of_timed_pose", R"(Return the covariance (6, 6) of a pose, seen by homogeneous points (n, 4), by a twist with (6, 6), eq. (70b).

By a delay and by a readout of `size` (2,), s.)",
        "pinholes"_a, "exposed"_a, "points_in_cam"_a, "size"_a, "cov_twist"_a);
    def<&log_evidence>(m, "log_evidence", R"(Return by how much likelier errors are N(0, variance) than 0, as logarithms (s, n), eq. (72a).

Of n independent ones, from the information that views have about each and their sum weighted by it.)",
        "information"_a, "weighted"_a, "variances"_a);
    def<&row_terms>(m, "row_terms", R"(Return what amplitudes of 1 do to v_left − v_right (n, 7 + K) of views at (n, 2), eq. (19).

A polynomial of second order, and a delay, of views that move across the rows by (n,), or all by (1,), px/s; then
the field.)",
        "pinholes"_a, "field"_a, "left_px"_a, "row_speed_px_s"_a);
    def<&fit_rows>(m, "fit_rows", R"(Return what is known of rows after matches at (n, 2), whose rows differ by (n,) px: information (k, k), and mean (k,).

The `weighted` sum (k,) is their product. Speeds as in `row_terms`. Coefficients have changed by σ `step_px` since; matches
have Cauchy weights, `half_weight` in σ, by so many reweightings. Also returns what is left over of the differences
(n,) px. Raises LinAlgError where a covariance is not definite.)",
        "rows"_a, "left_px"_a, "difference_px"_a, "row_speed_px_s"_a, "step_px"_a, "half_weight"_a, "reweightings"_a);
    def<&on_one_row>(m, "_on_one_row", R"(Return whether left and right positions (n, 2), the right ones without the rows' differences, lie on one row.

Speeds as in `row_terms`. The gate is `scale` times as wide.)",
        "rows"_a, "left_px"_a, "right_px"_a, "row_speed_px_s"_a, "scale"_a);
    def<&polynomial_rows>(m, "polynomial_rows", R"(Return Σ c x^a y^b (n, 4) at both sides of views (n, 4), x and y from −1 to 1 over the image.)",
        "exposed"_a, "z_px"_a);
}

}  // namespace binding
