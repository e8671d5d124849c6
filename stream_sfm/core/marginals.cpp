// Marginal estimates of the points of a window, in its newest camera and in the world, eqs. (37) to (41).

#include "poses.hpp"
#include "products.hpp"
#include "window.hpp"

namespace core {
namespace {

constexpr double UNIT[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, NOTHING[9] = {};
constexpr std::size_t BOTH = 12;  // unknowns of a pose and the world

// out (3, 3) = the covariance of Jq δq + Jy δy, from those of q (3, 3), of y (6, 6) and between them (3, 6).
void propagate(const double* jq, const double* qq, const double* jy, const double* yy, const double* qy, double* out) {
    double by_q[9], by_y[18], of_q[9], of_y[9], between[18], half[9];
    multiply<3, 3, 3>(jq, qq, by_q);
    multiply_transposed<3, 3, 3>(by_q, jq, of_q);
    multiply<3, 6, 6>(jy, yy, by_y);
    multiply_transposed<3, 6, 3>(by_y, jy, of_y);
    multiply<3, 3, 6>(jq, qy, between);
    multiply_transposed<3, 6, 3>(between, jy, half);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int x = 3 * i + j, y = 3 * j + i;
            out[x] = 0.5 * (of_q[x] + of_q[y] + of_y[x] + of_y[y]) + half[x] + half[y];
        }
}

// out (3, 3) += the symmetric product of rows (3, k) with others.
void add_gram(const double* rows, const double* others, std::size_t k, double* out) {
    for (std::size_t x = 0; x < 3; x++)
        for (std::size_t y = x; y < 3; y++) {
            double sum = sum_of_products(rows + x * k, others + y * k, k);
            out[3 * x + y] += sum;
            if (x < y) out[3 * y + x] += sum;
        }
}

// One of two parts of the joint covariance of points, a pose and the world, eq. (28), by k variables: in units of roots of
// the points' covariances given all others, their Jacobian (P, 3, k), also times the covariance of the variables, and
// times their covariance with both (P, 3, 12); and the covariance of both.
struct Part {
    Matrices root;
    Array<double, 3> by, times_cov, with_both;
    double both[BOTH * BOTH] = {};

    // Adds to the covariances of a point, of q (3, 3) and with both (3, 12); `of_itself` (3, 3) in its units.
    void add_to(std::size_t i, const double* of_itself, double* of_q, double* q_with_both) const {
        double sum[9], half[9], whole[9];
        std::copy(of_itself, of_itself + 9, sum);
        add_gram(by[i], times_cov.size() ? times_cov[i] : by[i], by.shape[2], sum);
        multiply<3, 3, 3>(root[i], sum, half);
        multiply_transposed<3, 3, 3>(half, root[i], whole);
        add(1.0, whole, 9, of_q);
        for (std::size_t row = 0; row < 3; row++)
            for (std::size_t k = 0; k < 3; k++) add(-root[i][3 * row + k], with_both[i] + BOTH * k, BOTH, q_with_both + BOTH * row);
    }
};

// The newest pose and the world by the variables of a system (12, n), with a covariance of 1, and by the rig's errors (12, m).
// The reference camera, which is the newest one in a window without frames, has no error.
struct PoseAndWorld {
    Array<double, 2> own, rig, rig_times_cov;

    PoseAndWorld(const SystemViews& system, std::size_t frames)
        : own(BOTH, check(system, frames)), rig(BOTH, system.cov_rig.shape[0]), rig_times_cov(rig.shape) {
        std::size_t n = own.shape[1], m = rig.shape[1], modes = system.prior.modes.shape[2] - m;
        const SolvedViews& solved = system.solved;
        if (frames) {
            std::copy_n(solved.root[6 * frames - 6], 6 * n, own[0]);
            std::copy_n(system.rig.by_rig[6 * frames - 6], 6 * m, rig[0]);
        }
        for (std::size_t row = 0; row < 6; row++) {
            const double* world = system.prior.world_modes[row];
            std::copy_n(world + modes, m, rig[6 + row]);
            for (std::size_t k = 0; k < modes; k++) {
                add(world[k], solved.root[n - modes + k], n, own[6 + row]);
                add(world[k], system.rig.by_rig[n - modes + k], m, rig[6 + row]);
            }
        }
        for (std::size_t row = 0; row < BOTH; row++)
            for (std::size_t k = 0; k < m; k++) add(rig[row][k], system.cov_rig[k], m, rig_times_cov[row]);
    }
    void add_covariance(bool of_rig, double* both) const {
        const Array<double, 2>&a = of_rig ? rig_times_cov : own, &b = of_rig ? rig : own;
        for (std::size_t x = 0; x < BOTH; x++)
            for (std::size_t y = 0; y < BOTH; y++) both[BOTH * x + y] += sum_of_products(a[x], b[y], a.shape[1]);
    }

   private:
    // The number of variables of a system whose arrays fit each other.
    static std::size_t check(const SystemViews& system, std::size_t frames) {
        std::size_t n = system.solved.root.shape[0], m = system.cov_rig.shape[0], points = system.solved.std_given.shape[0];
        std::size_t k = system.prior.modes.shape[2];
        require_shape(system.solved.root, {n, n}, "root");
        require_shape(system.solved.std_given, {points, 3, 3}, "std_given");
        require_shape(system.solved.reach, {points, 3, system.solved.reach.shape[2]}, "reach");
        require(system.solved.reach.shape[2] >= n, "reach has fewer columns than there are variables");
        require_shape(system.cov_rig, {m, m}, "cov_rig");
        require_shape(system.rig.by_rig, {n, m}, "by_rig");
        require_shape(system.rig.std_given, {system.rig_ids.shape[0], 3, 3}, "std_given");
        require_shape(system.rig.reach, {system.rig_ids.shape[0], 3, n + m}, "reach");
        require_shape(system.prior.world_modes, {system.prior.world_modes.shape[0], k}, "world_modes");
        require(system.prior.world_modes.shape[0] >= 6, "the world has too few modes");
        require(m <= k && 6 * frames + k - m <= n, "there are fewer variables than modes and poses");
        return n;
    }
};

// The covariance (6, 6) of the newest pose in the world: of −ξ + Ad(X) ω, with ξ on the left of X.
Array<double, 2> of_pose_in_world(const double* cam_from_ref, const double* both) {
    Array<double, 3> adjoint = pose_adjoint({cam_from_ref, {1, 4, 4}});
    double by_both[6 * BOTH] = {}, half[6 * BOTH], whole[36];
    for (int row = 0; row < 6; row++) {
        by_both[BOTH * static_cast<std::size_t>(row) + static_cast<std::size_t>(row)] = -1;
        std::copy_n(adjoint.data.get() + 6 * row, 6, by_both + BOTH * static_cast<std::size_t>(row) + 6);
    }
    multiply<6, BOTH, BOTH>(by_both, both, half);
    multiply_transposed<6, BOTH, 6>(half, by_both, whole);
    Array<double, 2> result(6, 6);
    for (std::size_t x = 0; x < 6; x++)
        for (std::size_t y = 0; y < 6; y++) result[x][y] = 0.5 * (whole[6 * x + y] + whole[6 * y + x]);
    return result;
}

// The newest camera (4, 4) of a window: its last one, or the reference.
std::array<double, 16> newest_cam(const WindowState& state) {
    std::size_t frames = state.cams_from_ref.shape[0];
    require_shape(state.cams_from_ref, {frames, 4, 4}, "cams_from_ref");
    std::array<double, 16> cam = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    if (frames) std::copy_n(state.cams_from_ref[frames - 1], 16, cam.begin());
    return cam;
}

// Rows (P, 3, k) of points times a matrix (k, n).
Array<double, 3> rows_times(Matrices rows, std::size_t k, Terms matrix, std::size_t n) {
    std::size_t points = rows.shape[0];
    Array<double, 3> result(points, 3, n);
    add_large_product(1.0, along({rows.data, rows.shape[2]}), 3 * points, matrix, n, k, Needed::ALL, result.data.get(), n);
    return result;
}

// ∂X/∂P (3, 4) of the metric point X = P₁..₃/ρ, eq. (38), times b (4, 3).
void metric_by(const double* point, const double* b, double* out) {
    double inverse = 1 / point[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) out[3 * i + j] = inverse * (b[3 * i + j] - point[i] * inverse * b[9 + j]);
}

}  // namespace

Array<double, 2> newest_pose_covariance(const WindowState& state, const SystemViews& system) {
    PoseAndWorld at(system, state.cams_from_ref.shape[0]);
    double both[BOTH * BOTH] = {};
    for (bool of_rig : {false, true}) at.add_covariance(of_rig, both);
    return of_pose_in_world(newest_cam(state).data(), both);
}

WIDER WindowMarginals window_marginals(const WindowState& state, const SystemViews& system, Matrix world_from_ref, Matrix cov_more,
                                       double known_sigmas) {
    std::size_t n = state.q.shape[0], size = system.solved.root.shape[0], m = system.cov_rig.shape[0];
    require_shape(state.ids, {n}, "ids");
    require_shape(state.ref_from_anchor, {n, 4, 4}, "ref_from_anchor");
    require_shape(state.q, {n, 3}, "q");
    require_shape(world_from_ref, {4, 4}, "world_from_ref");
    PoseAndWorld at(system, state.cams_from_ref.shape[0]);
    require_shape(system.solved.std_given, {n, 3, 3}, "std_given");
    const std::array<double, 16> cam_from_ref = newest_cam(state);
    const SolvedViews &solved = system.solved, &of_errors = system.rig;
    Part own{solved.std_given, rows_times(solved.reach, size, down({solved.root.data, size}), size), {0, 3, 0}, {0, 3, BOTH}};
    own.with_both = rows_times(own.by, size, along({at.own.data.get(), size}), BOTH);
    at.add_covariance(false, own.both);
    Part of_rig{of_errors.std_given, rows_times(of_errors.reach, size, down({of_errors.by_rig.data, m}), m), {0, 3, 0}, {0, 3, BOTH}};
    for (std::size_t row = 0; row < 3 * system.rig_ids.shape[0]; row++)
        add(1.0, of_errors.reach.data + row * (size + m) + size, m, of_rig.by.data.get() + row * m);
    of_rig.times_cov = rows_times(of_rig.by, m, down({system.cov_rig.data, m}), m);
    of_rig.with_both = rows_times(of_rig.by, m, along({at.rig_times_cov.data.get(), m}), BOTH);
    at.add_covariance(true, of_rig.both);
    double both[BOTH * BOTH];
    std::transform(own.both, own.both + BOTH * BOTH, of_rig.both, both, std::plus<>());
    Array<double, 2> cov_pose = of_pose_in_world(cam_from_ref.data(), both);
    WindowMarginals result{{4, 4}, std::move(cov_pose), {n, 3}, {n, 3}, {n, 3}, {n, 3, 3}, {n, 3, 3}, {n, 3, 3}, {n}};
    const double* world = world_from_ref.data;
    double turn[9];
    for (int k = 0; k < 9; k++) turn[k] = world[4 * (k / 3) + k % 3];
    auto columns_of = [](const double* rows, int first, int count, double* out) {  // columns of the pose, or of the world
        for (int row = 0; row < count; row++) std::copy(rows + 12 * row + first, rows + 12 * row + first + 6, out + 6 * row);
    };
    double xx[36], ww[36], xx_given[36];
    columns_of(both, 0, 6, xx);
    columns_of(both + 72, 6, 6, ww);
    columns_of(own.both, 0, 6, xx_given);
    Lookup rows{system.rig_ids};
    for (std::size_t i = 0; i < n; i++) {
        double qq[9], qq_given[9] = {}, with_both[36] = {}, qx[18], qx_given[18], qw[18];
        own.add_to(i, UNIT, qq_given, with_both);
        columns_of(with_both, 0, 3, qx_given);
        std::copy(qq_given, qq_given + 9, qq);
        std::size_t row = rows.row(state.ids.data[i]);
        require(row != NONE, "a point is not of the system with the rig's errors");
        of_rig.add_to(row, NOTHING, qq, with_both);
        columns_of(with_both, 0, 3, qx);
        columns_of(with_both, 6, 3, qw);
        const double *anchor = state.ref_from_anchor[i], *q = state.q[i];
        bool finite = result.finite.data[i] = q[2] > known_sigmas * std::sqrt(qq[8]);
        double in_anchor[4] = {q[0], q[1], 1.0, q[2]}, in_ref[4], p[4];
        move(anchor, in_anchor, in_ref);
        move(cam_from_ref.data(), in_ref, p);
        clamp_depth(p);  // points behind this camera are never shown in it
        double ref_by_q[12], cam_by_q[12], k[12], by_q[9], by_x[18];
        for (int row = 0; row < 4; row++) {
            const double* from = anchor + 4 * row;
            ref_by_q[3 * row] = from[0], ref_by_q[3 * row + 1] = from[1], ref_by_q[3 * row + 2] = from[3];
        }
        multiply<4, 4, 3>(cam_from_ref.data(), ref_by_q, cam_by_q);
        double inverse = 1 / p[2], seen[3] = {p[0] * inverse, p[1] * inverse, p[3] * inverse};
        std::fill(k, k + 12, 0.0);  // ∂q/∂P
        k[0] = k[5] = k[11] = inverse;
        for (int row = 0; row < 3; row++) k[4 * row + 2] = -seen[row] * inverse;
        multiply<3, 4, 3>(k, cam_by_q, by_q);
        for (int row = 0; row < 3; row++) by_motion(k + 4 * row, p, by_x + 6 * row);
        double cov_q[9];
        propagate(by_q, qq, by_x, xx, qx, cov_q);
        propagate(by_q, qq_given, by_x, xx_given, qx_given, result.cov_q_in_cam[i]);
        std::copy(seen, seen + 3, result.q_in_cam[i]);

        double here[4] = {seen[0], seen[1], 1.0, finite ? seen[2] : 1.0};
        const double moved_by_q[12] = {1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1};
        double d[9], half[9];
        metric_by(here, moved_by_q, d);
        multiply<3, 3, 3>(d, cov_q, half);
        multiply_transposed<3, 3, 3>(half, d, result.cov_points[i]);
        if (!finite) in_ref[3] = 1.0;
        double metric[3], by_ref[9], world_by_q[9], of_world[18], world_by_w[18];
        for (int c = 0; c < 3; c++) {
            result.points_in_cam[i][c] = here[c] / here[3];
            metric[c] = in_ref[c] / in_ref[3];
        }
        metric_by(in_ref, ref_by_q, by_ref);
        multiply<3, 3, 3>(turn, by_ref, world_by_q);
        std::fill(of_world, of_world + 18, 0.0);  // [I, −[X]×]
        of_world[0] = of_world[7] = of_world[14] = 1;
        of_world[4] = metric[2], of_world[5] = -metric[1], of_world[9] = -metric[2];
        of_world[11] = metric[0], of_world[15] = metric[1], of_world[16] = -metric[0];
        multiply<3, 3, 6>(turn, of_world, world_by_w);
        propagate(world_by_q, qq, world_by_w, ww, qw, result.cov_points_in_world[i]);
        for (int c = 0; c < 3; c++)
            result.points_in_world[i][c] = turn[3 * c] * metric[0] + turn[3 * c + 1] * metric[1] + turn[3 * c + 2] * metric[2] + world[4 * c + 3];
    }
    Array<double, 3> ref_from_cam = pose_inverse({cam_from_ref.data(), {1, 4, 4}}), pose(1, 4, 4);
    multiply<4, 4, 4>(world, ref_from_cam.data.get(), pose.data.get());
    std::copy_n(orthonormalise(pose).data.get(), 16, result.world_from_cam.data.get());
    result.cov_points_in_world = widened_points(result.points_in_cam, result.cov_points_in_world, result.world_from_cam, cov_more);
    add(1.0, cov_more.data, 36, result.cov_pose.data.get());
    return result;
}

Array<double, 3> widened_points(Matrix points_in_cam, Matrices cov_in_world, Matrix world_from_cam, Matrix cov) {
    std::size_t n = points_in_cam.shape[0];
    require_shape(points_in_cam, {n, 3}, "points_in_cam");
    require_shape(cov_in_world, {n, 3, 3}, "cov_points_in_world");
    require_shape(world_from_cam, {4, 4}, "world_from_cam");
    require_shape(cov, {6, 6}, "cov");
    Array<double, 3> result(n, 3, 3);
    double turn[9];
    for (int k = 0; k < 9; k++) turn[k] = world_from_cam.data[4 * (k / 3) + k % 3];
    for (std::size_t i = 0; i < n; i++) {
        const double *p = points_in_cam[i], *before = cov_in_world[i];
        const double j[18] = {-1, 0, 0, 0, -p[2], p[1], 0, -1, 0, p[2], 0, -p[0], 0, 0, -1, -p[1], p[0], 0};
        double by_cov[18], in_cam[9], half[9], whole[9];
        multiply<3, 6, 6>(j, cov.data, by_cov);
        multiply_transposed<3, 6, 3>(by_cov, j, in_cam);
        multiply<3, 3, 3>(turn, in_cam, half);
        multiply_transposed<3, 3, 3>(half, turn, whole);
        for (int x = 0; x < 3; x++)
            for (int y = 0; y < 3; y++) result[i][3 * x + y] = 0.5 * ((before[3 * x + y] + before[3 * y + x]) + (whole[3 * x + y] + whole[3 * y + x]));
    }
    return result;
}

}  // namespace core
