// Python's view of images.hpp.

#include "binding.hpp"
#include "images.hpp"

namespace binding {

namespace {

template <class T>
void store(const Writable<T>& stored, const ImageOf<T>& image, Pixels points, Indices slots) {
    store_patches(stored.data, stored.shape, image, points, slots);
}

// Stages that take images of one type of pixels.
template <class T>
void bind_images_of(nb::module_& m) {
    def<&match_along_rows<T>>(m, "match_along_rows", R"(Whole-pixel disparities (n,) of pixels `points_px` (n, 2) of the left image, and where they are unique matches.

Images of one pyramid level, of one size; disparities from `first` to `last`, pixels of that level.)",
        pixels<T>("left"), pixels<T>("right"), "points_px"_a, "first"_a, "last"_a, "rules"_a);
    def<&corner_strength<T>>(m, "corner_strength", R"(The smaller eigenvalue of the gradient matrix (Shi and Tomasi 1994) at every pixel (h, w); 255 is white.)",
        pixels<T>("image"));
    def<&store<T>>(m, "store_patches", R"(Cut patches around whole pixels (n, 2) into `stored` (slots, side, side), at `slots` (n,).)",
        "stored"_a.noconvert(), pixels<T>("image"), "points_px"_a, "slots"_a);
    def<&warp_patches<T>>(m, "warp_patches", R"(Patches (n) of 2 `radius_px` + 1 pixels as today's image should show them, of those of `slots` (n,) in `stored`.

Warps (n, 3, 2) of pixel offsets: W above h of δ = W u / (1 + h·u). Returns, of k × k samples `spacing_px` apart,
the weighted pseudo-inverse (n, 3, k²) of their slopes along u and v and of their grey values, each of mean zero;
the products (n, 3, 3) of these; and the mean grey value (n,).)",
        pixels<T>("stored"), "slots"_a, "anchor_from_now"_a, "radius_px"_a, "spacing_px"_a, "rules"_a);
    def<&align_patches<T>>(m, "align_patches", R"(Find patches, as `warp_patches` returns them, in an image, from starts (n, 2).

The image before has gains and offsets `exposures` (n, 2) over the patches. Returns positions (n, 2), whether each was
found (n,), and the deviation (n,) of the grey differences that are left, in grey values of the template, inf where it
was not found; eq. (15); and the gains and offsets (n, 2) of this image.)",
        pixels<T>("image"), "starts_px"_a, "inverse"_a, "information"_a, "level"_a, "exposures"_a, "radius_px"_a, "spacing_px"_a, "rules"_a);
}

}  // namespace

void bind_images(nb::module_& m) {
    m.attr("PATCH_RADIUS_PX") = PATCH_RADIUS_PX;
    describe_taken<PointRules>(m, R"(The settings of new points, as in `PointRules`.)");
    describe_taken<TemplateRules>(m, R"(The settings of templates, as in `TemplateRules`.)");
    bind_images_of<std::uint8_t>(m);  // before bytes would be converted to floats
    bind_images_of<float>(m);
    def<&unfilter_png>(m, "unfilter_png", R"(Bytes (h, w) of a PNG image with one or two a `pixel`, from rows (h, 1 + w) that begin with their filter.

Raises ValueError for a filter that does not exist.)",
        "filtered"_a, "pixel"_a);
    def<&patch_smears>(m, "patch_smears", R"(By how much variance patches are smeared beside earlier ones (n, 13, 13), px², and the variance of this: (n, 4).

Then the mean squares of what earlier ones do not explain, and of the patch itself, grey values squared. `along` (n, 3):
what the coefficients of the second derivatives xx, yy and xy count; see frontend/smear_check.py.)",
        "before"_a, "after"_a, "along"_a, "noise_grey"_a, "least_square"_a);
    def<&ghost_sums>(m, "ghost_sums", R"(Sums (2, 5) over patches of how much of the last image is in today's, and of their squares, by two controls.

Of points (n, 2) in today's image, in the last one and in an earlier one; see frontend/ghost_check.py.)",
        pixels<std::uint8_t>("now"), pixels<std::uint8_t>("last"), pixels<std::uint8_t>("earlier"), "now_px"_a, "last_px"_a, "earlier_px"_a, "noise_grey"_a, "least_square"_a);
    def<&drawn_edges>(m, "drawn_edges", R"(How many edges are in lines (k, n) of the left image, at how many it has changed since the last one, and how many
are the same in that, in an earlier one and in the right image; −1 is a pixel that shows nothing.)",
        "left"_a, "last"_a, "earlier"_a, "right"_a, "edge_grey"_a, "same_grey"_a, "same_step_grey"_a);
    def<&same_slopes>(m, "same_slopes", R"(How many pixels in one of `spacing_px` rows are on a slope of the left image, and how many of them are the same in the
right one: by their difference two pixels apart, and between the images.)",
        pixels<std::uint8_t>("left"), pixels<std::uint8_t>("right"), "spacing_px"_a, "slope_grey"_a, "same_grey"_a);
    def<&new_corners>(m, "new_corners", R"(Find up to `wanted` corners (k, 2) in whole pixels, `distance_px` from each other and from `taken_px` (m, 2).

The image is cut into cells of about one wanted point each; a cell's corners are ranked, and all first ranks come
before all second ranks. `strength` (h, w) of each pixel as a corner, and its least value `min_strength`, which is
less in images without contrast; `allowed` (h, w).)",
        "strength"_a, "allowed"_a, "taken_px"_a, "wanted"_a, "distance_px"_a, "min_strength"_a, "rules"_a);
    def<&gradient_matrices>(m, "_gradient_matrices", R"(Return gradient matrices (n, 2, 2), grey², eq. (14), of products (n, 3, 3) as `warp_patches` returns them.)",
        "information"_a, "spacing_px"_a);
}

}  // namespace binding
