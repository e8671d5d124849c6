// Stages of the window: its normal equations, the prior, and the marginals of points.
#pragma once

#include "algebra.hpp"
#include "pinholes.hpp"

namespace core {

// window.cpp
struct WindowState {
    Matrices cams_from_ref;
    Indices ids;
    Matrices ref_from_anchor;
    Matrix q;
    Vector rig_error;
    Matrix own;  // amplitudes of the errors that the views of each frame share
    RECORD(WindowState, cams_from_ref, ids, ref_from_anchor, q, rig_error, own)
};
struct WindowViews {
    Indices frame, ids;
    Flags used;
    Matrix z_px, weight;
    Matrices root, own, terms, timing;  // `timing` is added to the terms of delay and readout, and renewed with the velocities
    Matrix field, moves;
    RECORD(WindowViews, frame, ids, used, z_px, weight, root, own, terms, timing, field, moves)
};
template <template <class, std::size_t> class Of>
struct BlocksOf {  // with 6 + e columns per frame: its pose, and e amplitudes of its own with a prior of σ = 1
    Of<double, 3> u, v, w, rig_pose, rig_point;
    Of<double, 2> g_pose, g_point, rig;
    Of<double, 1> g_rig;
    RECORD(NormalBlocks, u, v, w, g_pose, g_point, rig, rig_pose, rig_point, g_rig)
};
using NormalBlocks = BlocksOf<Array>;
using BlockViews = BlocksOf<View>;
inline BlockViews views_of(const NormalBlocks& b) {
    return {b.u, b.v, b.w, b.rig_pose, b.rig_point, b.g_pose, b.g_point, b.rig, b.g_rig};
}
Array<double, 2> points_of_views(const WindowState& state, const WindowViews& views);
Array<double, 2> expected_views(const Pinholes& pinholes, const WindowState& state, const WindowViews& views,
                                Flags stereo, Matrix expected);
struct ExposedRows;
Array<double, 3> timing_of_views(const Pinholes& pinholes, const ExposedRows& exposed, const WindowState& state,
                                 const WindowViews& views, Matrix expected, Matrices motions, Vector timing);
Array<double, 1> slides_of_views(Indices points, Indices ids, Matrix var_drift, double f_px);
Array<bool, 1> views_within_gates(const Pinholes& pinholes, const WindowState& state, const WindowViews& views,
                                  Matrix var_drift, double of_one, double of_both);
struct TrackSquares {
    Array<double, 1> squares, values;
    FIELDS(squares, values)
};
TrackSquares squares_of_tracks(const Pinholes& pinholes, const WindowState& state, const WindowViews& views);
NormalBlocks normal_blocks(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, bool with_rig);
struct PosesByParts {
    Array<double, 3> information;
    Array<double, 2> right;
    FIELDS(information, right)
};
PosesByParts poses_by_parts(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, Matrices reach,
                            Matrix given, Indices part, int parts);

// window_points.cpp
constexpr std::size_t Q_COLUMNS[3] = {0, 1, 3};  // the coordinates of a homogeneous point that q changes
Array<double, 3> q_by_reference(Matrices ref_from_anchor, Matrix q);
struct SeenAgain {
    Array<std::int64_t, 1> rows;
    Array<double, 2> points;
    Array<double, 3> cov;
    FIELDS(rows, points, cov)
};
SeenAgain points_seen_again(Indices ids, Matrix var_drift, Indices known, Matrix q, Matrices cov_q);
Array<double, 3> drift_covariances(Indices ids, Matrices ref_from_anchor, Matrix q, Indices seen, Matrix var_drift);
Array<bool, 1> determined_points(Indices ids, Indices known, Indices seen, Flags used, Flags stereo, int newest);

// elimination.cpp
struct RigState {  // errors at their mean, information about them and weighted sums of their amplitudes; where they are held
    Vector mean;
    Matrix information;
    Vector weighted, held;
    RECORD(RigState, mean, information, weighted, held)
};
struct PriorViews {
    Indices ids;
    Matrix mean;
    Matrices cov, modes;
    Matrix world_modes;
    RigState rig;
    RECORD(Prior, ids, mean, cov, modes, world_modes, rig)
};
struct EliminatedPoints {
    Array<double, 3> root, reach;
    FIELDS(root, reach)
};
// Normal equations without points: H (n, n), of which the lower triangle counts, and g (n,); and for the points, roots
// (P, 3, 3) of their covariances given the others, and in units of these their coupling to the others (P, 3, n) and
// their own steps (P, 3).
struct WithoutPoints {
    Array<double, 2> h;
    Array<double, 1> g;
    Array<double, 3> std_given, reach;
    Array<double, 2> given;
};
EliminatedPoints eliminate_points(Matrices v, Matrices w);
WithoutPoints without_points(const BlockViews& blocks, const PriorViews& prior, Indices ids, Matrix q, Vector amplitudes,
                             std::size_t of_pose);

// solution.cpp
template <template <class, std::size_t> class Of>
struct SolvedOf {
    Of<double, 2> root, by_rig;
    Of<double, 3> std_given, reach;
    Of<double, 1> mean_of_rig;
    Of<double, 2> cov_of_rig, information_of_rig;
    RECORD(SolvedWindow, root, by_rig, std_given, reach, mean_of_rig, cov_of_rig, information_of_rig)
};
using SolvedWindow = SolvedOf<Array>;
using SolvedViews = SolvedOf<View>;
struct MovedWindow {
    Array<double, 3> cams_from_ref;
    Array<double, 2> own, q;
    Array<double, 1> amplitudes, step;
    RECORD(MovedWindow, cams_from_ref, own, q, amplitudes, step)
};
struct FactoredWindow {  // with the step of the other variables if the rig's errors stay, and the right-hand side of these
    SolvedWindow solved;
    Array<double, 1> alone, pull_of_rig;
};
FactoredWindow factored(WithoutPoints& system, std::size_t m);
struct WindowStep {
    SolvedWindow solved;
    MovedWindow moved;
    double decrease;
    FIELDS(solved, moved, decrease)
};
WindowStep window_step(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, const PriorViews& prior,
                       Vector amplitudes, bool with_rig, Matrix about_state, Vector weighted_state);
MovedWindow window_with_rig_moved(const WindowState& state, Vector amplitudes, const SolvedViews& solved, Vector change);

// absorb.cpp
struct PointsAlone {
    Array<double, 2> mean;
    Array<double, 3> cov, by_own, by_rig;
    FIELDS(mean, cov, by_own, by_rig)
};
struct AbsorbedFrame {
    Array<std::int64_t, 1> ids;
    Array<double, 2> mean;
    Array<double, 3> cov, modes;
    Array<double, 2> world_modes;
    Array<double, 1> world_step;
    Array<double, 2> information;
    Array<double, 1> weighted;
    RECORD(AbsorbedFrame, ids, mean, cov, modes, world_modes, world_step, information, weighted)
};
PointsAlone points_alone(Matrices v, Matrices w, Matrix g_point, Matrices rig_point, Matrix q, Vector rig_step);
AbsorbedFrame absorb_frame(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, Flags stereo, Matrix var_drift,
                           Flags seen_later, const PriorViews& prior, Vector amplitudes, Matrix world_modes, Matrix about,
                           Vector weighted, double negligible);

// truncation.cpp
Array<double, 3> whiten_blocks(Matrices cov, Matrices b);
struct Reflections {
    Array<double, 2> along, axes;
    FIELDS(along, axes)
};
Reflections reflections(Matrix columns);
Array<double, 2> minor_directions(Matrix covariance, double least);
struct TruncatedModes {
    Array<double, 3> cov, modes;
    Array<double, 2> world_modes;
    FIELDS(cov, modes, world_modes)
};
TruncatedModes truncate_modes(Matrices cov, Matrices modes, Matrix world_modes, std::size_t of_rig, double negligible);

// marginals.cpp
struct SystemViews {  // see normal_equations.py
    PriorViews prior;
    SolvedViews solved;
    Indices rig_ids;
    SolvedViews rig;
    Matrix cov_rig;
    RECORD(System, prior, solved, rig_ids, rig, cov_rig)
};
struct WindowMarginals {
    Array<double, 2> world_from_cam, cov_pose, q_in_cam, points_in_cam, points_in_world;
    Array<double, 3> cov_q_in_cam, cov_points, cov_points_in_world;
    Array<bool, 1> finite;
    RECORD(WindowMarginals, world_from_cam, cov_pose, q_in_cam, cov_q_in_cam, points_in_cam, cov_points, points_in_world, cov_points_in_world, finite)
};
Array<double, 2> newest_pose_covariance(const WindowState& state, const SystemViews& system);
WindowMarginals window_marginals(const WindowState& state, const SystemViews& system, Matrix world_from_ref, Matrix cov_more,
                                 double known_sigmas);
Array<double, 3> widened_points(Matrix points_in_cam, Matrices cov_in_world, Matrix world_from_cam, Matrix cov);

// motions.cpp
struct WindowMotions {
    Array<double, 3> from_newest, cov, by_rig;
    FIELDS(from_newest, cov, by_rig)
};
WindowMotions window_motions(Matrices cams_from_ref, Matrices true_cams, Matrix root, Matrix by_rig, Matrix cov_rig, Vector by_span,
                             Indices modes, Vector std_turns_rad, double apparent_turns);
struct FollowedPose {
    Array<double, 2> world_from_cam, cov_pose, points_in_world;
    Array<double, 3> cov_points_in_world;
    FIELDS(world_from_cam, cov_pose, points_in_world, cov_points_in_world)
};
FollowedPose followed_pose(Matrix before, Matrix previous_from_newest, Matrix world_from_cam, Matrix cov_pose, Matrix points_in_cam,
                           Matrices cov_points_in_world, double left, double most_sigmas);

}  // namespace core
