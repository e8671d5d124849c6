// Tracks in a new frame: the predicted look of their patches, whether templates allow that warp, and covariances of views.

#include "tracks.hpp"
#include "poses.hpp"
#include "row_timing.hpp"

namespace core {
namespace {

// The warp (3, 2), W above h, of the maps A (2, 2) and n (2,): W = A⁻¹ and h = −Wᵀn; W is finite even if A is singular.
void warp(const double* a, const double* by_depth, double* out) {
    // A surface seen edge-on gets a finite warp that no template fits.
    double det = a[0] * a[3] - a[1] * a[2], safe = std::abs(det) < 1e-3 ? 1e-3 : det;
    out[0] = a[3] / safe;
    out[1] = -a[1] / safe;
    out[2] = -a[2] / safe;
    out[3] = a[0] / safe;
    for (int k = 0; k < 2; k++) out[4 + k] = -(by_depth[0] * out[k] + by_depth[1] * out[2 + k]);
}

void check(const TrackTable& tracks) {
    std::size_t n = tracks.points.shape[0];
    require_shape(tracks.points, {n, 4}, "points");
    require_shape(tracks.var_rho, {n}, "var_rho");
    require_shape(tracks.cov_left_px, {n, 2, 2}, "cov_left_px");
    require_shape(tracks.anchor_from_start, {n, 4, 4}, "anchor_from_start");
    require_shape(tracks.anchor_velocity_px_s, {n, 2}, "anchor_velocity_px_s");
    require_shape(tracks.slopes, {n, 2}, "slopes");
    require_shape(tracks.scale, {n}, "scale");
}

// Warps of the left and of the right image, anchor from now, of a point (4,) in the camera `now_from_anchor` (4, 4).
void warps_of(const Pinholes& pinholes, const double* point, const double* slopes, const double* now_from_anchor,
              double* of_left, double* of_right) {
    const double* m = now_from_anchor;
    double there[4], here[4], moved[6], left[4], right[4], by_depth[2];
    Array<double, 3> anchor = pose_inverse({m, {1, 4, 4}});
    move(anchor[0], point, there);
    double scale = 1 / std::max(there[2], MIN_DEPTH);
    for (double& x : there) x *= scale;
    move(m, there, here);
    double depth = std::max(here[2], MIN_DEPTH);
    for (int row = 0; row < 3; row++)
        for (int k = 0; k < 2; k++) moved[2 * row + k] = m[4 * row + k] + m[4 * row + 3] * slopes[k];
    for (int k = 0; k < 2; k++) {
        for (int row = 0; row < 2; row++) left[2 * row + k] = (moved[2 * row + k] - here[row] / depth * moved[4 + k]) / depth;
        right[k] = left[k] - pinholes.baseline_m * (slopes[k] - here[3] / depth * moved[4 + k]) / depth;
        right[2 + k] = left[2 + k];
        by_depth[k] = moved[4 + k] / depth / pinholes.f_px;
    }
    warp(left, by_depth, of_left);
    warp(right, by_depth, of_right);
}

// I − ż ∇rᵀ seconds (2, 2): the factor that converts a patch to a single exposure time.
void at_one_time(const double* velocity, const double* slope, double seconds, double* out) {
    for (int k = 0; k < 4; k++) out[k] = (k % 3 ? 0.0 : 1.0) - seconds * velocity[k / 2] * slope[k % 2];
}

// A point (4,) transformed into a new camera, at unit depth; returns the divisor.
double move_to_unit_depth(const double* motion, const double* point, double* out) {
    move(motion, point, out);
    double depth = std::max(out[2], MIN_DEPTH);
    for (int k = 0; k < 4; k++) out[k] /= depth;
    return depth;
}

// Corrects the warps for a rolling shutter and points that move, eq. (14b).
void shear_by_readout(const Pinholes& pinholes, const Timing& timing, const TrackTable& tracks, Vector twist,
                      PredictedTracks& now) {
    double readout = timing.mean.data[1];
    if (readout == 0) return;
    Array<double, 2> speeds = velocities(pinholes, now.points, {twist.data, {1, 6}});
    for (std::size_t i = 0; i < now.points.shape[0]; i++) {
        double z[4], slopes[4], of_anchor[4];
        project(pinholes, now.points[i], z);
        slopes_of_rows(timing.row_of, z, slopes);
        at_one_time(tracks.anchor_velocity_px_s[i], slopes, readout, of_anchor);  // rows are nearly parallel in an image
        double det = of_anchor[0] * of_anchor[3] - of_anchor[1] * of_anchor[2];
        double anchor[4] = {of_anchor[3] / det, -of_anchor[1] / det, -of_anchor[2] / det, of_anchor[0] / det};
        for (int side = 0; side < 2; side++) {
            double of_now[4], *w = (side ? now.right_warps : now.left_warps)[i], sheared[6] = {};
            at_one_time(speeds[i] + 2 * side, slopes + 2 * side, readout, of_now);
            for (int row = 0; row < 3; row++)
                for (int k = 0; k < 2; k++) sheared[2 * row + k] = w[2 * row] * of_now[k] + w[2 * row + 1] * of_now[2 + k];
            for (int k = 0; k < 2; k++) {
                w[k] = anchor[0] * sheared[k] + anchor[1] * sheared[2 + k];
                w[2 + k] = anchor[2] * sheared[k] + anchor[3] * sheared[2 + k];
                w[4 + k] = sheared[4 + k];
            }
        }
    }
}

}  // namespace

PredictedTracks predict_tracks(const Pinholes& pinholes, const Timing& timing, Vector twist, const TrackTable& tracks,
                               Matrix cam_from_previous, Matrix cam_from_start, Matrix left, Flags agree) {
    std::size_t n = tracks.points.shape[0];
    check(tracks);
    check(timing);
    require_shape(twist, {6}, "twist");
    require_shape(cam_from_previous, {4, 4}, "cam_from_previous");
    require_shape(cam_from_start, {4, 4}, "cam_from_start");
    require_shape(left, {n, 2}, "left_px");
    require_shape(agree, {n}, "agree");
    Array<double, 3> start_from_anchor = pose_inverse(tracks.anchor_from_start);
    PredictedTracks result{{n, 4}, {n, 2}, {n}, {n, 3, 2}, {n, 3, 2}};
    for (std::size_t i = 0; i < n; i++) {
        double expected[4], now_from_anchor[16];
        move_to_unit_depth(cam_from_previous.data, tracks.points[i], result.points[i]);
        project(pinholes, result.points[i], expected);
        for (int k = 0; k < 2; k++) result.left[i][k] = agree.data[i] ? left[i][k] : expected[k];
        result.right_u.data[i] = result.left[i][0] - expected[0] + expected[2];
        multiply<4, 4, 4>(cam_from_start.data, start_from_anchor[i], now_from_anchor);
        warps_of(pinholes, result.points[i], tracks.slopes[i], now_from_anchor, result.left_warps[i], result.right_warps[i]);
    }
    shear_by_readout(pinholes, timing, tracks, twist, result);
    return result;
}

UpdatedTracks update_depths(const Pinholes& p, const TrackTable& tracks, Matrix cam_from_previous, Matrix z,
                            Matrices cov, double forgetting) {
    std::size_t n = tracks.points.shape[0];
    check(tracks);
    require_shape(cam_from_previous, {4, 4}, "cam_from_previous");
    require_shape(z, {n, 4}, "z_px");
    require_shape(cov, {n, 4, 4}, "cov_px");
    UpdatedTracks result{{n, 4}, {n}, {n, 2, 2}};
    double scale = p.f_px * p.baseline_m;
    for (std::size_t i = 0; i < n; i++) {
        double moved[4], depth = move_to_unit_depth(cam_from_previous.data, tracks.points[i], moved);
        double before = forgetting * tracks.var_rho.data[i] / (depth * depth), gain = 0, rho = moved[3];
        double seen = ((z[i][0] - p.cx_left_px) - (z[i][2] - p.cx_right_px)) / scale;
        if (std::isfinite(seen)) {
            double var = (cov[i][0] + cov[i][10] - 2 * cov[i][2]) / (scale * scale);
            gain = before / (before + var);
            rho += gain * (seen - rho);
        }
        double point[4] = {(z[i][0] - p.cx_left_px) / p.f_px, (z[i][1] - p.cy_px) / p.f_px, 1, rho};
        std::copy_n(point, 4, result.points[i]);
        result.var_rho.data[i] = (1 - gain) * before;
        for (int k = 0; k < 4; k++) result.cov_left[i][k] = cov[i][4 * (k / 2) + k % 2];
    }
    return result;
}

Array<bool, 1> templates_fit(Matrices warps, double radius, double half, double least_area) {
    std::size_t n = warps.shape[0];
    radius += 2;  // for derivatives and interpolation
    require_shape(warps, {n, 3, 2}, "warps");
    Array<bool, 1> result(n);
    for (std::size_t i = 0; i < n; i++) {
        const double* w = warps[i];
        double across = std::max(std::abs(w[0]) + std::abs(w[1]), std::abs(w[2]) + std::abs(w[3])) * radius;
        double by_depth = (std::abs(w[4]) + std::abs(w[5])) * radius, area = std::abs(w[0] * w[3] - w[1] * w[2]);
        result.data[i] = across < half * (1 - by_depth) && area > least_area;
    }
    return result;
}

Array<bool, 1> inside_area(View<bool, 2> area, Matrix at) {
    std::size_t n = at.shape[0];
    require_shape(at, {n, 2}, "at_px");
    double height = static_cast<double>(area.shape[0]), width = static_cast<double>(area.shape[1]);
    Array<bool, 1> result(n);
    for (std::size_t i = 0; i < n; i++) {
        double u = std::nearbyint(at[i][0]), v = std::nearbyint(at[i][1]);
        if (u >= 0 && u < width && v >= 0 && v < height) result.data[i] = area[static_cast<std::size_t>(v)][static_cast<std::size_t>(u)];
    }
    return result;
}

Array<double, 3> view_covariances(Matrices gradients, Vector error_left, Vector error_right, double shared_pixels,
                                  double scale, double factor, const TemplateRules& rules) {
    std::size_t n = gradients.shape[0];
    require_shape(gradients, {n, 2, 2}, "gradients");
    require_shape(error_left, {n}, "error_left");
    require_shape(error_right, {n}, "error_right");
    Array<double, 3> result(n, 4, 4);
    for (std::size_t i = 0; i < n; i++) {
        const double* g = gradients[i];
        // 1e-6 grey² keep the σ of a patch without texture finite.
        double damping = rules.edge_damping * (g[0] + g[3]) + 1e-6, a = g[0] + damping, b = g[3] + damping;
        double det = a * b - g[1] * g[2], shape[4] = {b / det, -g[1] / det, -g[2] / det, a / det};
        for (int side = 0; side < 2; side++) {
            double grey = (side ? error_right : error_left).data[i];
            grey = std::max(std::isfinite(grey) ? grey : rules.unknown_error_grey, rules.least_error_grey / scale);  // a mean over pixels has less
            double variance = 0.5 * shared_pixels * grey * grey;  // half of the variance is that of the template
            double* out = result[i] + 10 * side;
            for (int k = 0; k < 4; k++)
                out[4 * (k / 2) + k % 2] = scale * scale * factor * (variance * shape[k] + (k % 3 ? 0.0 : rules.std_floor_px * rules.std_floor_px));
        }
    }
    return result;
}

Array<double, 3> track_covariances(Matrices cov_left, Vector var_rho, Vector drift, double focal, double baseline) {
    std::size_t n = var_rho.shape[0];
    require_shape(cov_left, {n, 2, 2}, "cov_left_px");
    if (drift.shape[0] != 0) require_shape(drift, {n}, "drift_px");
    Array<double, 3> result(n, 4, 4);
    for (std::size_t i = 0; i < n; i++) {
        double slid = drift.shape[0] ? drift.data[i] / focal : 0.0, *out = result[i];
        for (int k = 0; k < 4; k++) out[4 * (k / 2) + k % 2] = cov_left[i][k] / (focal * focal) + (k % 3 == 0 ? slid * slid : 0.0);
        out[15] = var_rho.data[i] + slid * slid / (baseline * baseline);
    }
    return result;
}

Array<double, 1> template_drift(Matrix points, Matrix cam_from_previous, Indices scale, double slide) {
    std::size_t n = points.shape[0];
    require_shape(points, {n, 4}, "points");
    require_shape(cam_from_previous, {4, 4}, "cam_from_previous");
    require_shape(scale, {n}, "scale");
    double moved = std::sqrt(cam_from_previous[0][3] * cam_from_previous[0][3] + cam_from_previous[1][3] * cam_from_previous[1][3] +
                             cam_from_previous[2][3] * cam_from_previous[2][3]);
    Array<double, 1> result(n);
    for (std::size_t i = 0; i < n; i++)
        result.data[i] = slide * static_cast<double>(scale.data[i]) * std::max(points[i][3], 0.0) * moved;
    return result;
}

}  // namespace core
