// Python's view of tracks.hpp.

#include "binding.hpp"
#include "rig_records.hpp"
#include "tracks.hpp"

namespace binding {

namespace {

// Stages that take images of one type of pixels.
template <class T>
void bind_images_of(nb::module_& m) {
    def<&match_new_points<T>>(m, "match_new_points", R"(Find corners of the left image, whole pixels (n, 2), in the right one, from disparities (n,), in template pixels.

Their templates, in `slots` (n,) of `stored`, are aligned as if their surfaces faced the camera, within `tolerance_px`
of the start; then with the slant that left and right patch clearly show; and then their inner halves alone, because a
patch across a depth edge follows the stronger side. Returns for those that fit: their slots (m,); views (m, 4) in
image pixels with covariances (m, 4, 4), eq. (15); slopes (m, 2) = (∂d/∂u, ∂d/∂v) of the disparity; and the distance
(m,) between the matches of whole patch and inner half, at most `max_halves_apart_px` of the templates.)",
        pixels<T>("left"), pixels<T>("right"), pixels<T>("stored"), "templates"_a, "right_sides"_a, "corners_px"_a, "slots"_a, "disparity_px"_a, "tolerance_px"_a, "rules"_a);
}

}  // namespace

void bind_tracks(nb::module_& m) {
    describe_taken<RightSides>(m);
    describe_taken<TemplateConfig>(m, R"(The half width of templates and the largest distance from the start, in their pixels; the largest deviation of grey
differences.)");
    describe_taken<ViewNoise>(m);
    describe_taken<RowGates>(m, R"(The gate, in σ, of a match's distance from its row, and its least width.)");
    describe_taken<LastingRules>(m, R"(The limit of row differences, in σ, and the limit of a track's age, in views.)");
    describe_taken<TemplateKind>(m, R"(A kind of template: image pixels per pixel, and pixels between samples.)");
    describe_taken<TrackTable>(m);
    describe_taken<Templates<std::uint8_t>>(m);
    bind_images_of<std::uint8_t>(m);  // before bytes would be converted to floats
    bind_images_of<float>(m);
    def<&place_new_points>(m, "place_new_points", R"(Return which new views (n, 4) lie on their rows and in front of the cameras, as row numbers (k,) of the table.

The views have covariances (n, 4, 4) and come from templates of that `scale`. An inverse depth must be at least
`least_sigmas` of its σ, and the σ of a left position at most `max_std_px`. Also returns the views (k, 4) without row
differences, and with the timing subtracted as well, their points (k, 4) and the variances (k,) of 1/Z.)",
        "right_sides"_a, "timing"_a, "z_px"_a, "cov_px"_a, "scale"_a, "least_sigmas"_a, "max_std_px"_a);
    def<&align_tracks>(m, "align_tracks", R"(Find tracks (n) with templates in `slots` (n,) in new images, where `_predict_tracks` puts them.

They are sought in the left image, and those found there on their row in the right image. Returns which should be in
view (n,), and for those found at least on the left: their rows (k,), points (k, 4), views (k, 4), NaN if the right side
was not found on its row, covariances (k, 4, 4), eq. (15), views (k, 4) that include right sides off their row, the
correction (k, 4) px for delay and readout that is subtracted from all of these, gains and offsets (k, 2) of the left
image over their templates, and the contrasts (k,) of their patches in it.)",
        "right_sides"_a, "timing"_a, "tracks"_a, "slots"_a, "cam_from_previous"_a, "cam_from_start"_a, "left_px"_a, "agree"_a, "ordinary"_a, "wide"_a.none());
    def<&predict_tracks>(m, "_predict_tracks", R"(Return where a motion (4, 4) puts tracks (n), and how their patches look in the camera `cam_from_start` (4, 4).

These are points (n, 4), left start positions (n, 2) and right start columns (n,): from `left_px` (n, 2) for tracks that
`agree` (n,) with the motion, otherwise from the motion; and warps (n, 3, 2) of pixel offsets, now to anchor, for the
left and for the right image. Around the anchor the surface is P(δ) = (x + δ₁, y + δ₂, 1, ρ + slopes·δ), and its image
now is u = A δ / (1 + n·δ) with n the relative change of depth, which is exact for a plane. Inverted, this is
δ = W u / (1 + h·u) with W = A⁻¹ and h = −Wᵀn; a warp is W above h. Points move with a `twist` (6,), so that a rolling
shutter shears patches, eq. (14b).)",
        "pinholes"_a, "timing"_a, "twist"_a, "tracks"_a, "cam_from_previous"_a, "cam_from_start"_a, "left_px"_a, "agree"_a);
    def<&update_depths>(m, "update_depths", R"(Return points (n, 4) after a motion (4, 4), on the rays of their views, and the variances (n,) of their 1/Z.

Views (n, 4) have covariances (n, 4, 4). If the right side is seen, a scalar Kalman update gives 1/Z, after its variance
is multiplied by `forgetting`. Also returns the covariances (n, 2, 2) of the left sides.)",
        "pinholes"_a, "tracks"_a, "cam_from_previous"_a, "z_px"_a, "cov_px"_a, "forgetting"_a);
    def<&templates_fit>(m, "templates_fit", R"(Return which warps (n, 3, 2) keep a window inside a stored patch, and show no detail that the patch lacks.

A pixel must cover at least `least_area` pixels of the patch. `radius` and `half` are the half widths of the window and
of the patch, in pixels of the template.)",
        "warps"_a, "radius"_a, "half"_a, "least_area"_a);
    def<&inside_area>(m, "inside_area", R"(Return which positions (n, 2) lie in an area (h, w); those that are not finite do not.)",
        "area"_a, "at_px"_a);
    def<&view_covariances>(m, "_view_covariances", R"(Return the covariances (n, 4, 4) px² of views, eq. (15), times a `factor`.

They follow from gradient matrices (n, 2, 2) of templates, and deviations (n,) of grey differences on either side, inf
if it was not found. `shared_pixels` share one noise value; a template pixel is `scale` image pixels wide.)",
        "gradients"_a, "error_left"_a, "error_right"_a, "shared_pixels"_a, "scale"_a, "factor"_a, "rules"_a);
    def<&row_errors_of_tracks>(m, "row_errors_of_tracks", R"(Return ages (n,) of tracks in views, below `oldest_views`, and row differences (n, k), the latest first, eq. (68).

Tracks `ids` (n,) have views (n, 4) and covariances (n, 4, 4); those of the previous frame, `known` (m,), have ages and
row differences (m, k). All ids ascend. Differences are in standard deviations, at most `most_row_sigmas`, less the
median of the frame, and NaN without a right side. Also returns sums (6,) over pairs of successive differences: of half
their squares, of their products, and their number; and over tracks that were also seen k frames ago: of these
products, of the products of the differences now and then, and their number.)",
        "known"_a, "ages"_a, "rows"_a, "ids"_a, "z_px"_a, "cov_px"_a, "rules"_a);
    def<&view_inflation>(m, "view_inflation", R"(Return the factors (n, 2) on the variances of views of tracks with these ages (n,), eq. (69).

They are for an estimator that treats the views of a track as independent: each view then counts as the information
that it adds. `ratio_left`, `ratio_right`: variances of the lasting error over the white one; `decay`: per view.)",
        "ages"_a, "ratio_left"_a, "ratio_right"_a, "decay"_a, "rules"_a);
    def<&template_drift>(m, "template_drift", R"(Return σ (n,) px of the drift of templates of homogeneous points (n, 4) during a motion (4, 4), eq. (17).

`slide`: s r, a share of half their width, in template pixels, which are `scale` (n,) image pixels wide.)",
        "points"_a, "cam_from_previous"_a, "scale"_a, "slide"_a);
    def<&track_covariances>(m, "track_covariances", R"(Return the covariances (n, 4, 4) of points (X/Z, Y/Z, 1, 1/Z), after a drift of σ (n,) px, or no drift if (0,).)",
        "cov_left_px"_a, "var_rho"_a, "drift_px"_a, "focal_px"_a, "baseline_m"_a);
}

}  // namespace binding
