// What is reported of the newest motions of a window: between its frames, eqs. (17b) and (74), and the pose that continues by the
// last one, eq. (41a).

#include "poses.hpp"
#include "products.hpp"
#include "window.hpp"

namespace core {
namespace {

// out (6, 6) += a (6, n) bᵀ.
void add_outer(const double* a, const double* b, std::size_t n, double* out) {
    for (std::size_t x = 0; x < 6; x++)
        for (std::size_t y = 0; y < 6; y++) out[6 * x + y] += sum_of_products(a + x * n, b + y * n, n);
}

// Rows (6F, n) of cameras as rows (F, 6, n) of the motions from the newest one to the reference and to every other one, eq. (74).
Array<double, 3> apart_from_newest(const Array<double, 3>& newest_from_cams, Matrix rows) {
    std::size_t frames = newest_from_cams.shape[0], n = rows.shape[1];
    Array<double, 3> by = pose_adjoint(newest_from_cams), result(frames, 6, n);
    for (std::size_t f = 0; f < frames; f++)
        for (std::size_t x = 0; x < 6; x++) {
            double* out = result[f] + x * n;
            for (std::size_t y = 0; f > 0 && y < 6; y++) add(by[f][6 * x + y], rows[6 * (f - 1) + y], n, out);
            add(-1.0, rows[6 * (frames - 1) + x], n, out);
        }
    return result;
}

// Motions (F, 4, 4) from the newest of cameras (F, 4, 4) to the reference and to every other one.
Array<double, 3> from_newest(Matrices cams) {
    std::size_t frames = cams.shape[0];
    Array<double, 3> inverse = pose_inverse({cams[frames - 1], {1, 4, 4}}), result(frames, 4, 4);
    std::copy_n(inverse[0], 16, result[0]);
    for (std::size_t f = 1; f < frames; f++) multiply<4, 4, 4>(cams[f - 1], inverse[0], result[f]);
    return result;
}

// Adds a share of the variance of apparent rotations, of σ about each axis of every frame, since each of the frames, eq. (17b).
void add_turns(Matrices cams, Vector std_turns_rad, double share, Array<double, 3>& covs) {
    std::size_t frames = cams.shape[0];
    Array<double, 3> inverse = pose_inverse(cams), moved(frames, 4, 4);
    for (std::size_t f = 0; f < frames; f++) multiply<4, 4, 4>(cams[frames - 1], inverse[f], moved[f]);
    Array<double, 3> by = pose_adjoint(moved);
    double turns[36] = {};
    for (std::size_t f = frames; f-- > 0;) {
        double axes[18], turned[18];
        for (std::size_t x = 0; x < 18; x++) axes[x] = by[f][x / 3 * 6 + 3 + x % 3];
        for (std::size_t x = 0; x < 18; x++) turned[x] = std_turns_rad.data[f] * std_turns_rad.data[f] * axes[x];
        add_outer(turned, axes, 3, turns);
        add(share / static_cast<double>(frames - f), turns, 36, covs[f]);
    }
}

}  // namespace

WindowMotions window_motions(Matrices cams_from_ref, Matrices true_cams, Matrix root, Matrix by_rig, Matrix cov_rig, Vector by_span,
                             Indices modes, Vector std_turns_rad, double apparent_turns) {
    std::size_t frames = cams_from_ref.shape[0], n = root.shape[1], m = by_rig.shape[1];
    require(frames > 0 && by_span.shape[0] >= frames, "there are no frames, or fewer factors than frames");
    require_shape(cams_from_ref, {frames, 4, 4}, "cams_from_ref");
    require_shape(true_cams, {frames, 4, 4}, "true_cams");
    require_shape(root, {6 * frames, n}, "root");
    require_shape(by_rig, {6 * frames, m}, "by_rig");
    require_shape(cov_rig, {m, m}, "cov_rig");
    require_shape(modes, {2}, "modes");
    require_shape(std_turns_rad, {frames}, "std_turns_rad");
    auto first = static_cast<std::uint64_t>(modes.data[0]), last = static_cast<std::uint64_t>(modes.data[1]);
    require(first <= last && last <= n, "the modes are not among the columns");
    Array<double, 3> motions = from_newest(true_cams);
    Array<double, 3> half = apart_from_newest(pose_inverse(motions), root);
    WindowMotions result{orthonormalise(motions), {frames, 6, 6}, apart_from_newest(pose_inverse(motions), by_rig)};
    std::vector<double> times_cov(6 * m);
    for (std::size_t f = 0; f < frames; f++) {
        double factor = by_span.data[frames - 1 - f], relative = factor / by_span.data[by_span.shape[0] - 1];
        for (std::size_t x = 0; x < 6; x++)
            for (std::size_t k = 0; k < last; k++) half[f][x * n + k] *= k < first ? relative : factor;
        add_outer(half[f], half[f], n, result.cov[f]);
        std::fill(times_cov.begin(), times_cov.end(), 0.0);
        for (std::size_t x = 0; x < 6; x++)
            for (std::size_t k = 0; k < m; k++) add(result.by_rig[f][x * m + k], cov_rig[k], m, times_cov.data() + x * m);
        add_outer(times_cov.data(), result.by_rig[f], m, result.cov[f]);
    }
    add_turns(cams_from_ref, std_turns_rad, apparent_turns, result.cov);
    return result;
}

FollowedPose followed_pose(Matrix before, Matrix previous_from_newest, Matrix world_from_cam, Matrix cov_pose, Matrix points_in_cam,
                           Matrices cov_points_in_world, double left, double most_sigmas) {
    std::size_t n = points_in_cam.shape[0];
    for (Matrix pose : {before, previous_from_newest, world_from_cam}) require_shape(pose, {4, 4}, "a pose");
    require_shape(cov_pose, {6, 6}, "cov_pose");
    Array<double, 3> start(1, 4, 4), apart(1, 4, 4), moved(1, 4, 4);
    multiply<4, 4, 4>(before.data, previous_from_newest.data, start.data.get());
    Array<double, 3> back = pose_inverse(orthonormalise(start));
    multiply<4, 4, 4>(back.data.get(), world_from_cam.data, apart.data.get());
    Array<double, 2> by = pose_log(apart);
    double* xi = by.data.get();
    double factor[36], solved[6];
    std::copy_n(cov_pose.data, 36, factor);
    for (int k = 0; k < 6; k++) solved[k] = xi[k] *= left;
    require_definite(solve_positive(factor, solved, 6), "the covariance of the pose is not positive definite");
    double distance2 = std::inner_product(xi, xi + 6, solved, 0.0);
    for (int k = 0; k < 6; k++) xi[k] *= -std::min(1.0, most_sigmas / std::sqrt(std::max(distance2, ROUNDING)));
    Array<double, 2> square(6, 6);  // the move is a known error, so covariances become mean squared errors
    for (std::size_t x = 0; x < 6; x++)
        for (std::size_t y = 0; y < 6; y++) square[x][y] = xi[x] * xi[y];
    multiply<4, 4, 4>(world_from_cam.data, pose_exp(by).data.get(), moved.data.get());
    FollowedPose result{{4, 4}, {6, 6}, {n, 3}, widened_points(points_in_cam, cov_points_in_world, world_from_cam, square)};
    std::copy_n(orthonormalise(moved).data.get(), 16, result.world_from_cam.data.get());
    std::transform(cov_pose.data, cov_pose.data + 36, square.data.get(), result.cov_pose.data.get(), std::plus<>());
    const double* pose = result.world_from_cam.data.get();
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t x = 0; x < 3; x++)
            result.points_in_world[i][x] = std::inner_product(pose + 4 * x, pose + 4 * x + 3, points_in_cam[i], pose[4 * x + 3]);
    return result;
}

}  // namespace core
