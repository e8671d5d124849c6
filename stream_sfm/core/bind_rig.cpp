// Python's view of rig.hpp.

#include "binding.hpp"
#include "rig.hpp"

namespace binding {

void bind_rig(nb::module_& m) {
    describe_taken<Field>(m);
    describe_taken<RowModel>(m);
    describe_taken<ExposedRows>(m);
    describe_taken<Timing>(m);
    describe_returned<Mixture>(m, R"(Rig errors as a mixture over those that may be exactly zero: mean (m,), covariance (m, m), and p that lenses are wrong.)");
    def<&rig_effects>(m, "rig_effects", R"(Return the effects (n, 4, t) of unit amplitudes of the terms on views (n, 4), and the field's basis (n, K), eq. (70).

`root` (t, t): units of the terms per amplitude. The cameras stand still. `age_s` (n,) or (1,): for how long errors
have grown, eq. (72d). The effects on a missing side are zero.)",
        "pinholes"_a, "root"_a, "field"_a, "z_px"_a, "age_s"_a);
    def<&disparity_effects>(m, "disparity_effects", R"(Return the effect (n, 4, 6), px per px, of the disparity error on views (n, 4) of points (n, 4) measured with it.

The right side of a view has the error, and so has the inverse depth of its point in the previous camera.)",
        "pinholes"_a, "points"_a, "cam_from_previous"_a, "z_px"_a);
    def<&field_basis>(m, "field_basis", R"(Return exp(−d²/(2ℓ²)) between positions (n, 2) and a grid's nodes, times its root: (n, K).

ℓ is the field's length. The result is 0 for a position that is not finite.)",
        "field"_a, "left_px"_a);
    def<&rig_mixture>(m, "rig_mixture", R"(Return mean (m,) and covariance (m, m) of a rig's errors as a mixture, and the probability that lenses are wrong.

All views give N(`mean` (m,), `cov` (m, m)), with the sizes (m,) so far. The first `lenses` terms are those of lenses.
The next n may be 0 in the combinations `is_zero` (c, n) of log probability `log_prior` (c,); for these the share
`counts` of their information counts, and `counts_of_lenses` of that about lenses. The others are of a field, whose size
already contains the odds that there is none. A `share_alone` of lenses has an error in one term only. `known_wrong`: whether lenses
are known to have errors. Raises LinAlgError if the arguments are not finite.)",
        "mean"_a, "cov"_a, "size"_a, "lenses"_a, "is_zero"_a, "log_prior"_a, "counts"_a, "counts_of_lenses"_a, "share_alone"_a, "known_wrong"_a);
    def<&velocities>(m, "velocities", R"(Return the velocities (n, 4), px/s, of views of homogeneous points (n, 4) with `twists` (n, 6), or (1, 6) for all.)",
        "pinholes"_a, "points_in_cam"_a, "twists"_a);
    def<&timed_views>(m, "timed_views", R"(Return the effects (n, 4, 2), px/s, of delay and readout on views of homogeneous points (n, 4), eqs. (70a) and (70c).

`motion` (2, 6): of the points, as from `point_motions`; `timing` (2,) s: delay and readout for which the result is
exact to second order. `z_px` (n, 4): positions whose rows count; without them, those of the projected points count.
The effect on a side with NaN is zero.)",
        "pinholes"_a, "exposed"_a, "points_in_cam"_a, "motion"_a, "timing"_a, "z_px"_a.none());
    def<&shifts_by_timing>(m, "shifts_by_timing", R"(Return the shifts (n, 4) px of views of homogeneous points (n, 4) by delay and readout `mean` (2,) s.)",
        "pinholes"_a, "exposed"_a, "points"_a, "twist"_a, "mean"_a);
    def<&timing_unknowns>(m, "timing_unknowns", R"(Return errors (n, 4, j) px, at σ = 1, of changes of views by delay and readout, N(`mean` (2,), `cov` (2, 2)), s.

Homogeneous points (n, 4) and their twists (6,) are given for the previous and the current frame. A constant delay or
readout has an effect if the velocity has changed; its effect is uncertain if the velocity is, by `std_twist` (6,), or
None. The result has principal components, without those that are negligible beside the noise of a good view. Raises LinAlgError
if `cov` is not definite.)",
        "pinholes"_a, "exposed"_a, "points_before"_a, "twist_before"_a, "points"_a, "twist"_a, "mean"_a, "cov"_a,
        "std_twist"_a.none());
    def<&unknown_errors>(m, "unknown_errors", R"(Return the unknown errors (n, 4, j) px, of σ = 1, of views (n, 4).

They are those of `timing_unknowns`, for homogeneous points (n, 4) in the previous and the current frame, which move
with `twist` (6,), and those of the rows of right sides. Also returns the covariance (3, 3) of the apparent turn of the
right camera by rows. Raises LinAlgError if a covariance is not definite.)",
        "timing"_a, "rows"_a, "before"_a, "now"_a, "z_px"_a, "twist"_a, "std_twist"_a);
    def<&log_evidence>(m, "log_evidence", R"(Return the log likelihood ratios (s, n) of N(0, variance) to 0 for n independent errors, eq. (72a).

`information` (n,): of the views about each; `weighted` (n,): information times estimate; `variances` (s,).)",
        "information"_a, "weighted"_a, "variances"_a);
    def<&row_terms>(m, "row_terms", R"(Return the effect (n, 7 + K) of unit amplitudes on v_left − v_right of views at (n, 2), eq. (19).

The terms are a polynomial of second order, a delay, for views that move across the rows by (n,), or all by (1,), px/s,
and the field.)",
        "pinholes"_a, "field"_a, "left_px"_a, "row_speed_px_s"_a);
    def<&fit_rows>(m, "fit_rows", R"(Return the estimate of rows after matches at (n, 2), whose rows differ by (n,) px: information (k, k) and mean (k,).

The `weighted` sum (k,) is their product. Speeds are as in `row_terms`. Coefficients have changed by σ `step_px` since
the last frame. `own_px` (n, e): effects of errors of this frame alone, of σ = 1. Matches have Cauchy weights of width
`half_weight`, in σ, with that number of reweightings. Also returns the residuals (n,) px without and with the frame's
own errors. Raises LinAlgError if a covariance is not definite.)",
        "rows"_a, "left_px"_a, "difference_px"_a, "row_speed_px_s"_a, "own_px"_a, "step_px"_a, "half_weight"_a, "reweightings"_a);
    def<&on_one_row>(m, "_on_one_row", R"(Return which left and right positions (n, 2), the right ones corrected for row differences, lie on one row.

Speeds are as in `row_terms`. The gate is `scale` times as wide.)",
        "rows"_a, "left_px"_a, "right_px"_a, "row_speed_px_s"_a, "scale"_a);
    def<&polynomial_rows>(m, "polynomial_rows", R"(Return Σ c x^a y^b (n, 4) at both sides of views (n, 4), with x and y from −1 to 1 over the image.)",
        "exposed"_a, "z_px"_a);
}

}  // namespace binding
