// Python's view of rig.hpp.

#include "binding.hpp"
#include "rig.hpp"

namespace binding {

void bind_rig(nb::module_& m) {
    describe_taken<Field>(m, R"(A field over the image: nodes of its grid, columns (U,) and rows (V,), its length, and the root (K, K); K = U V.)");
    describe_taken<RowModel>(m, R"(The model of the rows' differences: amplitudes (7 + K,) of polynomial, delay and field with their covariance, the
scatter of matches and the largest difference.)");
    describe_taken<ExposedRows>(m, R"(The rows of views in the cameras' own images: size of the rectified image, and coefficients (s, k, k) of one polynomial
for both sides or one for each.)");
    describe_taken<Timing>(m, R"(Delay and readout, seconds: mean (2,) and covariance (2, 2), and the twist (6,) in the previous frame, None if unknown.)");
    describe_returned<Mixture>(m, R"(Errors of a rig as a mixture in which groups may be exactly zero: mean (m,), covariance (m, m), and the probability that
lenses are wrong.)");
    def<&rig_effects>(m, "rig_effects", R"(Return the effects (n, 4, t) of the terms at amplitudes of 1 on views (n, 4), and the field's basis (n, K), eq. (70).

`root` (t, t): units of the terms per amplitude. The cameras are at rest; `age_s` (n,) or (1,): the time for which
errors have grown, eq. (72d). The effects on a missing side are 0.)",
        "pinholes"_a, "root"_a, "field"_a, "z_px"_a, "age_s"_a);
    def<&disparity_effects>(m, "disparity_effects", R"(Return the effects (n, 4, 6) px per px of the disparity's error on views (n, 4) of points (n, 4) measured with it.

The right side of a view has the error, and so has the inverse depth of its point in the previous camera.)",
        "pinholes"_a, "points"_a, "cam_from_previous"_a, "z_px"_a);
    def<&field_basis>(m, "field_basis", R"(Return exp(−d²/(2ℓ²)) between positions (n, 2) and a grid's nodes, times its root: (n, K).

ℓ is the field's length. The result is 0 for a position that is not finite.)",
        "field"_a, "left_px"_a);
    def<&rig_mixture>(m, "rig_mixture", R"(Return mean (m,) and covariance (m, m) of a rig's errors as a mixture, and the probability that lenses are wrong.

N(`mean` (m,), `cov` (m, m)) is from all views, with the sizes (m,) so far. The first `lenses` terms are those of
lenses. The next n may be 0 in the combinations `is_zero` (c, n) with log probabilities `log_prior` (c,); the share
`counts` of the information about them counts, and `counts_of_lenses` of that about lenses. The other terms are those of
a field, which is zero together with the lenses. A `share_alone` of wrong lenses has an error in one term only.
`known_wrong`: lenses have errors. Raises LinAlgError if the arguments are not finite.)",
        "mean"_a, "cov"_a, "size"_a, "lenses"_a, "is_zero"_a, "log_prior"_a, "counts"_a, "counts_of_lenses"_a, "share_alone"_a, "known_wrong"_a);
    def<&velocities>(m, "velocities", R"(Return velocities (n, 4) px/s of views of homogeneous points (n, 4), with `twists` (n, 6), or (1, 6) for all.)",
        "pinholes"_a, "points_in_cam"_a, "twists"_a);
    def<&timed_views>(m, "timed_views", R"(Return the effects (n, 4, 2) px/s of delay and readout on views of homogeneous points (n, 4), eqs. (70a) and (70c).

`motion` (2, 6) of the points, as from `point_motions`; `timing` (2,) s: delay and readout for which the result is exact
to second order. `z_px` (n, 4): the positions whose rows count, by default the projections of the points; the effects on
a side with NaN are 0.)",
        "pinholes"_a, "exposed"_a, "points_in_cam"_a, "motion"_a, "timing"_a, "z_px"_a.none());
    def<&shifts_by_timing>(m, "shifts_by_timing", R"(Return the shifts (n, 4) px of views of homogeneous points (n, 4) by delay and readout (2,), seconds.)",
        "pinholes"_a, "exposed"_a, "points"_a, "twist"_a, "mean"_a);
    def<&timing_unknowns>(m, "timing_unknowns", R"(Return errors (n, 4, j) px, at σ = 1, of changes of views by delay and readout, N(`mean` (2,), `cov` (2, 2)), s.

The views are of homogeneous points (n, 4) with twists (6,), in the previous frame and now. A constant delay or readout
has an effect if the velocity has changed, or if the velocity is uncertain, by `std_twist` (6,). The errors are
principal components, without those that are negligible compared with the noise of a good view. Raises LinAlgError if
`cov` is not definite.)",
        "pinholes"_a, "exposed"_a, "points_before"_a, "twist_before"_a, "points"_a, "twist"_a, "mean"_a, "cov"_a, "std_twist"_a);
    def<&unknown_errors>(m, "unknown_errors", R"(Return unknown errors (n, 4, j) px of views (n, 4), at σ = 1.

They are those of `timing_unknowns`, for homogeneous points (n, 4) in the previous frame and now, which move with
`twist` (6,), and those of the rows of right sides. Also returns the covariance (3, 3) of the apparent rotation of the
right camera from errors of rows and delay. Raises LinAlgError if a covariance is not definite.)",
        "timing"_a, "rows"_a, "before"_a, "now"_a, "z_px"_a, "twist"_a, "std_twist"_a);
    def<&cov_of_timed_pose>(m, "cov_of_timed_pose", R"(Return the covariance (6, 6) of a pose from that of a twist, (6, 6), with delay and readout, eq. (70b).

The pose is estimated from homogeneous points (n, 4); `size` (2,): of delay and readout, s.)",
        "pinholes"_a, "exposed"_a, "points_in_cam"_a, "size"_a, "cov_twist"_a);
    def<&log_evidence>(m, "log_evidence", R"(Return the log odds (s, n) that errors are N(0, variance) rather than 0, eq. (72a).

The n errors are independent; `information` about each is from views, and `weighted` is the sum weighted by it.)",
        "information"_a, "weighted"_a, "variances"_a);
    def<&row_terms>(m, "row_terms", R"(Return the effects (n, 7 + K) of amplitudes of 1 on v_left − v_right of views at (n, 2), eq. (19).

They are those of a polynomial of second order, of a delay, for views that move across the rows at (n,) px/s, or all at
(1,), and of the field.)",
        "pinholes"_a, "field"_a, "left_px"_a, "row_speed_px_s"_a);
    def<&fit_rows>(m, "fit_rows", R"(Return information (k, k) and mean (k,) of the row model after matches at (n, 2), whose rows differ by (n,) px.

The `weighted` sum (k,) is their product. Speeds are as in `row_terms`. Coefficients have changed by σ `step_px` since
the last fit; matches have Cauchy weights, `half_weight` in σ, in so many `reweightings`. Also returns the residuals
(n,) px of the differences. Raises LinAlgError if a covariance is not definite.)",
        "rows"_a, "left_px"_a, "difference_px"_a, "row_speed_px_s"_a, "step_px"_a, "half_weight"_a, "reweightings"_a);
    def<&on_one_row>(m, "_on_one_row", R"(Return whether left and right positions (n, 2), the right ones without the rows' differences, lie on one row.

Speeds are as in `row_terms`. The gate is `scale` times as wide.)",
        "rows"_a, "left_px"_a, "right_px"_a, "row_speed_px_s"_a, "scale"_a);
    def<&polynomial_rows>(m, "polynomial_rows", R"(Return Σ c x^a y^b (n, 4) at both sides of views (n, 4), with x and y from −1 to 1 over the image.)",
        "exposed"_a, "z_px"_a);
}

}  // namespace binding
