// Estimates in rectified axes transformed to those of the physical camera, eq. (7), with errors that no view shows,
// eqs. (18), (73) and (73a).

#include "poses.hpp"

namespace core {
namespace {

// out (3, 3) = R A Rᵀ of A (3, 3), in rows `stride` apart.
void turn_both(const double* r, const double* a, std::size_t stride, double* out) {
    double half[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) half[3 * i + j] = r[3 * i] * a[j] + r[3 * i + 1] * a[stride + j] + r[3 * i + 2] * a[2 * stride + j];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[stride * i + j] = half[3 * i] * r[3 * j] + half[3 * i + 1] * r[3 * j + 1] + half[3 * i + 2] * r[3 * j + 2];
}

// Perturbations (n, 6, 3) on the right of poses T, per σ of lengths and of axes about x and y. A rotation C of the axes
// turns T into C T C⁻¹, which is T Exp((Ad(T⁻¹) − I) c).
Array<double, 3> unseen_by_pose(Matrices poses, const PhysicalAxes& axes) {
    std::size_t n = poses.shape[0];
    Array<double, 3> inverse = pose_inverse(poses), adjoint = pose_adjoint(inverse), result(n, 6, 3);
    for (std::size_t i = 0; i < n; i++) {
        double* out = result[i];
        for (int row = 0; row < 3; row++) out[3 * row] = -axes.std_scale * inverse[i][4 * row + 3];  // along the path: Rᵀ t
        for (int row = 0; row < 6; row++)
            for (int axis = 0; axis < 2; axis++)
                out[3 * row + 1 + axis] = axes.std_axes_rad * (adjoint[i][6 * row + 3 + axis] - (row == 3 + axis ? 1.0 : 0.0));
    }
    return result;
}

}  // namespace

ReportedMotions reported_motions(const PhysicalAxes& axes, Matrices poses, Matrices cov, Matrices by_terms) {
    std::size_t n = poses.shape[0], m = 3 + by_terms.shape[2];
    require_shape(axes.rotation, {3, 3}, "rotation");
    require_shape(poses, {n, 4, 4}, "poses");
    require_shape(cov, {n, 6, 6}, "cov");
    require_shape(by_terms, {n, 6, m - 3}, "by_terms");
    const double* r = axes.rotation.data;
    Array<double, 3> unseen = unseen_by_pose(poses, axes);
    ReportedMotions result{{n, 4, 4}, {n, 6, 6}, {n, 6, m}};
    for (std::size_t i = 0; i < n; i++) {
        turn_both(r, poses[i], 4, result.poses[i]);
        double t[3] = {poses[i][3], poses[i][7], poses[i][11]}, moved[3], sum[36];
        multiply_transposed<1, 3, 3>(t, r, moved);
        for (int k = 0; k < 4; k++) result.poses[i][4 * k + 3] = k < 3 ? moved[k] : 1.0;
        const double* u = unseen[i];
        for (int a = 0; a < 6; a++)
            for (int b = 0; b < 6; b++)
                sum[6 * a + b] = cov[i][6 * a + b] + (u[3 * a] * u[3 * b] + u[3 * a + 1] * u[3 * b + 1] + u[3 * a + 2] * u[3 * b + 2]);
        for (int block : {0, 3, 18, 21}) turn_both(r, sum + block, 6, result.cov[i] + block);
        for (int row = 0; row < 6; row++)
            for (std::size_t c = 0; c < m; c++)
                for (int k = 0; k < 3; k++) {
                    std::size_t from = static_cast<std::size_t>(row / 3 * 3 + k);
                    double of = c < 3 ? u[3 * from + c] : by_terms[i][from * (m - 3) + c - 3];
                    result.jacobian[i][static_cast<std::size_t>(row) * m + c] += r[3 * (row % 3) + k] * of;
                }
    }
    return result;
}

ReportedPoints reported_points(const PhysicalAxes& axes, Matrix points, Matrices cov, Vector std_shared,
                               Matrix frame_from_cam) {
    std::size_t n = points.shape[0];
    require_shape(axes.rotation, {3, 3}, "rotation");
    require_shape(points, {n, 3}, "points");
    require_shape(cov, {n, 3, 3}, "cov_points");
    require_shape(std_shared, {n}, "std_shared");
    require_shape(frame_from_cam, {4, 4}, "frame_from_cam");
    ReportedPoints result{{n, 3}, {n, 3, 3}};
    const double *r = axes.rotation.data, *pose = frame_from_cam.data;
    for (std::size_t i = 0; i < n; i++) {
        const double* p = points[i];
        multiply_transposed<1, 3, 3>(p, r, result.points[i]);
        double ray[3] = {p[0] - pose[3], p[1] - pose[7], p[2] - pose[11]};  // from the camera
        double relative = std_shared.data[i] * (pose[2] * ray[0] + pose[6] * ray[1] + pose[10] * ray[2]);
        double about_x[3] = {0, -axes.std_axes_rad * p[2], axes.std_axes_rad * p[1]}, about_y[3] = {axes.std_axes_rad * p[2], 0, -axes.std_axes_rad * p[0]};
        double sum[9];
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                sum[3 * a + b] = cov[i][3 * a + b] + relative * relative * ray[a] * ray[b] + axes.std_scale * axes.std_scale * p[a] * p[b] +
                                 about_x[a] * about_x[b] + about_y[a] * about_y[b];
        turn_both(r, sum, 3, result.cov[i]);
    }
    return result;
}

}  // namespace core
