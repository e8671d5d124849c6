// Python's view of tracks.hpp.

#include "binding.hpp"
#include "rig_records.hpp"
#include "tracks.hpp"

namespace binding {

namespace {

// Stages that take images of one type of pixels.
template <class T>
void bind_images_of(nb::module_& m) {
    def<&match_new_points<T>>(m, "match_new_points", R"(Find corners of the left image, whole pixels (n, 2), in the right one, by disparities (n,), in templates' pixels.

Their templates, in `slots` (n,) of `stored`, are aligned as if their surfaces faced the camera, within
`tolerance_px` of the start; then with the slant that left and right patch clearly show; and their inner halves alone, as a patch across a depth edge follows the stronger side. Returns of those that fit: their slots (m,); in
image pixels, views (m, 4) with covariances (m, 4, 4), eq. (15); slopes (m, 2) = (∂d/∂u, ∂d/∂v) of the disparity;
and how far apart (m,) whole patch and inner half are matched, at most `max_halves_apart_px` of the templates.)",
        pixels<T>("left"), pixels<T>("right"), pixels<T>("stored"), "templates"_a, "right_sides"_a, "corners_px"_a, "slots"_a, "disparity_px"_a, "tolerance_px"_a, "rules"_a);
}

}  // namespace

void bind_tracks(nb::module_& m) {
    describe_taken<RightSides>(m, R"(Where right sides are sought: the rows, a turn (3,) of the right camera, which is taken out of what is measured there,
and the twist (6,) of the points, per second.)");
    describe_taken<TemplateConfig>(m, R"(Half width of templates and how far from its start one may be found, in their pixels; the largest deviation of grey
differences.)");
    describe_taken<ViewNoise>(m, R"(Pixels that share one noise value, and the variance factor of views.)");
    describe_taken<RowGates>(m, R"(The gate of matches beside their row, in σ, and its least width.)");
    describe_taken<LastingRules>(m, R"(The largest row difference that counts, in σ, and the number of views beyond which a track counts as one of these.)");
    describe_taken<TemplateKind>(m, R"(A kind of templates: image pixels per pixel, and pixels between samples.)");
    describe_taken<TrackTable>(m, R"(Homogeneous points (n, 4) of tracks at unit depth, variances (n,) of 1/Z, covariances (n, 2, 2) px² of left
positions, anchor cameras (n, 4, 4), velocities (n, 2) px/s on the left and slopes (n, 2) of 1/Z there, gains and
offsets (n, 2) of the last left image over the template, and image pixels (n,) per pixel of the template.)");
    describe_taken<Templates<std::uint8_t>>(m, R"(Templates of one kind: left and right image of their pixels (None: without right sides), stored patches as in
`warp_patches`, and where in the left image (h, w) a whole patch shows the scene.)");
    bind_images_of<std::uint8_t>(m);  // before bytes would be converted to floats
    bind_images_of<float>(m);
    def<&place_new_points>(m, "place_new_points", R"(Return which new views (n, 4) lie on their rows, in front of the cameras: their rows (k,) in the table.

With covariances (n, 4, 4), by templates of that `scale`. An inverse depth is at least so many of its σ, and the σ
of a left position at most `max_std_px`. Also returns the views (k, 4) without the rows' differences; and without
the timing, their points (k, 4) and the variances (k,) of 1/Z.)",
        "right_sides"_a, "timing"_a, "z_px"_a, "cov_px"_a, "scale"_a, "least_sigmas"_a, "max_std_px"_a);
    def<&align_tracks>(m, "align_tracks", R"(Find tracks (n) with templates in `slots` (n,) in new images, where `_predict_tracks` puts them.

In the left image, and what is found there in the right one, in the row where it should be. Returns which should be
in view (n,), and of those found at least on the left: their rows (k,), points (k, 4), views (k, 4), NaN where the
right side was not found in its row, their covariances (k, 4, 4), eq. (15), views (k, 4) with right sides that miss
their row, and what has been taken out of all these (k, 4) px, for the timing; and gains and offsets (k, 2) of the
left image over their templates.)",
        "right_sides"_a, "timing"_a, "tracks"_a, "slots"_a, "cam_from_previous"_a, "cam_from_start"_a, "left_px"_a, "agree"_a, "ordinary"_a, "wide"_a.none());
    def<&predict_tracks>(m, "_predict_tracks", R"(Return where a motion (4, 4) puts tracks (n), and how their patches look in the camera `cam_from_start` (4, 4).

Points (n, 4), positions (n, 2) and right columns (n,) at which they start: those of `left_px` (n, 2) that `agree`
(n,) with the motion, or where it puts them. And warps (n, 3, 2) of pixel offsets, now to anchor, for the left and
for the right image. Around the anchor the surface is P(δ) = (x + δ₁, y + δ₂, 1, ρ + slopes·δ), and its image now is
u = A δ / (1 + n·δ) with n the relative change of depth: exact for a plane. Inverted, δ = W u / (1 + h·u) with
W = A⁻¹ and h = −Wᵀn; a warp is W above h. Points now move with a `twist` (6,): a shutter that reads out shears
patches, eq. (14b).)",
        "pinholes"_a, "timing"_a, "twist"_a, "tracks"_a, "cam_from_previous"_a, "cam_from_start"_a, "left_px"_a, "agree"_a);
    def<&update_depths>(m, "update_depths", R"(Return points (n, 4) after a motion (4, 4), put where they were seen, and the variances (n,) of their 1/Z.

Views (n, 4) with covariances (n, 4, 4). 1/Z by a scalar Kalman update where the right side is seen; its variance
has grown by a factor before. Also returns the covariances (n, 2, 2) of the left sides.)",
        "pinholes"_a, "tracks"_a, "cam_from_previous"_a, "z_px"_a, "cov_px"_a, "forgetting"_a);
    def<&templates_fit>(m, "templates_fit", R"(Return which warps (n, 3, 2) keep a window inside a stored patch, and show no detail that the patch lacks.

A pixel covers at least `least_area` pixels of the patch. Half widths of the window and of the patch, in pixels of the template.)",
        "warps"_a, "radius"_a, "half"_a, "least_area"_a);
    def<&inside_area>(m, "inside_area", R"(Return which positions (n, 2) lie in an area (h, w); those that are not finite do not.)",
        "area"_a, "at_px"_a);
    def<&view_covariances>(m, "_view_covariances", R"(Return the covariances (n, 4, 4) px² of views, eq. (15), times a `factor`.

Gradient matrices (n, 2, 2) of templates, and deviations (n,) of grey differences on either side, inf where it was
not found. `shared_pixels` have one noise value; a template's pixel is `scale` image pixels wide.)",
        "gradients"_a, "error_left"_a, "error_right"_a, "shared_pixels"_a, "scale"_a, "factor"_a, "rules"_a);
    def<&row_errors_of_tracks>(m, "row_errors_of_tracks", R"(Return ages (n,) of tracks in views, below `oldest_views`, and their row differences (n, k), the latest first, eq. (68).

Tracks `ids` (n,) with views (n, 4) and covariances (n, 4, 4); those of the frame before, `known` (m,), with ages
and row differences (m, k). All ids ascend. Differences are in standard deviations, at most
`most_row_sigmas`, without what a whole frame shares, and NaN without a right side. Also returns sums (6,): of squares of the differences of two successive
frames, half of both, of their products, and of how many; and of tracks that were seen k frames ago, too: of these
products, of the products of the differences now and then, and of how many.)",
        "known"_a, "ages"_a, "rows"_a, "ids"_a, "z_px"_a, "cov_px"_a, "rules"_a);
    def<&view_inflation>(m, "view_inflation", R"(Return by how much (n, 2) the variances of views of tracks with these ages (n,) are to be multiplied, eq. (69).

For an estimator that adds up the views of a track as if they were independent: then each says as much as it adds.
In units of the white part of its errors, the lasting part of either side has a `ratio`, and its `decay` per view.)",
        "ages"_a, "ratio_left"_a, "ratio_right"_a, "decay"_a, "rules"_a);
    def<&template_drift>(m, "template_drift", R"(Return σ (n,) px of how far templates of homogeneous points (n, 4) slid during a motion (4, 4), eq. (17).

`slide`: s r, a share of half their width, in pixels of the templates, of which each has `scale` (n,) of the image.)",
        "points"_a, "cam_from_previous"_a, "scale"_a, "slide"_a);
    def<&track_covariances>(m, "track_covariances", R"(Return the covariances (n, 4, 4) of points (X/Z, Y/Z, 1, 1/Z), after a drift of σ (n,) px; none if (0,).)",
        "cov_left_px"_a, "var_rho"_a, "drift_px"_a, "focal_px"_a, "baseline_m"_a);
}

}  // namespace binding
