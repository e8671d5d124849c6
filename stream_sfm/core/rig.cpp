// What errors of the rig do to views, eqs. (70) to (72d): columns of its terms, the field over the image, velocities.

#include <cmath>
#include <vector>

#include "algebra.hpp"
#include "stages.hpp"

namespace core {
namespace {

constexpr double LEAST_PX2 = 1e-2;  // of a component of errors, summed over all views: the variance of one good view
constexpr std::size_t TERMS = 20;  // the order of rig_model/terms.py
enum Term { DISPARITY = 0, LENS = 6, POINT = 8, TANGENTIAL = 10, DIFFERENCE = 12, FOCAL, DELAY, READOUT, TURNING, FOCUSING = 19 };

// Both coordinates (2, TERMS) of a ray (2,), px per pixel of each error of a lens; `corner` is the slope of that ray.
void lens_columns(const double* ray, const double* left_ray, double corner, double* out) {
    double x = ray[0] / corner, y = ray[1] / corner, squared = x * x + y * y;
    for (int i = 0; i < 2; i++) {
        double* of = out + i * TERMS;
        of[LENS] = (i ? y : x) * squared;
        of[LENS + 1] = of[LENS] * squared;
        for (int k = 0; k < 2; k++) of[POINT + k] = -ray[i] * left_ray[k];
        of[TANGENTIAL + i] = (squared + 2 * (i ? y * y : x * x)) / 3;  // 1 px in the corner's direction
        of[TANGENTIAL + 1 - i] = 2 * x * y / 3;
    }
}

constexpr int LATE = 2;  // the coordinate that a delay moves: u on the right, as it is told from other rows that v is not moved

// ∂ż/∂ξ̇ (4, 6) of a homogeneous point, px/s per unit of the points' twist.
void velocity_by_twist(const Pinholes& pinholes, const double* of, double* out) {
    double point[4], a[16];
    std::copy(of, of + 4, point);
    clamp_depth(point);
    jacobian(pinholes, point, a);
    for (int row = 0; row < 4; row++) by_motion(a + 4 * row, point, out + 6 * row);
}

void velocity_of(const double* by_twist, const double* twist, double* out) {
    for (int c = 0; c < 4; c++) {
        out[c] = 0;
        for (int k = 0; k < 6; k++) out[c] += by_twist[6 * c + k] * twist[k];
    }
}

double share(double row) { return std::isnan(row) ? 0.0 : row; }  // of a side that was not seen

}  // namespace

Array<double, 3> rig_columns(const Pinholes& p, const std::array<double, 2>& size, const View<double, 2>& z,
                             const View<double, 2>* velocity, const View<double, 2>* row, const View<double, 1>& age) {
    std::size_t n = z.shape[0];
    require_shape(z, {n, 4}, "z_px");
    require_shape(age, {n}, "age_s");
    if (velocity) require_shape(*velocity, {n, 4}, "velocity_px_s");
    if (row) require_shape(*row, {n, 4}, "row");
    Array<double, 3> result({n, 4, TERMS});
    double centre[2] = {(size[0] - 1) / 2, (size[1] - 1) / 2};
    double corner = std::hypot(std::max(p.cx_left, size[0] - p.cx_left), std::max(p.cy, size[1] - p.cy)) / p.f;
    double middle[4] = {p.cx_left, p.cy, p.cx_right, p.cy};
    for (std::size_t i = 0; i < n; i++) {
        double *out = result[i], *right = out + 2 * TERMS, from_centre[4], rays[4];
        double x = (z[i][0] - centre[0]) / centre[0], y = (z[i][1] - centre[1]) / centre[1];
        double polynomial[6] = {1, x, y, x * x, x * y, y * y};
        std::copy(polynomial, polynomial + 6, right + DISPARITY);
        for (int c = 0; c < 4; c++) {
            from_centre[c] = z[i][c] - middle[c];
            rays[c] = from_centre[c] / p.f;
        }
        for (int side = 0; side < 4; side += 2) lens_columns(rays + side, rays, corner, out + side * TERMS);
        right[DIFFERENCE] = right[LENS];
        std::copy(out + TERMS, out + 2 * TERMS, right + TERMS);
        if (velocity && row) right[DELAY] = (*velocity)[i][2];
        for (int c = 0; c < 4; c++) {
            out[c * TERMS + FOCAL] = from_centre[c];
            if (velocity && row) out[c * TERMS + READOUT] = (*velocity)[i][c] * (*row)[i][c];
            out[c * TERMS + FOCUSING] = age.data[i] == 0 ? 0.0 : age.data[i] * from_centre[c];
        }
        if (age.data[i] != 0) {
            double turn[3] = {rays[2] * rays[3], -1 - rays[2] * rays[2], rays[3]};
            for (int k = 0; k < 3; k++) right[TURNING + k] = age.data[i] * p.f * turn[k];
        }
        for (int c = 0; c < 4; c++)
            if (!std::isfinite(z[i][c])) std::fill(out + c * TERMS, out + (c + 1) * TERMS, 0.0);
    }
    return result;
}

Array<double, 2> field_basis(const Field& field, const View<double, 2>& at) {
    const auto& [u, v, length, root] = field;
    std::size_t n = at.shape[0], across = u.shape[0], down = v.shape[0], k = across * down;
    require_shape(at, {n, 2}, "left_px");
    require_shape(root, {k, k}, "root");
    Array<double, 2> result({n, k});
    std::vector<double> of_u(across), of_v(down);
    auto kernel = [length = length](double from, const View<double, 1>& nodes, std::vector<double>& out) {
        for (std::size_t i = 0; i < nodes.shape[0]; i++) {
            double apart = (from - nodes.data[i]) / length;
            out[i] = std::exp(-0.5 * apart * apart);
        }
    };
    for (std::size_t i = 0; i < n; i++) {
        if (!(std::isfinite(at[i][0]) && std::isfinite(at[i][1]))) continue;
        kernel(at[i][0], u, of_u);
        kernel(at[i][1], v, of_v);
        double* out = result[i];
        for (std::size_t node = 0; node < k; node++) {
            double value = of_v[node / across] * of_u[node % across];
            for (std::size_t c = 0; c < k; c++) out[c] += value * root[node][c];
        }
    }
    return result;
}

Array<double, 2> polynomial_rows(const ExposedRows& exposed, const View<double, 2>& z) {
    const auto& [size, coefficients] = exposed;
    std::size_t n = z.shape[0], sides = coefficients.shape[0], k = coefficients.shape[1];
    require_shape(z, {n, 4}, "z_px");
    require_shape(coefficients, {sides, k, k}, "coefficients");
    require(sides > 0, "there are no coefficients");
    Array<double, 2> result({n, 4});
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t side = 0; side < 2; side++) {
            double x = 2 * z[i][2 * side] / size[0] - 1, y = 2 * z[i][2 * side + 1] / size[1] - 1, sum = 0;
            for (std::size_t a = k; a-- > 0;) {  // Horner's scheme in both
                double inner = 0;
                for (std::size_t b = k; b-- > 0;) inner = inner * y + coefficients[std::min(side, sides - 1)][a * k + b];
                sum = sum * x + inner;
            }
            result[i][2 * side] = result[i][2 * side + 1] = sum;
        }
    return result;
}

Array<double, 2> velocities(const Pinholes& pinholes, const View<double, 2>& points, const View<double, 2>& twists) {
    std::size_t n = points.shape[0], of_all = twists.shape[0] == 1;
    require_shape(points, {n, 4}, "points");
    require_shape(twists, {of_all ? 1 : n, 6}, "twists");
    Array<double, 2> result({n, 4});
    for (std::size_t i = 0; i < n; i++) {
        double by_twist[24];
        velocity_by_twist(pinholes, points[i], by_twist);
        velocity_of(by_twist, twists[of_all ? 0 : i], result[i]);
    }
    return result;
}

// How fast right sides of points that move with one twist (6,) cross the rows.
Array<double, 1> row_speeds(const Pinholes& pinholes, const View<double, 2>& points, const View<double, 1>& twist) {
    require_shape(twist, {6}, "twist");
    return column_of(velocities(pinholes, points, {twist.data, {1, 6}}).view(), 3);
}

Array<double, 3> timed_views(const Pinholes& pinholes, const View<double, 2>& points, const View<double, 2>& twists,
                             const View<double, 2>& row) {
    std::size_t n = points.shape[0], of_all = twists.shape[0] == 1;
    require_shape(points, {n, 4}, "points");
    require_shape(twists, {of_all ? 1 : n, 6}, "twists");
    require_shape(row, {n, 4}, "row");
    Array<double, 3> result({n, 4, 2});
    for (std::size_t i = 0; i < n; i++) {
        double by_twist[24], velocity[4];
        velocity_by_twist(pinholes, points[i], by_twist);
        velocity_of(by_twist, twists[of_all ? 0 : i], velocity);
        if (!std::isnan(row[i][LATE])) result[i][2 * LATE] = velocity[LATE];
        for (int c = 0; c < 4; c++) result[i][2 * c + 1] = velocity[c] * share(row[i][c]);
    }
    return result;
}

Array<double, 2> shifts_by_timing(const Pinholes& pinholes, const ExposedRows& exposed, const View<double, 2>& points,
                                  const View<double, 1>& twist, const View<double, 1>& mean) {
    require_shape(twist, {6}, "twist");
    require_shape(mean, {2}, "mean");
    Array<double, 2> row = polynomial_rows(exposed, project_points(pinholes, points).view()), result({points.shape[0], 4});
    Array<double, 3> moved = timed_views(pinholes, points, {twist.data, {1, 6}}, row.view());
    for (std::size_t i = 0; i < 4 * points.shape[0]; i++)
        result.data[i] = moved.data[2 * i] * mean.data[0] + moved.data[2 * i + 1] * mean.data[1];
    return result;
}

Array<double, 3> timing_unknowns(const Pinholes& pinholes, const TimedPoints& before, const TimedPoints& now, const View<double, 2>& cov,
                                 const View<double, 1>& size, const View<double, 1>& std_twist) {
    Array<double, 3> then = timed_views(pinholes, before.points, before.twists, before.row);
    Array<double, 3> moved = timed_views(pinholes, now.points, now.twists, now.row);
    std::size_t n = now.points.shape[0];
    require(before.points.shape[0] == n, "there are not as many points before as now");
    require_shape(cov, {2, 2}, "cov");
    require_shape(size, {2}, "size");
    require_shape(std_twist, {6}, "std_twist");
    double root[4];
    require_definite(cholesky<2>(cov.data, root), "the covariance of delay and readout is not positive definite");
    Array<double, 3> result({n, 4, 14});
    for (std::size_t i = 0; i < n; i++) {
        double by_twist[24];
        velocity_by_twist(pinholes, now.points[i], by_twist);
        for (int c = 0; c < 4; c++) {
            double* out = result[i] + 14 * c;
            for (int k = 0; k < 2; k++)
                for (int l = k; l < 2; l++) out[k] += (moved[i][2 * c + l] - then[i][2 * c + l]) * root[2 * l + k];
            for (int k = 0; k < 6; k++) {
                double by_time = std_twist.data[k] * by_twist[6 * c + k];
                if (c == LATE) out[2 + k] = size.data[0] * by_time;
                out[8 + k] = size.data[1] * by_time * share(now.row[i][c]);
            }
        }
    }
    return principal_errors(result.view());
}

Array<double, 2> cov_of_timed_pose(const Pinholes& pinholes, const View<double, 2>& points, const View<double, 2>& row,
                                   const View<double, 1>& size, const View<double, 2>& cov_twist) {
    std::size_t n = points.shape[0];
    require_shape(points, {n, 4}, "points");
    require_shape(row, {n, 4}, "row");
    require_shape(size, {2}, "size");
    require_shape(cov_twist, {6, 6}, "cov_twist");
    std::vector<double> information(36);
    double moved[2][36] = {};  // transposed: by which twists the gradient of a pose is moved
    for (std::size_t i = 0; i < n; i++) {
        double by_twist[24];
        velocity_by_twist(pinholes, points[i], by_twist);
        for (int c = 0; c < 4; c++)
            for (int a = 0; a < 6; a++)
                for (int b = 0; b < 6; b++) {
                    double squared = by_twist[6 * c + a] * by_twist[6 * c + b];
                    information[6 * a + b] += squared;
                    if (c == LATE) moved[0][6 * b + a] += size.data[0] * squared;
                    moved[1][6 * b + a] += size.data[1] * share(row[i][c]) * squared;
                }
    }
    Array<double, 2> result({6, 6});
    for (auto& gain : moved) {
        for (int b = 0; b < 6; b++) {
            std::vector<double> factor = information;
            solve_damped(factor, gain + 6 * b, 6);
        }
        double half[36] = {};
        for (int b = 0; b < 6; b++)
            for (int c = 0; c < 6; c++)
                for (int a = 0; a < 6; a++) half[6 * a + c] += gain[6 * b + a] * cov_twist[b][c];
        for (int c = 0; c < 6; c++)
            for (int a = 0; a < 6; a++)
                for (int b = 0; b < 6; b++) result[a][b] += half[6 * a + c] * gain[6 * c + b];
    }
    return result;
}

Array<double, 2> principal_components(const View<double, 2>& errors) {
    std::size_t n = errors.shape[0], k = errors.shape[1];
    require(k <= 1000, "there are too many errors");
    std::vector<double> products(k * k), axes(k * k);
    add_product({errors.data, k}, k, {errors.data, k}, k, n, k, products.data());
    for (std::size_t a = 0; a < k; a++)
        for (std::size_t b = 0; b < a; b++) products[a * k + b] = products[b * k + a];
    diagonalise(products.data(), axes.data(), k);
    std::size_t kept = 0;
    for (std::size_t a = 0; a < k; a++) {
        if (!(products[a * k + a] > LEAST_PX2)) continue;
        for (std::size_t b = 0; b < k; b++) axes[b * k + kept] = axes[b * k + a];  // the first columns
        kept++;
    }
    Array<double, 2> result({n, kept});
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t a = 0; a < k; a++) add(errors[i][a], axes.data() + a * k, kept, result[i]);
    return result;
}

Array<double, 3> principal_errors(const View<double, 3>& errors) {
    std::size_t n = errors.shape[0];
    Array<double, 2> components = principal_components({errors.data, {4 * n, errors.shape[2]}});
    Array<double, 3> result({0, 4, components.shape[1]});
    result.shape[0] = n;
    result.data = std::move(components.data);
    return result;
}

}  // namespace core
