// What errors that all views share, and those that no view shows, do to what is reported, eqs. (18), (73) and (73a).

#include <algorithm>

#include "pinholes.hpp"
#include "stages.hpp"

namespace core {

Array<double, 3> reported_covariances(const View<double, 3>& cov, const View<double, 2>& points, const View<double, 2>& shared,
                                      double std_scale, double std_axes, const View<double, 2>& axes) {
    std::size_t n = points.shape[0];
    require_shape(points, {n, 3}, "points");
    require_shape(cov, {n, 3, 3}, "cov_points");
    require_shape(shared, {n, 3}, "shared_m");
    require_shape(axes, {3, 3}, "axes");
    Array<double, 3> result({n, 3, 3});
    const double* r = axes.data;
    for (std::size_t i = 0; i < n; i++) {
        const double *p = points[i], *s = shared[i];
        double about_x[3] = {0, -std_axes * p[2], std_axes * p[1]}, about_y[3] = {std_axes * p[2], 0, -std_axes * p[0]};
        double sum[9], half[9], *out = result[i];
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                sum[3 * a + b] = cov[i][3 * a + b] + s[a] * s[b] + std_scale * std_scale * p[a] * p[b] + about_x[a] * about_x[b] +
                                 about_y[a] * about_y[b];
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) half[3 * a + b] = r[3 * a] * sum[b] + r[3 * a + 1] * sum[3 + b] + r[3 * a + 2] * sum[6 + b];
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                out[3 * a + b] = half[3 * a] * r[3 * b] + half[3 * a + 1] * r[3 * b + 1] + half[3 * a + 2] * r[3 * b + 2];
    }
    return result;
}

Array<double, 3> unseen_by_pose(const View<double, 3>& poses, double std_scale, double std_axes) {
    std::size_t n = poses.shape[0];
    Array<double, 3> inverse = pose_inverse(poses), result({n, 6, 3});
    Array<double, 3> adjoint = pose_adjoint({inverse.data.get(), inverse.shape});
    for (std::size_t i = 0; i < n; i++) {
        double* out = result[i];
        for (int row = 0; row < 3; row++) out[3 * row] = -std_scale * inverse[i][4 * row + 3];  // along the path: Rᵀ t
        for (int row = 0; row < 6; row++)
            for (int axis = 0; axis < 2; axis++)
                out[3 * row + 1 + axis] = std_axes * (adjoint[i][6 * row + 3 + axis] - (row == 3 + axis ? 1.0 : 0.0));
    }
    return result;
}

}  // namespace core
