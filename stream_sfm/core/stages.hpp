// The stages of the core, one file each; `_core.pyi` documents them as Python calls them. `parts` of a record are what
// Python gives or is given, in this order.
#pragma once

#include "algebra.hpp"
#include "image.hpp"
#include "pinholes.hpp"

namespace core {

// rows.cpp
struct RowMatches {
    Array<double, 1> disparity;
    Array<bool, 1> unique;
    auto parts() { return std::tie(disparity, unique); }
};
template <class T>  // float or std::uint8_t
RowMatches match_along_rows(const ImageOf<T>& left, const ImageOf<T>& right, Pixels points, std::int64_t first,
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
template <class T>  // float or std::uint8_t
void store_patches(T* stored, const std::array<std::size_t, 3>& shape, const ImageOf<T>& image, Pixels points, Indices slots);
template <class T>
Patches warp_patches(View<T, 3> stored, Indices slots, Matrices warps, int radius, int spacing);
template <class T>
AlignedPatches align_patches(const ImageOf<T>& image, Matrix starts, View<float, 3> inverse, Matrices information,
                             View<float, 1> level, int radius, int spacing);
Array<double, 3> gradient_matrices(Matrices information, int spacing);

// row_errors.cpp
struct Field {
    Vector u, v;
    double length;
    Matrix root;
    auto parts() { return std::tie(u, v, length, root); }
};
struct RowModel {
    std::array<double, 2> size;
    Field field;
    Vector mean;
    Matrix cov;
    double scatter, max;
    auto parts() { return std::tie(size, field, mean, cov, scatter, max); }
};
Array<double, 2> row_terms(const std::array<double, 2>& size, const Field& field, Matrix at, Vector speed);
Array<double, 1> row_offsets(const RowModel& rows, Matrix at, Vector speed);
Array<bool, 1> on_one_row(const RowModel& rows, Matrix left, Matrix right, Vector speed, double scale);
struct RightSides {  // where they are sought, of points that move with a twist, with a turn of the right camera
    Pinholes pinholes;
    RowModel rows;
    Vector turn, twist;
    auto parts() { return std::tie(pinholes, rows, turn, twist); }
};
struct UnknownOfViews {
    Array<double, 3> errors;
    Array<double, 2> cov_turn;
    auto parts() { return std::tie(errors, cov_turn); }
};
struct ExposedRows {  // polynomials over the rectified image: the rows of the cameras' own images
    std::array<double, 2> size;
    Matrices coefficients;
    auto parts() { return std::tie(size, coefficients); }
};
struct Timing {  // delay and readout, and how points moved in the frame before
    ExposedRows exposed;
    Vector mean;
    Matrix cov;
    Vector twist;
    auto parts() { return std::tie(exposed, mean, cov, twist); }
};
UnknownOfViews unknown_errors(const Pinholes& pinholes, const Timing& timing, const RowModel& rows, Matrix before,
                              Matrix now, Matrix z, Vector twist, Vector std_twist);

struct TemplateKind {
    int scale, radius, spacing;
    double farthest, max_error, shared_pixels, factor;
    auto parts() { return std::tie(scale, radius, spacing, farthest, max_error, shared_pixels, factor); }
};
// tracks.cpp
struct TrackTable {
    Matrix points;  // at unit depth
    Vector var_rho;
    Matrices cov_left, anchor_from_start;
    Matrix anchor_velocity, slopes;
    Indices scale;
    auto parts() { return std::tie(points, var_rho, cov_left, anchor_from_start, anchor_velocity, slopes, scale); }
};
struct PredictedTracks {
    Array<double, 2> points, left;
    Array<double, 1> right_u;
    Array<double, 3> left_warps, right_warps;
    auto parts() { return std::tie(points, left, right_u, left_warps, right_warps); }
};
PredictedTracks predict_tracks(const Pinholes& pinholes, const Timing& timing, Vector twist, const TrackTable& tracks,
                               Matrix cam_from_previous, Matrix cam_from_start, Matrix left, Flags agree);
struct UpdatedTracks {
    Array<double, 2> points;
    Array<double, 1> var_rho;
    Array<double, 3> cov_left;
    auto parts() { return std::tie(points, var_rho, cov_left); }
};
UpdatedTracks update_depths(const Pinholes& pinholes, const TrackTable& tracks, Matrix cam_from_previous, Matrix z,
                            Matrices cov, double forgetting);
Array<bool, 1> templates_fit(Matrices warps, double radius, double half);
Array<bool, 1> inside_area(View<bool, 2> area, Matrix at);
Array<double, 3> view_covariances(Matrices gradients, Vector error_left, Vector error_right, double shared_pixels,
                                  double scale, double factor);
Array<double, 3> track_covariances(Matrices cov_left, Vector var_rho, Vector drift, double focal, double baseline);
Array<double, 1> template_drift(Matrix points, Matrix cam_from_previous, Indices scale, double radius);

// alignment.cpp
template <class T>  // float or std::uint8_t
struct Templates {
    ImageOf<T> left;
    std::optional<ImageOf<T>> right;
    View<T, 3> stored;
    View<bool, 2> area;
    TemplateKind kind;
    auto parts() { return std::tie(left, right, stored, area, kind); }
};
struct AlignedTracks {  // of tracks (n) which were expected in view, and of those found (k) their rows, points and views
    Array<bool, 1> expected;
    Array<std::int64_t, 1> rows;
    Array<double, 2> points, z;
    Array<double, 3> cov;
    Array<double, 2> any_row, taken;
    auto parts() { return std::tie(expected, rows, points, z, cov, any_row, taken); }
};
AlignedTracks align_tracks(const RightSides& right_sides, const Timing& timing, const TrackTable& tracks, Indices slots,
                           Matrix cam_from_previous, Matrix cam_from_start, Matrix left, Flags agree,
                           const Templates<std::uint8_t>& ordinary, const std::optional<Templates<float>>& wide);

// corners.cpp
template <class T>
Array<float, 2> corner_strength(const ImageOf<T>& image);
Array<std::int64_t, 2> new_corners(const Image& strength, View<bool, 2> allowed, Matrix taken, std::int64_t wanted,
                                   double distance, double min_strength);

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
NewMatches match_new_points(const ImageOf<T>& left, const ImageOf<T>& right, View<T, 3> stored,
                            const TemplateKind& kind, const RightSides& right_sides, Pixels corners, Indices slots,
                            Vector disparity, double tolerance, double std_grey, double max_apart);
struct PlacedPoints {  // rows of those that are kept, their views, and their points with the variances of 1/Z
    Array<std::int64_t, 1> rows;
    Array<double, 2> z, points;
    Array<double, 1> var_rho;
    auto parts() { return std::tie(rows, z, points, var_rho); }
};
PlacedPoints place_new_points(const RightSides& right_sides, const Timing& timing, Matrix seen, Matrices cov,
                              double scale, double least_sigmas, double max_std);

// lasting.cpp
struct RowErrors {
    Array<std::int64_t, 1> ages;
    Array<double, 2> rows;
    Array<double, 1> sums;
    auto parts() { return std::tie(ages, rows, sums); }
};
RowErrors row_errors_of_tracks(Indices known, Indices ages, Matrix rows, Indices ids, Matrix z, Matrices cov,
                               bool counts);
Array<double, 2> view_inflation(Indices ages, double ratio_left, double ratio_right, double decay);

// png.cpp
Array<std::uint8_t, 2> unfilter_png(View<std::uint8_t, 2> filtered, std::size_t pixel);

// slant.cpp
template <class T>
Array<double, 2> disparity_slopes(const ImageOf<T>& left, const ImageOf<T>& right, Pixels points, Matrix right_px,
                                  int radius, double std_grey);
std::vector<std::size_t> slanted_rows(Matrix slopes);  // those that do not face the camera

// views.cpp
struct LinearisedViews {
    Array<double, 3> root, jacobian;
    auto parts() { return std::tie(root, jacobian); }
};
struct ViewResiduals {
    Array<double, 3> residuals;
    Array<double, 2> squares;
    auto parts() { return std::tie(residuals, squares); }
};
struct PointViews {
    Pinholes pinholes;
    Matrix points;
    Matrices cov_points;
    Matrix z;
    Matrices cov, shared;
    Vector gate;
    auto parts() { return std::tie(pinholes, points, cov_points, z, cov, shared, gate); }
};
// Some views, in arrays of their own.
struct SelectedViews {
    Pinholes pinholes;
    Array<double, 2> points, z;
    Array<double, 3> cov_points, cov, shared;
    Array<double, 1> gate;

    SelectedViews(const PointViews& of, const std::vector<std::size_t>& rows);
    PointViews views() const { return {pinholes, points, cov_points, z, cov, shared, gate}; }
};
Array<double, 2> project_points(const Pinholes& pinholes, Matrix points);
Array<double, 2> seen_points(const Pinholes& pinholes, Matrix z);
Array<double, 3> whitening_of_views(Matrix z, Matrices cov);
Array<double, 1> gates_of_views(Matrix z, double of_one, double of_both);
LinearisedViews linearise_views(const PointViews& views, Matrix cam_from_ref);
ViewResiduals view_residuals(const PointViews& views, Matrices root, Vector amplitudes, Matrices cams_from_ref);

// fit.cpp
struct Fitted {
    Array<double, 2> cam_from_ref, cov_pose, cov_amplitudes;
    Array<double, 1> squares, amplitudes;
    Array<bool, 1> accepted;
    std::int64_t dof = -6;
    double chi2 = 0, spread = 1, share = 0;
    bool ok = false;

    Fitted(std::size_t n, std::size_t j)
        : cam_from_ref(4, 4), cov_pose(6, 6), cov_amplitudes(j, j), squares(n), amplitudes(j), accepted(n) {}
    auto parts() { return std::tie(cam_from_ref, cov_pose, accepted, chi2, dof, spread, ok, squares, share, amplitudes, cov_amplitudes); }
};
Fitted fit_motion(const PointViews& views, Matrix start, Vector amplitudes, Vector votes, bool anneal);
struct Halves {
    double apart;
    Array<double, 3> motions;
};
Halves motions_of_halves(const PointViews& views, Matrix motion, Vector amplitudes, Flags accepted,
                         double shared_noise);

// search.cpp
Array<double, 2> search_motion(const PointViews& views, Matrix start, Vector weights,
                               const std::array<double, 2>& image_size, std::size_t agreeing);
double motion_support(const PointViews& views, Matrix motion, Vector amplitudes, Vector weights,
                      const std::array<double, 2>& size);
double evidence(const Pinholes& pinholes, Matrix z, Vector weights, const std::array<double, 2>& size);

// resection.cpp
struct ResectionRules {
    std::array<double, 2> size;
    double calm_share, beyond;
    std::size_t second_views;
    double ambiguous_share;
    bool start_is_close, start_is_decided;
    auto parts() { return std::tie(size, calm_share, beyond, second_views, ambiguous_share, start_is_close, start_is_decided); }
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
FlowMotion motion_of_flow(const Pinholes& pinholes, const TrackTable& tracks, Vector votes, Matrix at, Flags found,
                          Matrix start, double std_flow, double gate, const ResectionRules& rules);
Resected resect(const PointViews& views, Matrix start, Vector votes, const ResectionRules& rules,
                std::optional<Matrix> predicted);

// turn.cpp
// Right positions (n, 2) with a turn (3,) of the right camera put in (sign 1) or taken out (-1).
void turn_by(const Pinholes& pinholes, Vector rad, double sign, Array<double, 2>& right);
struct FittedTurn {
    Array<double, 1> rad;
    Array<bool, 1> agree;
    double log_odds, squared;
    auto parts() { return std::tie(rad, agree, log_odds, squared); }
};
Array<double, 3> effects_of_turn(const Pinholes& pinholes, Matrix right);
FittedTurn fit_turn(const PointViews& views, Matrix motion, Matrix usual, double std_knock);

// rig.cpp
constexpr std::size_t TERMS = 20, AT_TIMING = 14;  // the order of rig_model/terms.py; delay and readout follow each other
void check(const ExposedRows& exposed);
struct RigModel {
    Pinholes pinholes;
    std::array<double, 2> size;
    Matrix root;  // of the terms: units per amplitude
    Field field;
    auto parts() { return std::tie(pinholes, size, root, field); }
};
struct RigEffects {
    Array<double, 3> terms;
    Array<double, 2> field;
    auto parts() { return std::tie(terms, field); }
};
RigEffects rig_effects(const RigModel& model, Matrix z, Vector age);
Array<double, 2> field_basis(const Field& field, Matrix at);
Array<double, 2> polynomial_rows(const ExposedRows& exposed, Matrix z);
Array<double, 2> velocities(const Pinholes& pinholes, Matrix points, Matrix twists);
Array<double, 1> row_speeds(const Pinholes& pinholes, Matrix points, Vector twist);
// ∂(row)/∂(u, v) on the left and on the right (4,) of a view.
void slopes_of_rows(const ExposedRows& of, const double* z, double* out);
// To a view at z of a homogeneous point with a motion (2, 6), per second of delay and of readout (4, 2), near a `timing` (2,).
void timing_of_view(const Pinholes& pinholes, const ExposedRows& exposed, const double* point, const double* motion,
                    const double* timing, const double* z, double* out);
Array<double, 3> timed_views(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Matrix motion,
                             Vector timing, std::optional<Matrix> z);
Array<double, 2> shifts_by_timing(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Vector twist,
                                  Vector mean);
struct MovingPoints {
    Matrix points;
    Vector twist;
    auto parts() { return std::tie(points, twist); }
};
Array<double, 3> timing_unknowns(const Pinholes& pinholes, const ExposedRows& exposed, const MovingPoints& before,
                                 const MovingPoints& now, Vector mean, Matrix cov, Vector std_twist);
Array<double, 2> cov_of_timed_pose(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Vector size,
                                   Matrix cov_twist);
// Errors (n, k) as independent ones (n, j), of σ = 1 as they are, without those that do not matter beside a good view's noise.
Array<double, 2> principal_components(Matrix errors);
Array<double, 3> principal_errors(Matrices errors);  // of views (n, 4, k)

// reported.cpp
struct PhysicalAxes {
    Matrix rotation;
    double std_scale, std_axes;
    auto parts() { return std::tie(rotation, std_scale, std_axes); }
};
struct ReportedMotions {
    Array<double, 3> poses, cov, jacobian;
    auto parts() { return std::tie(poses, cov, jacobian); }
};
ReportedMotions reported_motions(const PhysicalAxes& axes, Matrices poses, Matrices cov, Matrices by_terms);
struct ReportedPoints {
    Array<double, 2> points;
    Array<double, 3> cov;
    auto parts() { return std::tie(points, cov); }
};
ReportedPoints reported_points(const PhysicalAxes& axes, Matrix points, Matrices cov, Vector std_shared,
                               Matrix frame_from_cam);

// poses.cpp
Array<double, 3> pose_exp(Matrix xi);
Array<double, 2> pose_log(Matrices poses);
Array<double, 3> pose_inverse(Matrices poses);
Array<double, 3> pose_adjoint(Matrices poses);
Array<double, 3> point_motions(Matrices poses, Vector seconds);
Array<double, 2> rotation_vectors(Matrices rotations);
Array<double, 2> quaternions(Matrices rotations);
Array<double, 3> orthonormalise(Matrices poses);

// mixture.cpp
struct Mixture {
    Array<double, 1> mean;
    Array<double, 2> cov;
    double p_wrong;
    auto parts() { return std::tie(mean, cov, p_wrong); }
};
Array<double, 2> log_evidence(Vector information, Vector weighted, Vector variances);
Mixture rig_mixture(Vector mean, Matrix cov, Vector size, std::size_t lenses, View<bool, 2> is_zero, Vector log_prior,
                    double counts, bool known_wrong);

// arrays.cpp
Array<double, 3> whiten_blocks(Matrices cov, Matrices b);
Array<double, 2> invert_triangle(Matrix lower, Vector scale);
struct Scaled {
    Array<double, 2> matrix;
    Array<double, 1> scale;
    auto parts() { return std::tie(matrix, scale); }
};
Scaled scaled_by_diagonal(Matrix matrix);
Array<bool, 1> among(Indices ids, Indices known);
Array<std::int64_t, 1> times_among(Indices ids, Indices others, Flags counted);
Array<std::int64_t, 1> union_of(Indices ids);

// window.cpp
struct WindowState {
    Matrices cams_from_ref;
    Indices ids;
    Matrices ref_from_anchor;
    Matrix q;
    Vector rig_error;
    auto parts() { return std::tie(cams_from_ref, ids, ref_from_anchor, q, rig_error); }
};
struct WindowViews {
    Indices frame, ids;
    Flags used;
    Matrix z, weight;
    Matrices root, terms, timing;  // what delay and readout do is added to their terms: it is renewed with the velocities
    Matrix field, moves;
    auto parts() { return std::tie(frame, ids, used, z, weight, root, terms, timing, field, moves); }
};
struct NormalBlocks {
    Array<double, 3> u, v, w, rig_pose, rig_point;
    Array<double, 2> g_pose, g_point, rig;
    Array<double, 1> g_rig;
    auto parts() { return std::tie(u, v, w, g_pose, g_point, rig, rig_pose, rig_point, g_rig); }
};
Array<double, 2> points_of_views(const WindowState& state, const WindowViews& views);
Array<double, 2> expected_views(const Pinholes& pinholes, const WindowState& state, const WindowViews& views,
                                Flags stereo, Matrix expected);
Array<double, 3> timing_of_views(const Pinholes& pinholes, const ExposedRows& exposed, const WindowState& state,
                                 const WindowViews& views, Matrix expected, Matrices motions, Vector timing);
Array<double, 3> q_by_reference(Matrices ref_from_anchor, Matrix q);
struct SeenAgain {
    Array<std::int64_t, 1> rows;
    Array<double, 2> points;
    Array<double, 3> cov;
    auto parts() { return std::tie(rows, points, cov); }
};
SeenAgain points_seen_again(Indices ids, Flags usable, Matrix var_drift, Indices known, Matrix q, Matrices cov_q);
Array<double, 3> drift_covariances(Indices ids, Matrices ref_from_anchor, Matrix q, Indices seen, Matrix var_drift);
Array<bool, 1> views_within_gates(const Pinholes& pinholes, const WindowState& state, const WindowViews& views,
                                  double of_one, double of_both);
NormalBlocks normal_blocks(const Pinholes& pinholes, const WindowState& state, const WindowViews& views);

// elimination.cpp
struct BlockViews {
    Matrices u, v, w;
    Matrix g_pose, g_point, rig;
    Matrices rig_pose, rig_point;
    Vector g_rig;
    auto parts() { return std::tie(u, v, w, g_pose, g_point, rig, rig_pose, rig_point, g_rig); }
};
struct PriorViews {
    Indices known;
    Matrix mean;
    Matrices cov, modes;
    Matrix information;  // about the rig's errors, and the weighted sums of their amplitudes
    Vector weighted;
    auto parts() { return std::tie(known, mean, cov, modes, information, weighted); }
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
EliminatedPoints eliminate_points(Matrices v, Matrices w);
WindowSystem window_system(const BlockViews& blocks, const PriorViews& prior, Matrix q, Vector amplitudes);

// absorb.cpp
struct PointsAlone {
    Array<double, 2> mean;
    Array<double, 3> cov, by_rig;
    auto parts() { return std::tie(mean, cov, by_rig); }
};
struct NewPriorPoints {
    Indices ids;
    Matrix mean;
    Matrices cov, by_rig;
    auto parts() { return std::tie(ids, mean, cov, by_rig); }
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
PointsAlone points_alone(Matrices v, Matrix g_point, Matrices rig_point, Matrix q, Vector rig_step);
LeavingViews leaving_views(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, Flags stereo,
                           Matrix var_drift, Flags seen_later, Indices known, Matrices cov);
WindowSystem absorbing_system(const BlockViews& blocks, const PriorViews& prior, Matrices anchors, Matrix q,
                              Vector amplitudes);
AbsorbedPoints absorbed_points(Indices ids, Matrices std_given, Matrices moved, Matrix given, Matrix q, Flags stays,
                               const NewPriorPoints& fresh);

// marginals.cpp
struct CovariancePart {  // of points, the pose and the world: what reaches points, also times its covariance, and times those with both
    Matrices reach, covariant, with_both;
    Matrix both;
    auto parts() { return std::tie(reach, covariant, with_both, both); }
};
struct PointMarginals {
    Array<double, 2> q_in_cam, points_in_cam, points_in_world;
    Array<double, 3> cov_q_in_cam, cov_points, cov_points_in_world;
    Array<bool, 1> finite;
    auto parts() { return std::tie(q_in_cam, cov_q_in_cam, points_in_cam, cov_points, points_in_world, cov_points_in_world, finite); }
};
PointMarginals point_marginals(Matrices ref_from_anchor, Matrix q_in_anchor, Matrices std_given,
                               const CovariancePart& own, const CovariancePart& of_rig, Matrix world_from_ref,
                               Matrix cam_from_ref, double known_sigmas);

// inertial.cpp
struct Preintegrated {  // rotation, (velocity, position), by the biases and the clock, covariances by both sensors
    Array<double, 2> rotation{3, 3}, motion{2, 3}, by_bias{9, 6}, by_clock{3, 3}, cov_gyro{9, 9}, cov_accel{9, 9};
    auto parts() { return std::tie(rotation, motion, by_bias, by_clock, cov_gyro, cov_accel); }
};
struct IntervalViews {  // intervals in a row, at the biases and the clock offset that they were integrated with
    Matrices rotation;
    Matrix motion;
    Matrices by_bias;
    Matrix by_clock;
    Matrices cov;
    Matrix biases;
    Vector clock, seconds;
    auto parts() { return std::tie(rotation, motion, by_bias, by_clock, cov, biases, clock, seconds); }
};
struct InertialRows {
    Array<double, 1> residual;
    Array<double, 2> jacobian;
    auto parts() { return std::tie(residual, jacobian); }
};
struct InertialMotion {
    Array<double, 2> previous_from_now{4, 4};
    Array<double, 1> state{17};
    auto parts() { return std::tie(previous_from_now, state); }
};
Preintegrated preintegrate(Vector seconds, Matrix gyro, Matrix accel, Vector widened, Vector biases, Vector densities);
InertialRows inertial_rows(const IntervalViews& of, Matrices cams, Matrix velocities, Vector state, Matrix cam_from_imu);
InertialMotion inertial_motion(const IntervalViews& of, Vector state, Matrix cam_from_imu);

}  // namespace core
