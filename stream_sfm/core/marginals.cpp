// Marginal estimates of the points of a window, in its newest camera and in the world, eqs. (37) to (41).

#include <algorithm>
#include <vector>

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

// ∂X/∂P (3, 4) of the metric point X = P₁..₃/ρ, eq. (38), times b (4, 3).
void metric_by(const double* point, const double* b, double* out) {
    double inverse = 1 / point[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) out[3 * i + j] = inverse * (b[3 * i + j] - point[i] * inverse * b[9 + j]);
}

}  // namespace

PointMarginals point_marginals(const WindowPoints& of, const PointCovariances& cov, const View<double, 2>& world_from_ref,
                               const View<double, 2>& cam_from_ref) {
    std::size_t n = of.q.shape[0], m = cov.x_by_rig.shape[1];
    require_shape(of.ref_from_anchor, {n, 4, 4}, "ref_from_anchor");
    require_shape(of.q, {n, 3}, "q");
    require_shape(of.finite, {n}, "finite");
    require_shape(cov.qq, {n, 3, 3}, "qq");
    require_shape(cov.qx, {n, 3, 6}, "qx");
    require_shape(cov.qw, {n, 3, 6}, "qw");
    require_shape(cov.q_by_rig, {n, 3, m}, "q_by_rig");
    require_shape(cov.xx, {6, 6}, "xx");
    require_shape(cov.ww, {6, 6}, "ww");
    require_shape(cov.x_by_rig, {6, m}, "x_by_rig");
    require_shape(world_from_ref, {4, 4}, "world_from_ref");
    require_shape(cam_from_ref, {4, 4}, "cam_from_ref");
    PointMarginals result{Array<double, 2>({n, 3}), Array<double, 3>({n, 3, 3}), Array<double, 2>({n, 3}),
                          Array<double, 3>({n, 3, 3}), Array<double, 2>({n, 3}), Array<double, 3>({n, 3, 3})};
    const double* world = world_from_ref.data;
    double turn[9];
    for (int k = 0; k < 9; k++) turn[k] = world[4 * (k / 3) + k % 3];
    std::vector<double> by_rig(3 * m);
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
        double cov_q[9];
        propagate(by_q, cov.qq[i], by_x, cov.xx.data, cov.qx[i], cov_q);
        for (std::size_t row = 0; row < 3; row++)
            for (std::size_t c = 0; c < m; c++) {
                double sum = 0;
                for (std::size_t j = 0; j < 3; j++) sum += by_q[3 * row + j] * cov.q_by_rig[i][j * m + c];
                for (std::size_t j = 0; j < 6; j++) sum += by_x[6 * row + j] * cov.x_by_rig[j][c];
                by_rig[row * m + c] = sum;
            }
        for (std::size_t row = 0; row < 3; row++)
            for (std::size_t c = 0; c < 3; c++) {
                double sum = 0;
                for (std::size_t j = 0; j < m; j++) sum += by_rig[row * m + j] * by_rig[c * m + j];
                result.cov_q_in_cam[i][3 * row + c] = cov_q[3 * row + c] - sum;
            }
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
        propagate(world_by_q, cov.qq[i], world_by_w, cov.ww.data, cov.qw[i], result.cov_points_in_world[i]);
        for (int c = 0; c < 3; c++)
            result.points_in_world[i][c] = turn[3 * c] * metric[0] + turn[3 * c + 1] * metric[1] + turn[3 * c + 2] * metric[2] + world[4 * c + 3];
    }
    return result;
}

}  // namespace core
