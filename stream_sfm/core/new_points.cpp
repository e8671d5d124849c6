// New points in the right image: patches are aligned facing the camera, then with their slant, then by their inner halves.

#include "tracks.hpp"
#include "images.hpp"
#include "resection.hpp"
#include "row_timing.hpp"

namespace core {
namespace {

double apart(const double* a, const double* b) { return std::sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])); }

// Affine warps (n, 3, 2), right image to left template, of surfaces whose disparity has `slopes` (n, 2) below 1.
Array<double, 3> sheared(Matrix slopes) {
    std::size_t n = slopes.shape[0];
    Array<double, 3> warps(n, 3, 2);
    for (std::size_t i = 0; i < n; i++) {
        double* w = warps[i];
        w[0] = 1 / (1 - slopes[i][0]);
        w[1] = slopes[i][1] / (1 - slopes[i][0]);
        w[3] = 1;
    }
    return warps;
}

// The positions where right sides of corners (n, 2) with disparities (n,) are sought, in pixels of templates.
Array<double, 2> starts_of(const RightSides& by, double scale, Pixels corners, Vector disparity) {
    std::size_t n = corners.shape[0];
    Array<double, 2> z(n, 4);
    for (std::size_t i = 0; i < n; i++) {
        for (int c = 0; c < 4; c++) z[i][c] = scale * static_cast<double>(corners[i][c % 2]);
        z[i][2] -= scale * disparity.data[i];
    }
    Array<double, 1> speed = row_speeds(by.rows.projection, seen_points(by.rows.projection, z), by.twist);
    Array<double, 1> offsets = row_offsets(by.rows, two_columns_of(z, 0), speed);
    Array<double, 2> start = two_columns_of(z, 2);
    for (std::size_t i = 0; i < n; i++) start[i][1] -= offsets.data[i];
    turn_by(by.rows.projection, by.turn_rad, 1, start);
    for (std::size_t i = 0; i < n; i++) {
        start[i][0] = z[i][2] / scale;  // the measured disparity already contains the turn
        start[i][1] /= scale;
    }
    return start;
}

// Gains and offsets (n, 2) of templates that have just been cut.
Array<double, 2> one_exposure(std::size_t n) {
    Array<double, 2> exposures(n, 2);
    for (std::size_t i = 0; i < n; i++) exposures[i][0] = 1;
    return exposures;
}

}  // namespace

template <class T>
NewMatches match_new_points(const ImageOf<T>& left, const ImageOf<T>& right, View<T, 3> stored,
                            const TemplateKind& kind, const RightSides& right_sides, Pixels corners, Indices slots,
                            Vector disparity, double tolerance, const PointRules& rules) {
    std::size_t n = corners.shape[0];
    require_shape(corners, {n, 2}, "corners_px");
    require_shape(slots, {n}, "slots");
    require_shape(disparity, {n}, "disparity_px");
    require_shape(right_sides.turn_rad, {3}, "turn");
    require(kind.config.window_radius_px >= 2, "the templates' radius is below 2 px");
    auto align = [&](Indices of, Matrix slopes, Matrix from, int radius, int spacing) {
        Patches patches = warp_patches(stored, of, sheared(slopes), radius, spacing, kind.rules);
        AlignedPatches found = align_patches(right, from, patches.inverse, patches.information, patches.level,
                                             one_exposure(of.shape[0]), radius, spacing, kind.rules);
        return std::make_pair(std::move(found), std::move(patches.information));
    };
    const Array<double, 2> flat(n, 2);
    Array<double, 2> start = starts_of(right_sides, kind.scale, corners, disparity);
    auto [facing, information] = align(slots, flat, start, kind.config.window_radius_px, kind.spacing_px);
    std::vector<std::size_t> kept, good, of_corner;
    for (std::size_t i = 0; i < n; i++)
        if (facing.found.data[i] && apart(facing.at[i], start[i]) < tolerance) kept.push_back(i);

    Array<double, 2> at = rows_of(facing.at, kept);
    Array<double, 1> error = rows_of(facing.error, kept);
    Array<std::int64_t, 1> of_kept = rows_of(slots, kept);
    double std_grey = rules.std_grey / kind.scale;  // the mean over pixels reduces noise
    Array<double, 2> slopes = disparity_slopes(left, right, rows_of(corners, kept), at, kind.config.window_radius_px, kind.spacing_px,
                                               std_grey, rules);
    std::vector<bool> fits(kept.size(), true);
    std::vector<std::size_t> slanted = slanted_rows(slopes);
    AlignedPatches again = align(rows_of(of_kept, slanted), rows_of(slopes, slanted), rows_of(at, slanted), kind.config.window_radius_px,
                                 kind.spacing_px).first;
    for (std::size_t i = 0; i < slanted.size(); i++) {
        std::copy_n(again.at[i], 2, at[slanted[i]]);
        error.data[slanted[i]] = again.error.data[i];
        fits[slanted[i]] = again.found.data[i];
    }

    AlignedPatches inner = align(of_kept, {flat.data.get(), {kept.size(), 2}}, at, kind.config.window_radius_px / 2, 1).first;
    for (std::size_t i = 0; i < kept.size(); i++) {
        if (!(fits[i] && error.data[i] < kind.config.max_photometric_error && inner.found.data[i] && apart(inner.at[i], at[i]) < rules.max_halves_apart_px)) continue;
        good.push_back(i);
        of_corner.push_back(kept[i]);
    }
    Array<double, 1> of_good = rows_of(error, good);
    Array<double, 3> gradients = gradient_matrices(rows_of(information, of_corner), kind.spacing_px);
    NewMatches result{rows_of(slots, of_corner), {good.size(), 4},
                      view_covariances(gradients, of_good, of_good, kind.noise.shared_pixels, kind.scale, kind.noise.factor, kind.rules),
                      rows_of(slopes, good), {good.size()}};
    Array<double, 2> right_px = rows_of(at, good);
    for (std::size_t i = 0; i < 2 * good.size(); i++) right_px.data[i] *= kind.scale;
    turn_by(right_sides.rows.projection, right_sides.turn_rad, -1, right_px);
    for (std::size_t i = 0; i < good.size(); i++) {
        for (int k = 0; k < 2; k++) {
            result.z[i][k] = static_cast<double>(kind.scale * corners[of_corner[i]][k]);
            result.z[i][2 + k] = right_px[i][k];
        }
        result.apart.data[i] = kind.scale * apart(inner.at[good[i]], at[good[i]]);
    }
    return result;
}

template decltype(match_new_points<float>) match_new_points<float>;
template decltype(match_new_points<std::uint8_t>) match_new_points<std::uint8_t>;

PlacedPoints place_new_points(const RightSides& by, const Timing& timing, Matrix seen, Matrices cov, double scale,
                              double least_sigmas, double max_std) {
    std::size_t n = seen.shape[0];
    require_shape(cov, {n, 4, 4}, "cov_px");
    Array<double, 2> points = seen_points(by.rows.projection, seen), left = two_columns_of(seen, 0), right = two_columns_of(seen, 2);
    Array<double, 1> speed = row_speeds(by.rows.projection, points, by.twist);
    Array<double, 1> offsets = row_offsets(by.rows, left, speed);
    for (std::size_t i = 0; i < n; i++) right[i][1] += offsets.data[i];
    Array<bool, 1> on_row = on_one_row(by.rows, left, right, speed, scale);
    Array<double, 2> shift = shifts_by_timing(by.rows.projection, timing.row_of, points, by.twist, timing.mean), z(n, 4);
    for (std::size_t i = 0; i < n; i++) {
        std::copy_n(right[i], 2, std::copy_n(left[i], 2, z[i]));
        for (int c = 0; c < 4; c++) shift[i][c] = z[i][c] - shift[i][c];
    }
    points = seen_points(by.rows.projection, shift);
    double per_px = 1 / (by.rows.projection.f_px * by.rows.projection.baseline_m);
    Array<double, 1> var_rho(n);
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < n; i++) {
        var_rho.data[i] = (cov[i][0] + cov[i][10]) * per_px * per_px;
        bool exact = cov[i][0] < max_std * max_std && cov[i][5] < max_std * max_std;
        if (on_row.data[i] && exact && points[i][3] > least_sigmas * std::sqrt(var_rho.data[i])) kept.push_back(i);
    }
    return {numbers(kept), rows_of(z, kept), rows_of(points, kept), rows_of(var_rho, kept)};
}

}  // namespace core
