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
    def<&match_along_rows<T>>(m, "match_along_rows", R"(Return whole-pixel disparities (n,) of left pixels `points_px` (n, 2), and which are unique matches (n,).

The images are of the same pyramid level and size; disparities go from `first` to `last`, in pixels of that level.)",
        pixels<T>("left"), pixels<T>("right"), "points_px"_a, "first"_a, "last"_a, "rules"_a);
    def<&corner_strength<T>>(m, "corner_strength", R"(Return the smaller eigenvalue of the gradient matrix (Shi and Tomasi 1994) at every pixel (h, w); 255 is white.)",
        pixels<T>("image"));
    def<&store<T>>(m, "store_patches", R"(Cut patches around whole pixels (n, 2) into `stored` (slots, side, side), at `slots` (n,).)",
        "stored"_a.noconvert(), pixels<T>("image"), "points_px"_a, "slots"_a);
    def<&warp_patches<T>>(m, "warp_patches", R"(Warp the patches in `slots` (n,) of `stored` to the current view, windows of 2 `radius_px` + 1 pixels.

Warps (n, 3, 2) of pixel offsets are W above h of δ = W u / (1 + h·u). Patches have k × k samples, `spacing_px` apart.
Returns the weighted pseudo-inverse (n, 3, k²) of their slopes along u and v and of their grey values, each of mean
zero; the products (n, 3, 3) of these; and the mean grey value (n,).)",
        pixels<T>("stored"), "slots"_a, "anchor_from_now"_a, "radius_px"_a, "spacing_px"_a, "rules"_a);
    def<&align_patches<T>>(m, "align_patches", R"(Find patches, as `warp_patches` returns them, in an image, from starts (n, 2).

`exposures` (n, 2): gains and offsets of the previous image over the patches. Returns positions (n, 2); whether each was
found (n,); the deviation (n,) of the residual grey differences, eq. (15), in grey values of the template, inf if it
was not found; the gains and offsets (n, 2) of this image; and the contrasts (n,) over
those of the patches, relative to the mean grey values, eq. (17c).)",
        pixels<T>("image"), "starts_px"_a, "inverse"_a, "information"_a, "level"_a, "exposures"_a, "radius_px"_a, "spacing_px"_a, "rules"_a);
}

}  // namespace

void bind_images(nb::module_& m) {
    m.attr("PATCH_RADIUS_PX") = PATCH_RADIUS_PX;
    describe_taken<PointRules>(m);
    describe_taken<TemplateRules>(m);
    bind_images_of<std::uint8_t>(m);  // before bytes would be converted to floats
    bind_images_of<float>(m);
    def<&unfilter_png>(m, "unfilter_png", R"(Return bytes (h, w) of a PNG image with one or two per `pixel`, from rows (h, 1 + w) that begin with their filter.

Raises ValueError for a filter that does not exist.)",
        "filtered"_a, "pixel"_a);
    def<&ghost_sums>(m, "ghost_sums", R"(Return sums (2, 5) over patches for the share of the last image in the current one, by two controls.

Points (n, 2) are given in the current image, the last one and an earlier one; see pictures/ghosts.py.)",
        pixels<std::uint8_t>("now"), pixels<std::uint8_t>("last"), pixels<std::uint8_t>("earlier"), "now_px"_a, "last_px"_a, "earlier_px"_a, "noise_grey"_a, "least_square"_a);
    def<&new_corners>(m, "new_corners", R"(Find up to `wanted` corners (k, 2) in whole pixels, `distance_px` from each other and from `taken_px` (m, 2).

The image is divided into cells of about one wanted point each. A cell's corners are ranked, and all first ranks come
before all second ranks. `strength` (h, w): of each pixel as a corner; `min_strength`: its least value, which is
reduced in images without contrast; `allowed` (h, w): where corners may be.)",
        "strength"_a, "allowed"_a, "taken_px"_a, "wanted"_a, "distance_px"_a, "min_strength"_a, "rules"_a);
    def<&gradient_matrices>(m, "_gradient_matrices", R"(Return gradient matrices (n, 2, 2), grey², eq. (14), of products (n, 3, 3) as `warp_patches` returns them.)",
        "information"_a, "spacing_px"_a);
}

}  // namespace binding
