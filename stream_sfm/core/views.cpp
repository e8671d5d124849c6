// Points with covariances and their stereo views: whitened residuals under a motion, and their Jacobian.

#include "views.hpp"

namespace core {
namespace {

// A view whose prediction is no more certain than this, a hundred images wide, gives no information about the motion. At a
// hundred times more, the noise of the view itself would be lost to rounding in their sum.
constexpr double MAX_PREDICTED_PX2 = 1e5 * 1e5;

// R (4, 4) with RᵀR the information of a view with this covariance, eq. (11); zero for a side that is not finite in z.
bool whitening(const double* z, const double* cov, double* root) {
    double seen_cov[16], lower[16];
    bool seen[4];
    for (int i = 0; i < 4; i++) seen[i] = std::isfinite(z[i]);
    for (int i = 0; i < 16; i++) seen_cov[i] = seen[i / 4] && seen[i % 4] ? cov[i] : (i / 4 == i % 4 ? 1.0 : 0.0);
    if (!cholesky<4>(seen_cov, lower)) return false;
    invert_lower<4>(lower, root);
    for (int i = 0; i < 16; i++)
        if (!(seen[i / 4] && seen[i % 4])) root[i] = 0.0;
    return true;
}

void check(Matrix points, Matrix z) {
    std::size_t n = points.shape[0];
    require_shape(points, {n, 4}, "points");
    require_shape(z, {n, 4}, "z_px");
}

}  // namespace

Array<double, 2> seen_points(const Pinholes& p, Matrix z) {
    std::size_t n = z.shape[0];
    require_shape(z, {n, 4}, "z_px");
    return each(z, Array<double, 2>(n, 4), [&](const double* seen, double* point) {
        double disparity = (seen[0] - p.cx_left_px) - (seen[2] - p.cx_right_px);
        point[0] = (seen[0] - p.cx_left_px) / p.f_px;
        point[1] = (seen[1] - p.cy_px) / p.f_px;
        point[2] = 1;
        point[3] = disparity / (p.f_px * p.baseline_m);
    });
}

Array<double, 2> project_points(const Pinholes& pinholes, Matrix points) {
    std::size_t n = points.shape[0];
    require_shape(points, {n, 4}, "points");
    return each(points, Array<double, 2>(n, 4), [&](const double* point, double* z) { project(pinholes, point, z); });
}

Array<double, 3> whitening_of_views(Matrix z, Matrices cov) {
    std::size_t n = z.shape[0];
    require_shape(z, {n, 4}, "z_px");
    require_shape(cov, {n, 4, 4}, "cov_px");
    Array<double, 3> result(n, 4, 4);
    for (std::size_t i = 0; i < n; i++) require_definite(whitening(z[i], cov[i], result[i]), "cov_px is not positive definite");
    return result;
}

Array<double, 1> gates_of_views(Matrix z, double of_one, double of_both) {
    std::size_t n = z.shape[0];
    require_shape(z, {n, 4}, "z_px");
    Array<double, 1> result(n);
    for (std::size_t i = 0; i < n; i++)
        result.data[i] = std::all_of(z[i], z[i] + 4, [](double x) { return std::isfinite(x); }) ? of_both : of_one;
    return result;
}

SelectedViews::SelectedViews(const PointViews& of, const std::vector<std::size_t>& rows)
    : pinholes(of.projection), points(rows_of(of.points, rows)), z(rows_of(of.z_px, rows)),
      cov_points(of.cov_points.shape[0] ? rows_of(of.cov_points, rows) : Array<double, 3>(0, 4, 4)), cov(rows_of(of.cov_px, rows)),
      shared(rows_of(of.shared, rows)), gate(rows_of(of.gate, rows)) {}

WIDER LinearisedViews linearise_views(const PointViews& views, Matrix cam_from_ref) {
    const auto& [pinholes, points, cov_points, z, cov, shared, gate] = views;
    check(points, z);
    std::size_t n = points.shape[0], amplitudes = shared.shape[2], columns = 6 + amplitudes;
    bool exact = cov_points.shape[0] == 0;
    if (!exact) require_shape(cov_points, {n, 4, 4}, "cov_points");
    require_shape(cov, {n, 4, 4}, "cov_px");
    require_shape(shared, {n, 4, amplitudes}, "shared");
    require_shape(gate, {n}, "gate");
    require_shape(cam_from_ref, {4, 4}, "cam_from_ref");
    LinearisedViews result{{n, 4, 4}, {n, 4, columns}};
    const double* motion = cam_from_ref.data;
    for (std::size_t i = 0; i < n; i++) {
        double p[4], a[16], noise[16], *root = result.root[i], *j = result.jacobian[i];
        move(motion, points[i], p);
        clamp_depth(p);
        jacobian(pinholes, p, a);
        std::copy(cov[i], cov[i] + 16, noise);
        bool placed = true;
        if (!exact) {
            double by_point[16], half[16], predicted[16];
            multiply<4, 4, 4>(a, motion, by_point);
            multiply<4, 4, 4>(by_point, cov_points[i], half);
            multiply_transposed<4, 4, 4>(half, by_point, predicted);
            placed = predicted[0] + predicted[5] + predicted[10] + predicted[15] < MAX_PREDICTED_PX2;
            for (int k = 0; placed && k < 16; k++) noise[k] += predicted[k];
        }
        require_definite(whitening(z[i], noise, root), "a view's covariance is not positive definite");
        if (!placed) std::fill(root, root + 16, 0.0);
        double by_cam[16];
        multiply<4, 4, 4>(root, a, by_cam);
        for (std::size_t row = 0; row < 4; row++) {
            const double* b = by_cam + 4 * row;
            double* out = j + row * columns;
            by_motion(b, p, out);
            for (std::size_t c = 0; c < 4; c++) add(root[4 * row + c], shared[i] + c * amplitudes, amplitudes, out + 6);
        }
    }
    return result;
}

WIDER ViewResiduals view_residuals(const PointViews& views, Matrices root, Vector amplitudes, Matrices cams_from_ref) {
    const auto& [pinholes, points, cov_points, z, cov, shared, gate] = views;
    check(points, z);
    std::size_t n = points.shape[0], motions = cams_from_ref.shape[0], j = amplitudes.shape[0];
    require_shape(root, {n, 4, 4}, "root");
    require_shape(shared, {n, 4, j}, "shared");
    require_shape(cams_from_ref, {motions, 4, 4}, "cams_from_ref");
    ViewResiduals result{{motions, n, 4}, {motions, n}};
    for (std::size_t m = 0; m < motions; m++)
        for (std::size_t i = 0; i < n; i++) {
            double p[4], expected[4], difference[4], sum = 0, *r = result.residuals[m] + 4 * i;
            move(cams_from_ref[m], points[i], p);
            bool usable = clamp_depth(p) && root[i][0] != 0;
            project(pinholes, p, expected);
            for (int c = 0; c < 4; c++) {
                for (std::size_t k = 0; k < j; k++) expected[c] += shared[i][c * j + k] * amplitudes.data[k];
                difference[c] = (std::isfinite(z[i][c]) ? z[i][c] : 0.0) - expected[c];  // a missing side has no weight
            }
            for (int c = 0; c < 4; c++) {
                for (int k = 0; k < 4; k++) r[c] += root[i][4 * c + k] * difference[k];
                sum += r[c] * r[c];
            }
            result.squares[m][i] = usable ? sum : std::numeric_limits<double>::infinity();
        }
    return result;
}

}  // namespace core
