// New points in the right image: aligned as if they faced the camera, again with their slant, and by their inner halves alone.

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "stages.hpp"

namespace core {
namespace {

double apart(const double* a, const double* b) { return std::sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])); }

// Warps (n, 3, 2), right image to left template, of surfaces whose disparity has `slopes` (n, 2), below 1: affine.
Array<double, 3> sheared(const View<double, 2>& slopes) {
    std::size_t n = slopes.shape[0];
    Array<double, 3> warps({n, 3, 2});
    for (std::size_t i = 0; i < n; i++) {
        double* w = warps[i];
        w[0] = 1 / (1 - slopes[i][0]);
        w[1] = slopes[i][1] / (1 - slopes[i][0]);
        w[3] = 1;
    }
    return warps;
}

// Some rows of an array.
template <class T, std::size_t N>
Array<T, N> taken(const View<T, N>& from, const std::vector<std::size_t>& rows) {
    std::array<std::size_t, N> shape = from.shape;
    shape[0] = rows.size();
    Array<T, N> result(shape);
    for (std::size_t i = 0; i < rows.size(); i++) std::copy_n(from[rows[i]], from.row_size(), result[i]);
    return result;
}

}  // namespace

template <class T>
NewMatches match_new_points(const ImageOf<T>& left, const ImageOf<T>& right, const View<T, 3>& stored, const TemplateKind& kind,
                            const Pixels& corners, const Indices& slots, const View<double, 2>& start, double tolerance,
                            double std_grey, double max_apart) {
    std::size_t n = corners.shape[0];
    require_shape(corners, {n, 2}, "corners_px");
    require_shape(slots, {n}, "slots");
    require_shape(start, {n, 2}, "start_px");
    require(kind.radius >= 2, "the templates' radius is below 2 px");
    auto align = [&](const Indices& of, const View<double, 2>& slopes, const View<double, 2>& from, int radius, int spacing) {
        Patches patches = warp_patches(stored, of, sheared(slopes).view(), radius, spacing);
        AlignedPatches found = align_patches(right, from, patches.inverse.view(), patches.information.view(), patches.level.view(),
                                             radius, spacing);
        return std::make_pair(std::move(found), std::move(patches.information));
    };
    const Array<double, 2> flat({n, 2});
    auto [facing, information] = align(slots, flat.view(), start, kind.radius, kind.spacing);
    std::vector<std::size_t> kept, slanted, good, of_corner;
    for (std::size_t i = 0; i < n; i++)
        if (facing.found.data[i] && apart(facing.at[i], start[i]) < tolerance) kept.push_back(i);

    Array<double, 2> at = taken(facing.at.view(), kept);
    Array<double, 1> error = taken(facing.error.view(), kept);
    Array<std::int64_t, 1> of_kept = taken(slots, kept);
    Array<double, 2> slopes = disparity_slopes(left, right, taken(corners, kept).view(), at.view(), kind.radius, std_grey);
    std::vector<bool> fits(kept.size(), true);
    for (std::size_t i = 0; i < kept.size(); i++)
        if (slopes[i][0] != 0 || slopes[i][1] != 0) slanted.push_back(i);
    AlignedPatches again = align(taken(of_kept.view(), slanted).view(), taken(slopes.view(), slanted).view(),
                                 taken(at.view(), slanted).view(), kind.radius, kind.spacing).first;
    for (std::size_t i = 0; i < slanted.size(); i++) {
        std::copy_n(again.at[i], 2, at[slanted[i]]);
        error.data[slanted[i]] = again.error.data[i];
        fits[slanted[i]] = again.found.data[i];
    }

    AlignedPatches inner = align(of_kept.view(), {flat.data.get(), {kept.size(), 2}}, at.view(), kind.radius / 2, 1).first;
    for (std::size_t i = 0; i < kept.size(); i++) {
        if (!(fits[i] && error.data[i] < kind.max_error && inner.found.data[i] && apart(inner.at[i], at[i]) < max_apart)) continue;
        good.push_back(i);
        of_corner.push_back(kept[i]);
    }
    Array<double, 1> of_good = taken(error.view(), good);
    Array<double, 3> gradients = gradient_matrices(taken(information.view(), of_corner).view(), kind.spacing);
    NewMatches result{taken(slots, of_corner), Array<double, 2>({good.size(), 4}),
                      view_covariances(gradients.view(), of_good.view(), of_good.view(), kind.shared_pixels, kind.scale, kind.factor),
                      taken(slopes.view(), good), Array<double, 1>({good.size()})};
    for (std::size_t i = 0; i < good.size(); i++) {
        for (int k = 0; k < 2; k++) {
            result.z[i][k] = static_cast<double>(kind.scale * corners[of_corner[i]][k]);
            result.z[i][2 + k] = kind.scale * at[good[i]][k];
        }
        result.apart.data[i] = kind.scale * apart(inner.at[good[i]], at[good[i]]);
    }
    return result;
}

template NewMatches match_new_points(const ImageOf<float>&, const ImageOf<float>&, const View<float, 3>&, const TemplateKind&,
                                     const Pixels&, const Indices&, const View<double, 2>&, double, double, double);
template NewMatches match_new_points(const ImageOf<std::uint8_t>&, const ImageOf<std::uint8_t>&, const View<std::uint8_t, 3>&,
                                     const TemplateKind&, const Pixels&, const Indices&, const View<double, 2>&, double, double, double);

}  // namespace core
