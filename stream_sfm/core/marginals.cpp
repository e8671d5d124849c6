// Marginal estimates of the points of a window, in its newest camera and in the world, eqs. (37) to (41).

#include "products.hpp"
#include "window.hpp"

namespace core {
namespace {

constexpr double UNIT[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, NOTHING[9] = {};

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

// Adds one part of the covariances of a point, of q (3, 3) and with pose and world (3, 12); `of_itself` (3, 3) in its
// units.
void add_part(const CovariancePart& part, std::size_t i, const double* of_itself, double* of_q, double* with_both) {
    const double* root = part.root[i];
    double sum[9], half[9], whole[9];
    std::copy(of_itself, of_itself + 9, sum);
    add_gram(part.reach[i], part.covariant[i], part.reach.shape[2], sum);
    multiply<3, 3, 3>(root, sum, half);
    multiply_transposed<3, 3, 3>(half, root, whole);
    add(1.0, whole, 9, of_q);
    for (std::size_t row = 0; row < 3; row++)
        for (std::size_t k = 0; k < 3; k++) add(-root[3 * row + k], part.with_both[i] + 12 * k, 12, with_both + 12 * row);
}

// ∂X/∂P (3, 4) of the metric point X = P₁..₃/ρ, eq. (38), times b (4, 3).
void metric_by(const double* point, const double* b, double* out) {
    double inverse = 1 / point[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) out[3 * i + j] = inverse * (b[3 * i + j] - point[i] * inverse * b[9 + j]);
}

}  // namespace

WIDER PointMarginals point_marginals(Matrices ref_from_anchor, Matrix q_in_anchor, const CovariancePart& own,
                               const CovariancePart& of_rig, Matrix world_from_ref, Matrix cam_from_ref,
                               double known_sigmas) {
    std::size_t n = q_in_anchor.shape[0];
    require_shape(ref_from_anchor, {n, 4, 4}, "ref_from_anchor");
    require_shape(q_in_anchor, {n, 3}, "q");
    for (const CovariancePart* each : {&own, &of_rig}) {
        require_shape(each->root, {n, 3, 3}, "root");
        require_shape(each->reach, {n, 3, each->reach.shape[2]}, "reach");
        require_shape(each->covariant, each->reach.shape, "covariant");
        require_shape(each->with_both, {n, 3, 12}, "with_both");
        require_shape(each->both, {12, 12}, "both");
    }
    require_shape(world_from_ref, {4, 4}, "world_from_ref");
    require_shape(cam_from_ref, {4, 4}, "cam_from_ref");
    PointMarginals result{{n, 3}, {n, 3}, {n, 3}, {n, 3, 3}, {n, 3, 3}, {n, 3, 3}, {n}};
    const double* world = world_from_ref.data;
    double turn[9];
    for (int k = 0; k < 9; k++) turn[k] = world[4 * (k / 3) + k % 3];
    auto columns_of = [](const double* rows, int first, int count, double* out) {  // columns of the pose, or of the world
        for (int row = 0; row < count; row++) std::copy(rows + 12 * row + first, rows + 12 * row + first + 6, out + 6 * row);
    };
    double xx[36], ww[36], xx_given[36], both[144];
    std::transform(own.both.data, own.both.data + 144, of_rig.both.data, both, std::plus<>());
    columns_of(both, 0, 6, xx);
    columns_of(both + 72, 6, 6, ww);
    columns_of(own.both.data, 0, 6, xx_given);
    for (std::size_t i = 0; i < n; i++) {
        double qq[9], qq_given[9] = {}, with_both[36] = {}, qx[18], qx_given[18], qw[18];
        add_part(own, i, UNIT, qq_given, with_both);
        columns_of(with_both, 0, 3, qx_given);
        std::copy(qq_given, qq_given + 9, qq);
        add_part(of_rig, i, NOTHING, qq, with_both);
        columns_of(with_both, 0, 3, qx);
        columns_of(with_both, 6, 3, qw);
        const double *anchor = ref_from_anchor[i], *q = q_in_anchor[i];
        bool finite = result.finite.data[i] = q[2] > known_sigmas * std::sqrt(qq[8]);
        double in_anchor[4] = {q[0], q[1], 1.0, q[2]}, in_ref[4], p[4];
        move(anchor, in_anchor, in_ref);
        move(cam_from_ref.data, in_ref, p);
        clamp_depth(p);  // points behind this camera are never shown in it
        double ref_by_q[12], cam_by_q[12], k[12], by_q[9], by_x[18];
        for (int row = 0; row < 4; row++) {
            const double* from = anchor + 4 * row;
            ref_by_q[3 * row] = from[0], ref_by_q[3 * row + 1] = from[1], ref_by_q[3 * row + 2] = from[3];
        }
        multiply<4, 4, 3>(cam_from_ref.data, ref_by_q, cam_by_q);
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
