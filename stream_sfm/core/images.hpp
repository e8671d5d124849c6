// Stages on pixels: matches along rows, patches, corners, slant; and PNG rows.
#pragma once

#include "algebra.hpp"
#include "image.hpp"

namespace core {

struct PointRules {  // of new points
    double std_grey, max_halves_apart_px, match_correlation, match_lead;
    double std_slope, max_slope, significant_slope, max_slant_shift_px, dim_fraction, cell_distances;
    int match_radius_px, match_spacing_px, match_neighbours_px, slant_steps, peak_part;
    std::size_t candidates;
    RECORD(PointRules, std_grey, max_halves_apart_px, match_correlation, match_lead, std_slope, max_slope, significant_slope,
           max_slant_shift_px, dim_fraction, cell_distances, match_radius_px, match_spacing_px, match_neighbours_px,
           slant_steps, peak_part, candidates)
};
struct TemplateRules {
    double weights_width, step_ratio, converged_px, max_gain, min_explained, same_level, same_exposure;
    double std_floor_px, least_error_grey, unknown_error_grey, edge_damping, least_area;
    int steps;
    std::size_t exposure_views, exposures;
    RECORD(TemplateRules, weights_width, step_ratio, converged_px, max_gain, min_explained, same_level, same_exposure, std_floor_px,
           least_error_grey, unknown_error_grey, edge_damping, least_area, steps, exposure_views, exposures)
};

// rows.cpp
struct RowMatches {
    Array<double, 1> disparity;
    Array<bool, 1> unique;
    FIELDS(disparity, unique)
};
template <class T>  // float or std::uint8_t
RowMatches match_along_rows(const ImageOf<T>& left, const ImageOf<T>& right, Pixels points, std::int64_t first,
                            std::int64_t last, const PointRules& rules);

// patches.cpp
struct Patches {
    Array<float, 3> inverse;
    Array<double, 3> information;
    Array<float, 1> level;
    FIELDS(inverse, information, level)
};
struct AlignedPatches {
    Array<double, 2> at;
    Array<bool, 1> found;
    Array<double, 1> error;
    Array<double, 2> exposures;
    Array<double, 1> contrast;
    FIELDS(at, found, error, exposures, contrast)
};
template <class T>  // float or std::uint8_t
void store_patches(T* stored, const std::array<std::size_t, 3>& shape, const ImageOf<T>& image, Pixels points, Indices slots);
template <class T>
Patches warp_patches(View<T, 3> stored, Indices slots, Matrices warps, int radius, int spacing, const TemplateRules& rules);
template <class T>
AlignedPatches align_patches(const ImageOf<T>& image, Matrix starts, View<float, 3> inverse, Matrices information,
                             View<float, 1> level, Matrix before, int radius, int spacing, const TemplateRules& rules);
Array<double, 3> gradient_matrices(Matrices information, int spacing);

// corners.cpp
template <class T>
Array<float, 2> corner_strength(const ImageOf<T>& image);
Array<std::int64_t, 2> new_corners(const Image& strength, View<bool, 2> allowed, Matrix taken, std::int64_t wanted,
                                   double distance, double min_strength, const PointRules& rules);

// slant.cpp
template <class T>
Array<double, 2> disparity_slopes(const ImageOf<T>& left, const ImageOf<T>& right, Pixels points, Matrix right_px,
                                  int radius, int spacing, double std_grey, const PointRules& rules);
std::vector<std::size_t> slanted_rows(Matrix slopes);  // those of surfaces that do not face the camera

// ghosts.cpp
constexpr int PATCH_RADIUS_PX = 5;
Array<double, 2> ghost_sums(const ImageOf<std::uint8_t>& now, const ImageOf<std::uint8_t>& last, const ImageOf<std::uint8_t>& earlier,
                            Matrix now_px, Matrix last_px, Matrix earlier_px, double noise_grey, double least_square);

// png.cpp
Array<std::uint8_t, 2> unfilter_png(View<std::uint8_t, 2> filtered, std::size_t pixel);

}  // namespace core
