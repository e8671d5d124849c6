// The effects of rig errors on views, eqs. (70) to (72d): columns of the terms, the field over the image, velocities.

#include "rig.hpp"

namespace core {
namespace {

enum Term : std::size_t {  // the order of rig_model/terms.py
    DISPARITY, LENS = 6, POINT = 8, TANGENTIAL = 10, DIFFERENCE = 12,
    FOCAL, DELAY, READOUT, TURNING, FOCUSING = TURNING + 3, END
};
constexpr std::size_t TERMS = END;
static_assert(DELAY == AT_TIMING);

// The effect (2, TERMS), px per px, of each lens error on both coordinates of a ray (2,); `corner`: the slope of a corner's ray.
void lens_columns(const double* ray, const double* left_ray, double corner, double* out) {
    double x = ray[0] / corner, y = ray[1] / corner, squared = x * x + y * y;
    for (int i = 0; i < 2; i++) {
        double* of = out + i * TERMS;
        of[LENS] = (i ? y : x) * squared;
        of[LENS + 1] = of[LENS] * squared;
        for (int k = 0; k < 2; k++) of[POINT + k] = -ray[i] * left_ray[k];
        of[TANGENTIAL + i] = (squared + 2 * (i ? y * y : x * x)) / 3;  // 1 px in the direction of the corner
        of[TANGENTIAL + 1 - i] = 2 * x * y / 3;
    }
}

enum { LATE = 2 };  // the coordinate that delay and disparity shift: u on the right

// ∂ż/∂ξ̇ (4, 6) of a homogeneous point, px/s per unit of the points' twist.
void velocity_by_twist(const Pinholes& pinholes, const double* of, double* out) {
    double point[4], a[16];
    std::copy(of, of + 4, point);
    clamp_depth(point);
    jacobian(pinholes, point, a);
    for (int row = 0; row < 4; row++) by_motion(a + 4 * row, point, out + 6 * row);
}

// The velocity (3,) of a homogeneous point (4,) with a twist; its last coordinate does not change.
void motion_of_point(const double* point, const double* twist, double* out) {
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = twist[k] * point[3] + twist[3 + i] * point[j] - twist[3 + j] * point[i];
    }
}

// The velocity (4,) px/s of its view: ∂ż/∂ξ̇ times the twist, without computing that matrix.
void velocity_of_view(const Pinholes& p, const double* of, const double* twist, double* out) {
    double point[4], moves[3];
    std::copy(of, of + 4, point);
    clamp_depth(point);
    motion_of_point(point, twist, moves);
    double s = p.f_px / point[2], nearer = moves[2] / point[2];
    out[0] = s * (moves[0] - point[0] * nearer);
    out[1] = out[3] = s * (moves[1] - point[1] * nearer);
    out[2] = out[0] + s * p.baseline_m * point[3] * nearer;
}

// A homogeneous point (4,) after a short time with a twist.
void moved_by(const double* point, const double* twist, double seconds, double* out) {
    double moves[3];
    motion_of_point(point, twist, moves);
    for (int k = 0; k < 3; k++) out[k] = point[k] + seconds * moves[k];
    out[3] = point[3];
}

// The rows (4,) in which both sides of a view (4,) are exposed: Σ c x^a y^b, x and y from −1 to 1 over the image.
void rows_of_view(const ExposedRows& of, const double* z, double* rows) {
    std::size_t sides = of.coefficients.shape[0], k = of.coefficients.shape[1];
    for (std::size_t side = 0; side < 2; side++) {
        double x = 2 * z[2 * side] / of.size_px[0] - 1, y = 2 * z[2 * side + 1] / of.size_px[1] - 1, sum = 0;
        for (std::size_t a = k; a-- > 0;) {  // Horner's scheme in x and y
            double inner = 0;
            for (std::size_t b = k; b-- > 0;) inner = inner * y + of.coefficients[std::min(side, sides - 1)][a * k + b];
            sum = sum * x + inner;
        }
        rows[2 * side] = rows[2 * side + 1] = sum;
    }
}

// ∂ż/∂ξ̇ (4, 6) of a homogeneous point, and the rows (4,) in which it is seen.
void timing_by_twist(const Pinholes& pinholes, const ExposedRows& exposed, const double* point, double* by_twist, double* rows) {
    double z[4];
    velocity_by_twist(pinholes, point, by_twist);
    project(pinholes, point, z);
    rows_of_view(exposed, z, rows);
}

// A motion (2, 6) with a constant twist (6,).
Array<double, 2> without_acceleration(Vector twist) {
    require_shape(twist, {6}, "twist");
    Array<double, 2> motion(2, 6);
    std::copy_n(twist.data, 6, motion.data.get());
    return motion;
}

// The terms (6,) of the disparity's error at a position in the left image.
void disparity_polynomial(const Pinholes& p, const double* at, double* out) {
    const auto size = p.size();
    double centre[2] = {(size[0] - 1) / 2, (size[1] - 1) / 2};
    double x = (at[0] - centre[0]) / centre[0], y = (at[1] - centre[1]) / centre[1];
    double polynomial[6] = {1, x, y, x * x, x * y, y * y};
    std::copy(polynomial, polynomial + 6, out);
}

// The effect (4, TERMS) of amplitudes of 1 of the terms on a view.
void terms_of_view(const Pinholes& p, Matrix root, const double* z, double age, double* out) {
    const auto size = p.size();
    double corner = std::hypot(std::max(p.cx_left_px, size[0] - p.cx_left_px), std::max(p.cy_px, size[1] - p.cy_px)) / p.f_px;
    double middle[4] = {p.cx_left_px, p.cy_px, p.cx_right_px, p.cy_px}, from_centre[4], rays[4], columns[4 * TERMS] = {};
    double* right = columns + 2 * TERMS;
    disparity_polynomial(p, z, right + DISPARITY);
    for (int c = 0; c < 4; c++) {
        from_centre[c] = z[c] - middle[c];
        rays[c] = from_centre[c] / p.f_px;
    }
    for (int side = 0; side < 4; side += 2) lens_columns(rays + side, rays, corner, columns + side * TERMS);
    right[DIFFERENCE] = right[LENS];
    std::copy(columns + TERMS, columns + 2 * TERMS, right + TERMS);
    for (int c = 0; c < 4; c++) {
        columns[c * TERMS + FOCAL] = from_centre[c];
        columns[c * TERMS + FOCUSING] = age == 0 ? 0.0 : age * from_centre[c];
    }
    if (age != 0) {
        double turn[3] = {rays[2] * rays[3], -1 - rays[2] * rays[2], rays[3]};
        for (int k = 0; k < 3; k++) right[TURNING + k] = age * p.f_px * turn[k];
    }
    for (std::size_t c = 0; c < 4; c++)
        for (std::size_t i = 0; std::isfinite(z[c]) && i < TERMS; i++)
            if (columns[c * TERMS + i] != 0) add(columns[c * TERMS + i], root[i], TERMS, out + c * TERMS);
}

// The field's basis (K,) at (u, v) on the left.
void field_at(const Field& field, const double* at, double* out) {
    const auto& [u, v, length, root] = field;
    std::size_t across = u.shape[0], down = v.shape[0], k = root.shape[1];
    if (!(std::isfinite(at[0]) && std::isfinite(at[1]))) return;
    auto kernel = [length = length](double apart) {
        apart /= length;
        return std::exp(-0.5 * apart * apart);
    };
    std::vector<double> of_u(across);
    for (std::size_t i = 0; i < across; i++) of_u[i] = kernel(at[0] - u.data[i]);
    for (std::size_t row = 0; row < down; row++) {
        double of_v = kernel(at[1] - v.data[row]);
        for (std::size_t i = 0; i < across; i++) add(of_v * of_u[i], root[row * across + i], k, out);
    }
}

}  // namespace

void check(const ExposedRows& exposed) {
    std::size_t sides = exposed.coefficients.shape[0], k = exposed.coefficients.shape[1];
    require_shape(exposed.coefficients, {sides, k, k}, "coefficients");
    require(sides > 0, "there are no coefficients");
}

void check(const Timing& timing) {
    check(timing.row_of);
    require_shape(timing.mean, {2}, "mean");
    require_shape(timing.cov, {2, 2}, "cov");
    if (timing.twist) require_shape(*timing.twist, {6}, "twist");
}

void slopes_of_rows(const ExposedRows& of, const double* z, double* out) {
    double at[4], rows[4];
    rows_of_view(of, z, at);
    for (int along = 0; along < 2; along++) {
        double aside[4];
        for (int c = 0; c < 4; c++) aside[c] = z[c] + (c % 2 == along ? 1 : 0);
        rows_of_view(of, aside, rows);
        for (int side = 0; side < 4; side += 2) out[side + along] = rows[side] - at[side];
    }
}

// An exposure some time after the stamp moves a view by that time times its velocity halfway, which includes acceleration.
void timing_of_view(const Pinholes& pinholes, const ExposedRows& exposed, const double* point, const double* motion,
                    const double* timing, const double* z, double* out) {
    double rows[4], velocity[4], at = std::numeric_limits<double>::quiet_NaN();
    rows_of_view(exposed, z, rows);
    for (int c = 0; c < 4; c++) {
        bool seen = !std::isnan(rows[c]);
        double late = c == LATE && seen, row = seen ? rows[c] : 0.0, half = 0.5 * (late * timing[0] + row * timing[1]);
        if (half != at) {
            double twist[6], halfway[4];
            for (int k = 0; k < 6; k++) twist[k] = motion[k] + half * motion[6 + k];
            moved_by(point, twist, half, halfway);
            velocity_of_view(pinholes, halfway, twist, velocity);
            at = half;
        }
        out[2 * c] = late * velocity[c];
        out[2 * c + 1] = row * velocity[c];
    }
}

RigEffects rig_effects(const Pinholes& pinholes, Matrix root, const Field& field, Matrix z, Vector age) {
    std::size_t n = z.shape[0], ages = age.shape[0], k = field.root.shape[1];
    require_shape(root, {TERMS, TERMS}, "root");
    require_shape(field.root, {field.u_px.shape[0] * field.v_px.shape[0], k}, "root of the field");
    require_shape(z, {n, 4}, "z_px");
    require(ages == 1 || ages == n, "there are not as many ages as views");
    RigEffects result{{n, 4, TERMS}, {n, k}};
    for (std::size_t i = 0; i < n; i++) {
        terms_of_view(pinholes, root, z[i], age.data[ages == 1 ? 0 : i], result.terms[i]);
        field_at(field, z[i], result.field[i]);
    }
    return result;
}

Array<double, 3> disparity_effects(const Pinholes& pinholes, Matrix points, Matrix motion, Matrix z) {
    std::size_t n = points.shape[0];
    require_shape(points, {n, 4}, "points");
    require_shape(motion, {4, 4}, "cam_from_previous");
    require_shape(z, {n, 4}, "z_px");
    Array<double, 3> result(n, 4, 6);
    for (std::size_t i = 0; i < n; i++) {
        double moved[4], expected[4], a[16], polynomial[6];
        move(motion.data, points[i], moved);
        clamp_depth(moved);
        project(pinholes, moved, expected);
        jacobian(pinholes, moved, a);
        bool seen = std::isfinite(z[i][0]) && std::isfinite(z[i][1]);
        disparity_polynomial(pinholes, seen ? z[i] : expected, polynomial);
        for (int c = 0; c < 4; c++) {
            if (!std::isfinite(z[i][c])) continue;
            double by_depth = 0;  // ∂z/∂ρ of the point in the previous camera
            for (int k = 0; k < 4; k++) by_depth += a[4 * c + k] * motion[static_cast<std::size_t>(k)][3];
            double moves = (c == LATE) + by_depth / (pinholes.f_px * pinholes.baseline_m);
            for (int k = 0; k < 6; k++) result[i][6 * c + k] = moves * polynomial[k];
        }
    }
    return result;
}

Array<double, 2> field_basis(const Field& field, Matrix at) {
    std::size_t n = at.shape[0], k = field.root.shape[1];
    require_shape(at, {n, 2}, "left_px");
    require_shape(field.root, {field.u_px.shape[0] * field.v_px.shape[0], k}, "root");
    return each(at, Array<double, 2>(n, k), [&](const double* left, double* out) { field_at(field, left, out); });
}

Array<double, 2> polynomial_rows(const ExposedRows& exposed, Matrix z) {
    check(exposed);
    require_shape(z, {z.shape[0], 4}, "z_px");
    return each(z, Array<double, 2>(z.shape[0], 4),
                [&](const double* view, double* rows) { rows_of_view(exposed, view, rows); });
}

Array<double, 2> velocities(const Pinholes& pinholes, Matrix points, Matrix twists) {
    std::size_t n = points.shape[0], of_all = twists.shape[0] == 1;
    require_shape(points, {n, 4}, "points");
    require_shape(twists, {of_all ? 1 : n, 6}, "twists");
    Array<double, 2> result(n, 4);
    for (std::size_t i = 0; i < n; i++) velocity_of_view(pinholes, points[i], twists[of_all ? 0 : i], result[i]);
    return result;
}

// The speeds at which right sides of points with one twist (6,) cross the rows.
Array<double, 1> row_speeds(const Pinholes& pinholes, Matrix points, Vector twist) {
    require_shape(twist, {6}, "twist");
    Array<double, 2> moved = velocities(pinholes, points, {twist.data, {1, 6}});
    Array<double, 1> result(moved.shape[0]);
    for (std::size_t i = 0; i < moved.shape[0]; i++) result.data[i] = moved[i][3];
    return result;
}

Array<double, 3> timed_views(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Matrix motion,
                             Vector timing, std::optional<Matrix> z) {
    std::size_t n = points.shape[0];
    check(exposed);
    require_shape(points, {n, 4}, "points");
    require_shape(motion, {2, 6}, "motion");
    require_shape(timing, {2}, "timing");
    if (z) require_shape(*z, {n, 4}, "z_px");
    Array<double, 3> result(n, 4, 2);
    for (std::size_t i = 0; i < n; i++) {
        double expected[4];
        project(pinholes, points[i], expected);
        timing_of_view(pinholes, exposed, points[i], motion.data, timing.data, z ? (*z)[i] : expected, result[i]);
    }
    return result;
}

Array<double, 2> shifts_by_timing(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Vector twist,
                                  Vector mean) {
    Array<double, 2> result(points.shape[0], 4), steady = without_acceleration(twist);
    Array<double, 3> moved = timed_views(pinholes, exposed, points, steady, mean, std::nullopt);
    for (std::size_t i = 0; i < 4 * points.shape[0]; i++)
        result.data[i] = moved.data[2 * i] * mean.data[0] + moved.data[2 * i + 1] * mean.data[1];
    return result;
}

WIDER Array<double, 3> timing_unknowns(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points_before,
                                 Vector twist_before, Matrix points, Vector twist, Vector mean, Matrix cov,
                                 std::optional<Vector> std_twist) {
    auto timed = [&](Matrix at, Vector by) {
        Array<double, 2> steady = without_acceleration(by);
        return timed_views(pinholes, exposed, at, steady, mean, std::nullopt);
    };
    Array<double, 3> then = timed(points_before, twist_before), moved = timed(points, twist);
    std::size_t n = points.shape[0];
    require(points_before.shape[0] == n, "there are not as many points before as now");
    require_shape(mean, {2}, "mean");
    require_shape(cov, {2, 2}, "cov");
    if (std_twist) require_shape(*std_twist, {6}, "std_twist");
    double size[2];  // root mean squares
    for (int k = 0; k < 2; k++) size[k] = std::sqrt(mean.data[k] * mean.data[k] + cov[k][k]);
    double root[4];
    require_definite(cholesky<2>(cov.data, root), "the covariance of delay and readout is not positive definite");
    const std::size_t columns = std_twist ? 14 : 2;
    Array<double, 3> result(n, 4, columns);
    for (std::size_t i = 0; i < n; i++) {
        double by_twist[24], rows[4];
        if (std_twist) timing_by_twist(pinholes, exposed, points[i], by_twist, rows);
        for (std::size_t c = 0; c < 4; c++) {
            double* out = result[i] + columns * c;
            for (int k = 0; k < 2; k++)
                for (int l = k; l < 2; l++) out[k] += (moved[i][2 * c + l] - then[i][2 * c + l]) * root[2 * l + k];
            for (int k = 0; std_twist && k < 6; k++) {
                double by_time = std_twist->data[k] * by_twist[6 * c + k];
                if (c == LATE) out[2 + k] = size[0] * by_time;
                out[8 + k] = size[1] * by_time * rows[c];
            }
        }
    }
    return principal_errors(result);
}

WIDER Array<double, 2> principal_components(Matrix errors) {
    std::size_t n = errors.shape[0], k = errors.shape[1];
    require(k <= 1000, "there are too many errors");
    std::vector<double> products(k * k), axes(k * k);
    add_product({errors.data, k}, k, {errors.data, k}, k, n, k, products.data());
    for (std::size_t a = 0; a < k; a++)
        for (std::size_t b = 0; b < a; b++) products[a * k + b] = products[b * k + a];
    const double least = 1e-2;  // px², of all views: the variance of a good one
    // any orthogonal axes give the same errors; these need only tell the negligible ones
    diagonalise(products.data(), axes.data(), k, 1e-4 * least * least);
    std::size_t kept = 0;
    for (std::size_t a = 0; a < k; a++) {
        if (!(products[a * k + a] > least)) continue;
        for (std::size_t b = 0; b < k; b++) axes[b * k + kept] = axes[b * k + a];  // the first columns
        kept++;
    }
    Array<double, 2> result(n, kept);
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t a = 0; a < k; a++) add(errors[i][a], axes.data() + a * k, kept, result[i]);
    return result;
}

Array<double, 3> principal_errors(Matrices errors) {
    std::size_t n = errors.shape[0];
    Array<double, 2> components = principal_components({errors.data, {4 * n, errors.shape[2]}});
    Array<double, 3> result(0, 4, components.shape[1]);
    result.shape[0] = n;
    result.data = std::move(components.data);
    return result;
}

}  // namespace core
