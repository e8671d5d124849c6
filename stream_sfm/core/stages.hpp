// The stages of the core, one file each; `_core.pyi` documents them as Python calls them. `parts` of a result are what Python is
// given, in this order.
#pragma once

#include <optional>
#include <tuple>

#include "arrays.hpp"
#include "image.hpp"
#include "pinholes.hpp"

namespace core {

using Indices = View<std::int64_t, 1>;
using Pixels = View<std::int64_t, 2>;  // (n, 2): column, row

// rows.cpp
struct RowMatches {
    Array<double, 1> disparity;
    Array<bool, 1> unique;
    auto parts() { return std::tie(disparity, unique); }
};
template <class T>  // float or std::uint8_t
RowMatches match_along_rows(const ImageOf<T>& left, const ImageOf<T>& right, const Pixels& points, std::int64_t first,
                            std::int64_t last);

// patches.cpp
struct Patches {
    Array<float, 3> inverse;
    Array<double, 3> information;
    Array<float, 1> level;
    auto parts() { return std::tie(inverse, information, level); }
};
struct AlignedPatches {
    Array<double, 2> at;
    Array<bool, 1> found;
    Array<double, 1> error;
    auto parts() { return std::tie(at, found, error); }
};
Array<float, 1> sample_weights(int radius, int spacing);
template <class T>  // float or std::uint8_t
void store_patches(T* stored, const std::array<std::size_t, 3>& shape, const ImageOf<T>& image, const Pixels& points, const Indices& slots);
template <class T>
Patches warp_patches(const View<T, 3>& stored, const Indices& slots, const View<double, 3>& warps, int radius, int spacing);
template <class T>
AlignedPatches align_patches(const ImageOf<T>& image, const View<double, 2>& starts, const View<float, 3>& inverse,
                             const View<double, 3>& information, const View<float, 1>& level, int radius, int spacing);

Array<double, 3> gradient_matrices(const View<double, 3>& information, int spacing);

// row_errors.cpp
struct Field {  // a grid's nodes, columns `u` and rows `v`
    View<double, 1> u, v;
    double length;
    View<double, 2> root;
};
struct RowModel {
    std::array<double, 2> size;
    Field field;
    View<double, 1> mean;
    View<double, 2> cov;
    double scatter, max;
};
Array<double, 2> row_terms(const std::array<double, 2>& size, const Field& field, const View<double, 2>& at, const View<double, 1>& speed);
Array<double, 1> row_offsets(const RowModel& rows, const View<double, 2>& at, const View<double, 1>& speed);
Array<bool, 1> on_one_row(const RowModel& rows, const View<double, 2>& left, const View<double, 2>& right, const View<double, 1>& speed,
                          double scale);
struct RightSides {  // where they are sought, of points that move with a twist, with a turn of the right camera
    Pinholes pinholes;
    RowModel rows;
    View<double, 1> turn, twist;
};
struct UnknownOfViews {
    Array<double, 3> errors;
    Array<double, 2> cov_turn;
    auto parts() { return std::tie(errors, cov_turn); }
};
struct ExposedRows {  // polynomials over the rectified image: the rows of the cameras' own images
    std::array<double, 2> size;
    View<double, 3> coefficients;
};
struct Timing {  // delay and readout, and how points moved in the frame before
    ExposedRows exposed;
    View<double, 1> mean;
    View<double, 2> cov;
    View<double, 1> twist;
};
UnknownOfViews unknown_errors(const Pinholes& pinholes, const Timing& timing, const RowModel& rows, const View<double, 2>& before,
                              const View<double, 2>& now, const View<double, 2>& z, const View<double, 1>& twist,
                              const View<double, 1>& std_twist);

// Templates of one size: image pixels per pixel; half width and distance of samples, and how far from its start a patch may be
// found, in pixels of the template; the largest grey deviation; and of the noise of views the pixels that share a value, and a factor.
struct TemplateKind {
    int scale, radius, spacing;
    double farthest, max_error, shared_pixels, factor;
};
// tracks.cpp
struct TrackTable {
    View<double, 2> points;  // at unit depth
    View<double, 1> var_rho;
    View<double, 3> cov_left, anchor_from_start;
    View<double, 2> anchor_velocity, slopes;
    Indices scale;
};
struct PredictedTracks {
    Array<double, 2> points, left;
    Array<double, 1> right_u;
    Array<double, 3> left_warps, right_warps;
    auto parts() { return std::tie(points, left, right_u, left_warps, right_warps); }
};
PredictedTracks predict_tracks(const Pinholes& pinholes, const Timing& timing, const View<double, 1>& twist, const TrackTable& tracks,
                               const View<double, 2>& cam_from_previous, const View<double, 2>& cam_from_start,
                               const View<double, 2>& left, const View<bool, 1>& agree);
struct UpdatedTracks {
    Array<double, 2> points;
    Array<double, 1> var_rho;
    Array<double, 3> cov_left;
    auto parts() { return std::tie(points, var_rho, cov_left); }
};
UpdatedTracks update_depths(const Pinholes& pinholes, const TrackTable& tracks, const View<double, 2>& cam_from_previous,
                            const View<double, 2>& z, const View<double, 3>& cov, double forgetting);
Array<bool, 1> templates_fit(const View<double, 3>& warps, double radius, double half);
Array<bool, 1> inside_area(const View<bool, 2>& area, const View<double, 2>& at);
Array<double, 3> view_covariances(const View<double, 3>& gradients, const View<double, 1>& error_left,
                                  const View<double, 1>& error_right, double shared_pixels, double scale, double factor);
Array<double, 3> track_covariances(const View<double, 3>& cov_left, const View<double, 1>& var_rho, const View<double, 1>& drift,
                                   double focal, double baseline);
Array<double, 1> template_drift(const View<double, 2>& points, const View<double, 2>& cam_from_previous, const Indices& scale, double radius);

// alignment.cpp
// Templates of one size: images of their pixels in which they are sought, the right one if there is one; their patches; and where
// in the left image (h, w) a whole patch shows the scene.
template <class T>  // float or std::uint8_t
struct Templates {
    ImageOf<T> left;
    std::optional<ImageOf<T>> right;
    View<T, 3> stored;
    View<bool, 2> area;
    TemplateKind kind;
};
struct AlignedTracks {  // of tracks (n) which were expected in view, and of those found (k) their rows, points and views
    Array<bool, 1> expected;
    Array<std::int64_t, 1> rows;
    Array<double, 2> points, z;
    Array<double, 3> cov;
    Array<double, 2> any_row, taken;
    auto parts() { return std::tie(expected, rows, points, z, cov, any_row, taken); }
};
AlignedTracks align_tracks(const RightSides& right_sides, const Timing& timing, const TrackTable& tracks, const Indices& slots,
                           const View<double, 2>& cam_from_previous, const View<double, 2>& cam_from_start, const View<double, 2>& left,
                           const View<bool, 1>& agree, const Templates<std::uint8_t>& ordinary,
                           const std::optional<Templates<float>>& wide);

// corners.cpp
template <class T>
Array<float, 2> corner_strength(const ImageOf<T>& image);
Array<std::int64_t, 2> new_corners(const Image& strength, const View<bool, 2>& allowed, const View<double, 2>& taken,
                                   std::int64_t wanted, double distance, double min_strength);

// new_points.cpp
struct NewMatches {
    Array<std::int64_t, 1> slots;
    Array<double, 2> z;
    Array<double, 3> cov;
    Array<double, 2> slopes;
    Array<double, 1> apart;
    auto parts() { return std::tie(slots, z, cov, slopes, apart); }
};
template <class T>  // float or std::uint8_t
NewMatches match_new_points(const ImageOf<T>& left, const ImageOf<T>& right, const View<T, 3>& stored, const TemplateKind& kind,
                            const RightSides& right_sides, const Pixels& corners, const Indices& slots,
                            const View<double, 1>& disparity, double tolerance, double std_grey, double max_apart);
struct PlacedPoints {  // rows of those that are kept, their views, and their points with the variances of 1/Z
    Array<std::int64_t, 1> rows;
    Array<double, 2> z, points;
    Array<double, 1> var_rho;
    auto parts() { return std::tie(rows, z, points, var_rho); }
};
PlacedPoints place_new_points(const RightSides& right_sides, const Timing& timing, const View<double, 2>& seen,
                              const View<double, 3>& cov, double scale, double least_sigmas, double max_std);

// lasting.cpp
struct RowErrors {
    Array<std::int64_t, 1> ages;
    Array<double, 2> rows;
    Array<double, 1> sums;
    auto parts() { return std::tie(ages, rows, sums); }
};
RowErrors row_errors_of_tracks(const Indices& known, const Indices& ages, const View<double, 2>& rows, const Indices& ids,
                               const View<double, 2>& z, const View<double, 3>& cov, bool counts);
Array<double, 2> view_inflation(const Indices& ages, double ratio_left, double ratio_right, double decay);

// ids.cpp
Array<bool, 1> among(const Indices& ids, const Indices& known);
Array<std::int64_t, 1> times_among(const Indices& ids, const Indices& others, const View<bool, 1>& counted);
Array<std::int64_t, 1> union_of(const Indices& ids);

// png.cpp
Array<std::uint8_t, 2> unfilter_png(const View<std::uint8_t, 2>& filtered, std::size_t pixel);

// slant.cpp
template <class T>
Array<double, 2> disparity_slopes(const ImageOf<T>& left, const ImageOf<T>& right, const Pixels& points, const View<double, 2>& right_px,
                                  int radius, double std_grey);

// views.cpp
struct LinearisedViews {
    Array<double, 3> root;
    Array<double, 3> jacobian;
    auto parts() { return std::tie(root, jacobian); }
};
struct ViewResiduals {
    Array<double, 3> residuals;
    Array<double, 2> squares;
    auto parts() { return std::tie(residuals, squares); }
};
// Homogeneous points (n, 4) with covariances (0: they are exact) and their views; of each view a gate of its squared residual.
struct PointViews {
    Pinholes pinholes;
    View<double, 2> points;
    View<double, 3> cov_points;
    View<double, 2> z;
    View<double, 3> cov, shared;
    View<double, 1> gate;
};
// Some of them, in arrays of their own.
struct SelectedViews {
    Pinholes pinholes;
    Array<double, 2> points, z;
    Array<double, 3> cov_points, cov, shared;
    Array<double, 1> gate;

    SelectedViews(const PointViews& of, const std::vector<std::size_t>& rows);
    PointViews views() const {
        return {pinholes, points.view(), cov_points.view(), z.view(), cov.view(), shared.view(), gate.view()};
    }
};
Array<double, 2> project_points(const Pinholes& pinholes, const View<double, 2>& points);
Array<double, 2> seen_points(const Pinholes& pinholes, const View<double, 2>& z);
Array<double, 3> whitening_of_views(const View<double, 2>& z, const View<double, 3>& cov);
Array<double, 1> gates_of_views(const View<double, 2>& z, double of_one, double of_both);
LinearisedViews linearise_views(const PointViews& views, const View<double, 2>& cam_from_ref);
ViewResiduals view_residuals(const PointViews& views, const View<double, 3>& root, const View<double, 1>& amplitudes,
                             const View<double, 3>& cams_from_ref);
struct MotionStep {
    Array<double, 1> step;
    Array<double, 2> information;
};
MotionStep motion_step(const View<double, 3>& jacobian, const View<double, 2>& residuals, const View<double, 1>& weights,
                       const View<double, 1>& amplitudes);

// fit.cpp
struct Fitted {
    Array<double, 2> cam_from_ref, cov_pose;
    Array<bool, 1> accepted;
    double chi2 = 0;
    std::int64_t dof = -6;
    double spread = 1;
    bool ok = false;
    Array<double, 1> squares;
    double share = 0;
    Array<double, 1> amplitudes;
    Array<double, 2> cov_amplitudes;

    Fitted(std::size_t n, std::size_t j)
        : cam_from_ref({4, 4}), cov_pose({6, 6}), accepted({n}), squares({n}), amplitudes({j}), cov_amplitudes({j, j}) {}
    auto parts() { return std::tie(cam_from_ref, cov_pose, accepted, chi2, dof, spread, ok, squares, share, amplitudes, cov_amplitudes); }
};
Fitted fit_motion(const PointViews& views, const View<double, 2>& start, const View<double, 1>& amplitudes,
                  const View<double, 1>& votes, bool anneal);
struct Halves {
    double apart;
    Array<double, 3> motions;
};
Halves motions_of_halves(const PointViews& views, const View<double, 2>& motion, const View<double, 1>& amplitudes,
                         const View<bool, 1>& accepted, double shared_noise);

// search.cpp
Array<double, 2> search_motion(const PointViews& views, const View<double, 2>& start, const View<double, 1>& weights,
                               const std::array<double, 2>& image_size, std::size_t agreeing);
double motion_support(const PointViews& views, const View<double, 2>& motion, const View<double, 1>& amplitudes,
                      const View<double, 1>& weights, const std::array<double, 2>& size);
double evidence(const Pinholes& pinholes, const View<double, 2>& z, const View<double, 1>& weights, const std::array<double, 2>& size);

// resection.cpp
// Size of the image; below which share of the votes the global search is made; how many gates off a view clearly disagrees, how
// many of such make a second motion, and from which share of the evidence on it makes the first one ambiguous; and of the start
// whether it is one that most views agree with already, and whether no motion of other views is looked for.
struct ResectionRules {
    std::array<double, 2> size;
    double calm_share, beyond;
    std::size_t second_views;
    double ambiguous_share;
    bool start_is_close, start_is_decided;
};
struct Second {
    Array<double, 2> cam_from_ref, cov_pose;
    Array<bool, 1> views;
    double odds;
    auto parts() { return std::tie(cam_from_ref, cov_pose, views, odds); }
};
struct Resected {
    Fitted found;
    std::optional<Second> second;
    auto parts() { return std::tie(found, second); }
};
struct FlowMotion {
    bool ok;
    Array<double, 2> cam_from_previous;
    Array<bool, 1> agree;
    double share;
    auto parts() { return std::tie(ok, cam_from_previous, agree, share); }
};
FlowMotion motion_of_flow(const Pinholes& pinholes, const TrackTable& tracks, const View<double, 1>& votes, const View<double, 2>& at,
                          const View<bool, 1>& found, const View<double, 2>& start, double std_flow, double gate,
                          const ResectionRules& rules);
Resected resect(const PointViews& views, const View<double, 2>& start, const View<double, 1>& votes, const ResectionRules& rules,
                const std::optional<View<double, 2>>& predicted);

// turn.cpp
// Right positions (n, 2) with a turn (3,) of the right camera put in (sign 1) or taken out (-1).
void turn_by(const Pinholes& pinholes, const View<double, 1>& rad, double sign, Array<double, 2>& right);
struct FittedTurn {
    Array<double, 1> rad;
    Array<bool, 1> agree;
    double log_odds, squared;
    auto parts() { return std::tie(rad, agree, log_odds, squared); }
};
Array<double, 3> effects_of_turn(const Pinholes& pinholes, const View<double, 2>& right);
FittedTurn fit_turn(const PointViews& views, const View<double, 2>& motion, const View<double, 2>& usual, double std_knock);

// rig.cpp
constexpr std::size_t TERMS = 20, AT_TIMING = 14;  // the order of rig_model/terms.py; delay and readout follow each other
void check(const ExposedRows& exposed);
struct RigModel {
    Pinholes pinholes;
    std::array<double, 2> size;
    View<double, 2> root;  // of the terms: units per amplitude
    Field field;
};
struct RigEffects {
    Array<double, 3> terms;
    Array<double, 2> field;
    auto parts() { return std::tie(terms, field); }
};
RigEffects rig_effects(const RigModel& model, const View<double, 2>& z, const View<double, 1>& age);
Array<double, 2> field_basis(const Field& field, const View<double, 2>& at);
Array<double, 2> polynomial_rows(const ExposedRows& exposed, const View<double, 2>& z);
Array<double, 2> velocities(const Pinholes& pinholes, const View<double, 2>& points, const View<double, 2>& twists);
Array<double, 1> row_speeds(const Pinholes& pinholes, const View<double, 2>& points, const View<double, 1>& twist);
// ∂(row)/∂(u, v) on the left and on the right (4,) of a view.
void slopes_of_rows(const ExposedRows& of, const double* z, double* out);
// To a view at z of a homogeneous point with a motion (2, 6), per second of delay and of readout (4, 2), near a `timing` (2,).
void timing_of_view(const Pinholes& pinholes, const ExposedRows& exposed, const double* point, const double* motion,
                    const double* timing, const double* z, double* out);
Array<double, 3> timed_views(const Pinholes& pinholes, const ExposedRows& exposed, const View<double, 2>& points,
                             const View<double, 2>& motion, const View<double, 1>& timing, const std::optional<View<double, 2>>& z);
Array<double, 2> shifts_by_timing(const Pinholes& pinholes, const ExposedRows& exposed, const View<double, 2>& points,
                                  const View<double, 1>& twist, const View<double, 1>& mean);
struct MovingPoints {  // homogeneous points (n, 4), and their twist (6,)
    View<double, 2> points;
    View<double, 1> twist;
};
Array<double, 3> timing_unknowns(const Pinholes& pinholes, const ExposedRows& exposed, const MovingPoints& before,
                                 const MovingPoints& now, const View<double, 1>& mean, const View<double, 2>& cov,
                                 const View<double, 1>& std_twist);
Array<double, 2> cov_of_timed_pose(const Pinholes& pinholes, const ExposedRows& exposed, const View<double, 2>& points,
                                   const View<double, 1>& size, const View<double, 2>& cov_twist);
// Errors (n, k) as independent ones (n, j), of σ = 1 as they are, without those that do not matter beside a good view's noise.
Array<double, 2> principal_components(const View<double, 2>& errors);
Array<double, 3> principal_errors(const View<double, 3>& errors);  // of views (n, 4, k)

// reported.cpp
struct PhysicalAxes {  // rotation (3, 3) of points into them, and σ of lengths and of axes that no view shows
    View<double, 2> rotation;
    double std_scale, std_axes;
};
struct ReportedMotions {
    Array<double, 3> poses, cov, jacobian;
    auto parts() { return std::tie(poses, cov, jacobian); }
};
ReportedMotions reported_motions(const PhysicalAxes& axes, const View<double, 3>& poses, const View<double, 3>& cov,
                                 const View<double, 3>& by_terms);
struct ReportedPoints {
    Array<double, 2> points;
    Array<double, 3> cov;
    auto parts() { return std::tie(points, cov); }
};
ReportedPoints reported_points(const PhysicalAxes& axes, const View<double, 2>& points, const View<double, 3>& cov,
                               const View<double, 1>& std_shared, const View<double, 2>& frame_from_cam);

// poses.cpp
Array<double, 3> pose_exp(const View<double, 2>& xi);
Array<double, 2> pose_log(const View<double, 3>& poses);
Array<double, 3> pose_inverse(const View<double, 3>& poses);
Array<double, 3> pose_adjoint(const View<double, 3>& poses);
Array<double, 3> point_motions(const View<double, 3>& poses, const View<double, 1>& seconds);
Array<double, 2> rotation_vectors(const View<double, 3>& rotations);
Array<double, 2> quaternions(const View<double, 3>& rotations);
Array<double, 3> orthonormalise(const View<double, 3>& poses);

// mixture.cpp
struct Mixture {
    Array<double, 1> mean;
    Array<double, 2> cov;
    double p_wrong;
    auto parts() { return std::tie(mean, cov, p_wrong); }
};
Array<double, 2> log_evidence(const View<double, 1>& information, const View<double, 1>& weighted, const View<double, 1>& variances);
Mixture rig_mixture(const View<double, 1>& mean, const View<double, 2>& cov, const View<double, 1>& size, std::size_t lenses,
                    const View<bool, 2>& is_zero, const View<double, 1>& log_prior, double counts, bool known_wrong);

// dense.cpp
Array<double, 3> whiten_blocks(const View<double, 3>& cov, const View<double, 3>& b);
Array<double, 2> invert_triangle(const View<double, 2>& lower, const View<double, 1>& scale);
struct Scaled {
    Array<double, 2> matrix;
    Array<double, 1> scale;
    auto parts() { return std::tie(matrix, scale); }
};
Scaled scaled_by_diagonal(const View<double, 2>& matrix);

// window.cpp
struct WindowState {
    View<double, 3> cams_from_ref;
    Indices ids;
    View<double, 3> ref_from_anchor;
    View<double, 2> q;
    View<double, 1> rig_error;
};
struct WindowViews {
    Indices frame, ids;
    View<bool, 1> used;
    View<double, 2> z, weight;
    View<double, 3> root, terms, timing;  // what delay and readout do is added to their terms: it is renewed with the velocities
    View<double, 2> field, moves;
};
struct NormalBlocks {
    Array<double, 3> u, v, w;
    Array<double, 2> g_pose, g_point, rig;
    Array<double, 3> rig_pose, rig_point;
    Array<double, 1> g_rig;
    auto parts() { return std::tie(u, v, w, g_pose, g_point, rig, rig_pose, rig_point, g_rig); }
};
Array<double, 2> points_of_views(const WindowState& state, const WindowViews& views);
Array<double, 2> expected_views(const Pinholes& pinholes, const WindowState& state, const WindowViews& views,
                                const View<bool, 1>& stereo, const View<double, 2>& expected);
Array<double, 3> timing_of_views(const Pinholes& pinholes, const ExposedRows& exposed, const WindowState& state,
                                 const WindowViews& views, const View<double, 2>& expected,
                                 const View<double, 3>& motions, const View<double, 1>& timing);
Array<double, 3> q_by_reference(const View<double, 3>& ref_from_anchor, const View<double, 2>& q);
struct SeenAgain {
    Array<std::int64_t, 1> rows;
    Array<double, 2> points;
    Array<double, 3> cov;
    auto parts() { return std::tie(rows, points, cov); }
};
SeenAgain points_seen_again(const Indices& ids, const View<bool, 1>& usable, const View<double, 2>& var_drift, const Indices& known,
                            const View<double, 2>& q, const View<double, 3>& cov_q);
Array<double, 3> drift_covariances(const Indices& ids, const View<double, 3>& ref_from_anchor, const View<double, 2>& q,
                                   const Indices& seen, const View<double, 2>& var_drift);
Array<bool, 1> views_within_gates(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, double of_one,
                                  double of_both);
NormalBlocks normal_blocks(const Pinholes& pinholes, const WindowState& state, const WindowViews& views);

// elimination.cpp
struct BlockViews {
    View<double, 3> u, v, w;
    View<double, 2> g_pose, g_point, rig;
    View<double, 3> rig_pose, rig_point;
    View<double, 1> g_rig;
};
struct PriorViews {
    Indices known;
    View<double, 2> mean;
    View<double, 3> cov, modes;
    View<double, 2> information;  // about the rig's errors, and the weighted sums of their amplitudes
    View<double, 1> weighted;
};
struct EliminatedPoints {
    Array<double, 3> root, reach;
    auto parts() { return std::tie(root, reach); }
};
struct WindowSystem {
    Array<double, 2> h;
    Array<double, 3> modes, std_given, reach;
    Array<double, 2> given;
    Array<double, 1> g;
    auto parts() { return std::tie(h, modes, std_given, reach, given, g); }
};
EliminatedPoints eliminate_points(const View<double, 3>& v, const View<double, 3>& w);
WindowSystem window_system(const BlockViews& blocks, const PriorViews& prior, const View<double, 2>& q,
                           const View<double, 1>& amplitudes);

// absorb.cpp
struct PointsAlone {
    Array<double, 2> mean;
    Array<double, 3> cov, by_rig;
    auto parts() { return std::tie(mean, cov, by_rig); }
};
struct NewPriorPoints {
    Indices ids;
    View<double, 2> mean;
    View<double, 3> cov, by_rig;
};
struct LeavingViews {
    Array<std::int64_t, 1> rows;
    Array<bool, 1> stays;
    Array<double, 3> cov, anchors;
    Array<double, 2> q;
    NormalBlocks blocks;
    Array<std::int64_t, 1> fresh;
    PointsAlone alone;
    auto parts() { return std::tie(rows, stays, cov, anchors, q, blocks, fresh, alone); }
};
struct AbsorbedPoints {
    Array<std::int64_t, 1> ids;
    Array<double, 2> mean;
    Array<double, 3> cov, modes;
    auto parts() { return std::tie(ids, mean, cov, modes); }
};
PointsAlone points_alone(const View<double, 3>& v, const View<double, 2>& g_point, const View<double, 3>& rig_point,
                         const View<double, 2>& q, const View<double, 1>& rig_step);
LeavingViews leaving_views(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, const View<bool, 1>& stereo,
                           const View<double, 2>& var_drift, const View<bool, 1>& seen_later, const Indices& known,
                           const View<double, 3>& cov);
WindowSystem absorbing_system(const BlockViews& blocks, const PriorViews& prior, const View<double, 3>& anchors, const View<double, 2>& q,
                              const View<double, 1>& amplitudes);
AbsorbedPoints absorbed_points(const Indices& ids, const View<double, 3>& std_given, const View<double, 3>& moved,
                               const View<double, 2>& given, const View<double, 2>& q, const View<bool, 1>& stays,
                               const NewPriorPoints& fresh);

// marginals.cpp
struct CovariancePart {  // of points, the pose and the world: what reaches points, also times its covariance, and times those with both
    View<double, 3> reach, covariant, with_both;
    View<double, 2> both;
};
struct PointMarginals {
    Array<double, 2> q_in_cam;
    Array<double, 3> cov_q_in_cam;
    Array<double, 2> points_in_cam;
    Array<double, 3> cov_points;
    Array<double, 2> points_in_world;
    Array<double, 3> cov_points_in_world;
    Array<bool, 1> finite;
    auto parts() { return std::tie(q_in_cam, cov_q_in_cam, points_in_cam, cov_points, points_in_world, cov_points_in_world, finite); }
};
PointMarginals point_marginals(const View<double, 3>& ref_from_anchor, const View<double, 2>& q_in_anchor,
                               const View<double, 3>& std_given, const CovariancePart& own, const CovariancePart& of_rig,
                               const View<double, 2>& world_from_ref, const View<double, 2>& cam_from_ref, double known_sigmas);

}  // namespace core
