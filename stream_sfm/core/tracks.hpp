// Stages that predict, align, update and begin tracks, and the lasting errors along them.
#pragma once

#include "algebra.hpp"
#include "images.hpp"
#include "pinholes.hpp"

namespace core {

struct RightSides;
struct Timing;
struct TemplateConfig {
    int window_radius_px;
    double max_realignment_px, max_photometric_error;
    RECORD(TemplateConfig, window_radius_px, max_realignment_px, max_photometric_error)
};
struct ViewNoise {
    double shared_pixels, factor;
    RECORD(ViewNoise, shared_pixels, factor)
};
struct TemplateKind {
    int scale, spacing_px;
    TemplateConfig config;
    ViewNoise noise;
    TemplateRules rules;
    RECORD(TemplateKind, scale, spacing_px, config, noise, rules)
};
struct TrackTable {
    Matrix points;  // at unit depth
    Vector var_rho;
    Matrices cov_left_px, anchor_from_start;
    Matrix anchor_velocity_px_s, slopes, exposures;
    Indices scale;
    RECORD(Tracks, points, var_rho, cov_left_px, anchor_from_start, anchor_velocity_px_s, slopes, exposures, scale)
};

// tracks.cpp
struct PredictedTracks {
    Array<double, 2> points, left;
    Array<double, 1> right_u;
    Array<double, 3> left_warps, right_warps;
    FIELDS(points, left, right_u, left_warps, right_warps)
};
PredictedTracks predict_tracks(const Pinholes& pinholes, const Timing& timing, Vector twist, const TrackTable& tracks,
                               Matrix cam_from_previous, Matrix cam_from_start, Matrix left, Flags agree);
struct UpdatedTracks {
    Array<double, 2> points;
    Array<double, 1> var_rho;
    Array<double, 3> cov_left;
    FIELDS(points, var_rho, cov_left)
};
UpdatedTracks update_depths(const Pinholes& pinholes, const TrackTable& tracks, Matrix cam_from_previous, Matrix z,
                            Matrices cov, double forgetting);
Array<bool, 1> templates_fit(Matrices warps, double radius, double half, double least_area);
Array<bool, 1> inside_area(View<bool, 2> area, Matrix at);
Array<double, 3> view_covariances(Matrices gradients, Vector error_left, Vector error_right, double shared_pixels,
                                  double scale, double factor, const TemplateRules& rules);
Array<double, 3> track_covariances(Matrices cov_left, Vector var_rho, Vector drift, double focal, double baseline);
Array<double, 1> template_drift(Matrix points, Matrix cam_from_previous, Indices scale, double slide);

// alignment.cpp
template <class T>  // float or std::uint8_t
struct Templates {
    ImageOf<T> left;
    std::optional<ImageOf<T>> right;
    View<T, 3> stored;
    View<bool, 2> area;
    TemplateKind kind;
    RECORD(Templates, left, right, stored, area, kind)
};
struct AlignedTracks {  // which tracks (n) were expected in view; rows, points and views of those found (k)
    Array<bool, 1> expected;
    Array<std::int64_t, 1> rows;
    Array<double, 2> points, z;
    Array<double, 3> cov;
    Array<double, 2> any_row, taken, exposures;
    Array<double, 1> contrast;
    FIELDS(expected, rows, points, z, cov, any_row, taken, exposures, contrast)
};
AlignedTracks align_tracks(const RightSides& right_sides, const Timing& timing, const TrackTable& tracks, Indices slots,
                           Matrix cam_from_previous, Matrix cam_from_start, Matrix left, Flags agree,
                           const Templates<std::uint8_t>& ordinary, const std::optional<Templates<float>>& wide);

// new_points.cpp
struct NewMatches {
    Array<std::int64_t, 1> slots;
    Array<double, 2> z;
    Array<double, 3> cov;
    Array<double, 2> slopes;
    Array<double, 1> apart;
    FIELDS(slots, z, cov, slopes, apart)
};
template <class T>  // float or std::uint8_t
NewMatches match_new_points(const ImageOf<T>& left, const ImageOf<T>& right, View<T, 3> stored,
                            const TemplateKind& kind, const RightSides& right_sides, Pixels corners, Indices slots,
                            Vector disparity, double tolerance, const PointRules& rules);
struct PlacedPoints {  // rows of the kept ones, their views, and their points with the variances of 1/Z
    Array<std::int64_t, 1> rows;
    Array<double, 2> z, points;
    Array<double, 1> var_rho;
    FIELDS(rows, z, points, var_rho)
};
PlacedPoints place_new_points(const RightSides& right_sides, const Timing& timing, Matrix seen, Matrices cov,
                              double scale, double least_sigmas, double max_std);

// lasting.cpp
struct RowErrors {
    Array<std::int64_t, 1> ages;
    Array<double, 2> rows;
    Array<double, 1> sums;
    FIELDS(ages, rows, sums)
};
struct LastingRules {
    double most_row_sigmas;
    std::int64_t oldest_views;
    RECORD(LastingRules, most_row_sigmas, oldest_views)
};
RowErrors row_errors_of_tracks(Indices known, Indices ages, Matrix rows, Indices ids, Matrix z, Matrices cov,
                               const LastingRules& rules);
Array<double, 2> view_inflation(Indices ages, double ratio_left, double ratio_right, double decay, const LastingRules& rules);

}  // namespace core
