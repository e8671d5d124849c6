// Marginal estimates of the points of a window, in its newest camera and in the world, eqs. (37) to (41).

#include <algorithm>

#include "algebra.hpp"
#include "stages.hpp"

namespace core {
namespace {

// out (3, C) = a (3, K) b (K, C), row-major; `transposed`: b is (C, K).
template <int K, int C>
void multiply(const double* a, const double* b, double* out, bool transposed = false) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < C; j++) {
            double sum = 0;
            for (int k = 0; k < K; k++) sum += a[K * i + k] * (transposed ? b[K * j + k] : b[C * k + j]);
            out[C * i + j] = sum;
        }
}

// out (3, 3) = the covariance of Jq δq + Jy δy, of covariances (3, 3), (6, 6) and between them (3, 6).
void propagate(const double* jq, const double* qq, const double* jy, const double* yy, const double* qy, double* out) {
    double by_q[9], by_y[18], of_q[9], of_y[9], between[18], half[9];
    multiply<3, 3>(jq, qq, by_q);
    multiply<3, 3>(by_q, jq, of_q, true);
    multiply<6, 6>(jy, yy, by_y);
    multiply<6, 3>(by_y, jy, of_y, true);
    multiply<3, 6>(jq, qy, between);
    multiply<6, 3>(between, jy, half, true);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int x = 3 * i + j, y = 3 * j + i;
            out[x] = 0.5 * (of_q[x] + of_q[y] + of_y[x] + of_y[y]) + half[x] + half[y];
        }
}

// The Gram matrix (3, 3) of rows (3, k).
void gram(const double* rows, std::size_t k, double* out) {
    const double *x = rows, *y = rows + k, *z = rows + 2 * k;
    double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
    for (std::size_t i = 0; i < k; i++) {
        xx += x[i] * x[i], xy += x[i] * y[i], xz += x[i] * z[i];
        yy += y[i] * y[i], yz += y[i] * z[i], zz += z[i] * z[i];
    }
    const double all[9] = {xx, xy, xz, xy, yy, yz, xz, yz, zz};
    std::copy(all, all + 9, out);
}

// ∂X/∂P (3, 4) of the metric point X = P₁..₃/ρ, eq. (38), times b (4, 3).
void metric_by(const double* point, const double* b, double* out) {
    double inverse = 1 / point[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) out[3 * i + j] = inverse * (b[3 * i + j] - point[i] * inverse * b[9 + j]);
}

}  // namespace

PointCovariances point_covariances(const View<double, 3>& std_given, const View<double, 3>& own, const View<double, 3>& of_rig,
                                   const View<double, 3>& own_both, const View<double, 3>& rig_both) {
    std::size_t n = std_given.shape[0], k = own.shape[2], m = of_rig.shape[2];
    require_shape(std_given, {n, 3, 3}, "std_given");
    require_shape(own, {n, 3, k}, "own");
    require_shape(of_rig, {n, 3, m}, "of_rig");
    require_shape(own_both, {n, 3, 12}, "own_both");
    require_shape(rig_both, {n, 3, 12}, "rig_both");
    PointCovariances result{Array<double, 3>({n, 3, 3}), Array<double, 3>({n, 3, 12}), Array<double, 3>({n, 3, 3}),
                            Array<double, 3>({n, 3, 12})};
    for (std::size_t i = 0; i < n; i++) {
        double given[9], by_rig[9], half[9], with_both[36], minus[9];
        gram(own[i], k, given);
        gram(of_rig[i], m, by_rig);
        for (int x = 0; x < 9; x++) {
            given[x] += x % 4 == 0 ? 1.0 : 0.0;
            by_rig[x] += given[x];
            minus[x] = -std_given[i][x];
        }
        for (int x = 0; x < 36; x++) with_both[x] = own_both[i][x] + rig_both[i][x];
        multiply<3, 3>(std_given[i], given, half);
        multiply<3, 3>(half, std_given[i], result.qq_given[i], true);
        multiply<3, 3>(std_given[i], by_rig, half);
        multiply<3, 3>(half, std_given[i], result.qq[i], true);
        multiply<3, 12>(minus, own_both[i], result.q_both_given[i]);
        multiply<3, 12>(minus, with_both, result.q_both[i]);
    }
    return result;
}

PointMarginals point_marginals(const WindowPoints& of, const JointCovariance& cov, const JointCovariance& given,
                               const View<double, 2>& world_from_ref, const View<double, 2>& cam_from_ref) {
    std::size_t n = of.q.shape[0];
    require_shape(of.ref_from_anchor, {n, 4, 4}, "ref_from_anchor");
    require_shape(of.q, {n, 3}, "q");
    require_shape(of.finite, {n}, "finite");
    for (const JointCovariance* each : {&cov, &given}) {
        require_shape(each->qq, {n, 3, 3}, "qq");
        require_shape(each->q_both, {n, 3, 12}, "q_both");
        require_shape(each->both, {12, 12}, "both");
    }
    require_shape(world_from_ref, {4, 4}, "world_from_ref");
    require_shape(cam_from_ref, {4, 4}, "cam_from_ref");
    PointMarginals result{Array<double, 2>({n, 3}), Array<double, 3>({n, 3, 3}), Array<double, 2>({n, 3}),
                          Array<double, 3>({n, 3, 3}), Array<double, 2>({n, 3}), Array<double, 3>({n, 3, 3})};
    const double* world = world_from_ref.data;
    double turn[9];
    for (int k = 0; k < 9; k++) turn[k] = world[4 * (k / 3) + k % 3];
    auto columns_of = [](const double* rows, int first, int count, double* out) {  // columns of the pose, or of the world
        for (int row = 0; row < count; row++) std::copy(rows + 12 * row + first, rows + 12 * row + first + 6, out + 6 * row);
    };
    double xx[36], ww[36], xx_given[36];
    columns_of(cov.both.data, 0, 6, xx);
    columns_of(cov.both.data + 72, 6, 6, ww);
    columns_of(given.both.data, 0, 6, xx_given);
    for (std::size_t i = 0; i < n; i++) {
        const double *anchor = of.ref_from_anchor[i], *q = of.q[i];
        double in_anchor[4] = {q[0], q[1], 1.0, q[2]}, in_ref[4], p[4];
        move(anchor, in_anchor, in_ref);
        move(cam_from_ref.data, in_ref, p);
        clamp_depth(p);  // points behind this camera are not shown in it
        double ref_by_q[12], cam_by_q[12], k[12], by_q[9], by_x[18];
        for (int row = 0; row < 4; row++) {
            const double* from = anchor + 4 * row;
            ref_by_q[3 * row] = from[0], ref_by_q[3 * row + 1] = from[1], ref_by_q[3 * row + 2] = from[3];
        }
        for (int row = 0; row < 4; row++)
            for (int c = 0; c < 3; c++) {
                cam_by_q[3 * row + c] = 0;
                for (int j = 0; j < 4; j++) cam_by_q[3 * row + c] += cam_from_ref.data[4 * row + j] * ref_by_q[3 * j + c];
            }
        double inverse = 1 / p[2], seen[3] = {p[0] * inverse, p[1] * inverse, p[3] * inverse};
        std::fill(k, k + 12, 0.0);  // ∂q/∂P
        k[0] = k[5] = k[11] = inverse;
        for (int row = 0; row < 3; row++) k[4 * row + 2] = -seen[row] * inverse;
        multiply<4, 3>(k, cam_by_q, by_q);
        for (int row = 0; row < 3; row++) by_motion(k + 4 * row, p, by_x + 6 * row);
        double cov_q[9], qx[18], qx_given[18], qw[18];
        columns_of(cov.q_both[i], 0, 3, qx);
        columns_of(cov.q_both[i], 6, 3, qw);
        columns_of(given.q_both[i], 0, 3, qx_given);
        propagate(by_q, cov.qq[i], by_x, xx, qx, cov_q);
        propagate(by_q, given.qq[i], by_x, xx_given, qx_given, result.cov_q_in_cam[i]);
        std::copy(seen, seen + 3, result.q_in_cam[i]);

        double here[4] = {seen[0], seen[1], 1.0, of.finite.data[i] ? seen[2] : 1.0};
        const double moved_by_q[12] = {1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1};
        double d[9], half[9];
        metric_by(here, moved_by_q, d);
        multiply<3, 3>(d, cov_q, half);
        multiply<3, 3>(half, d, result.cov_points[i], true);
        if (!of.finite.data[i]) in_ref[3] = 1.0;
        double metric[3], by_ref[9], world_by_q[9], of_world[18], world_by_w[18];
        for (int c = 0; c < 3; c++) {
            result.points_in_cam[i][c] = here[c] / here[3];
            metric[c] = in_ref[c] / in_ref[3];
        }
        metric_by(in_ref, ref_by_q, by_ref);
        multiply<3, 3>(turn, by_ref, world_by_q);
        std::fill(of_world, of_world + 18, 0.0);  // [I, −[X]×]
        of_world[0] = of_world[7] = of_world[14] = 1;
        of_world[4] = metric[2], of_world[5] = -metric[1], of_world[9] = -metric[2];
        of_world[11] = metric[0], of_world[15] = metric[1], of_world[16] = -metric[0];
        multiply<3, 6>(turn, of_world, world_by_w);
        propagate(world_by_q, cov.qq[i], world_by_w, ww, qw, result.cov_points_in_world[i]);
        for (int c = 0; c < 3; c++)
            result.points_in_world[i][c] = turn[3 * c] * metric[0] + turn[3 * c + 1] * metric[1] + turn[3 * c + 2] * metric[2] + world[4 * c + 3];
    }
    return result;
}

}  // namespace core
