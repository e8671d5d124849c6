// Inertial measurements: preintegrated between two times, and what they say of the poses and velocities at both, eq. (78).

#include "inertial.hpp"
#include "poses.hpp"

namespace core {
namespace {

// Where in the state, after the velocity, stand gravity, biases of gyroscope and accelerometer, scale, axes and clock.
enum : std::size_t { G = 3, B_G = G + 3, B_A = B_G + 3, SCALE = B_A + 3, AXES, CLOCK = AXES + 3, STATE };

struct Vec {
    double x[3];
};
struct Mat {
    double x[9];
};

Vec operator+(const Vec& a, const Vec& b) { return {{a.x[0] + b.x[0], a.x[1] + b.x[1], a.x[2] + b.x[2]}}; }
Vec operator-(const Vec& a, const Vec& b) { return {{a.x[0] - b.x[0], a.x[1] - b.x[1], a.x[2] - b.x[2]}}; }
Vec operator*(double s, const Vec& a) { return {{s * a.x[0], s * a.x[1], s * a.x[2]}}; }
Vec operator*(const Mat& m, const Vec& a) {
    Vec out;
    multiply<3, 3, 1>(m.x, a.x, out.x);
    return out;
}
Mat operator*(const Mat& a, const Mat& b) {
    Mat out;
    multiply<3, 3, 3>(a.x, b.x, out.x);
    return out;
}
Mat transposed(const Mat& a) { return {{a.x[0], a.x[3], a.x[6], a.x[1], a.x[4], a.x[7], a.x[2], a.x[5], a.x[8]}}; }
Mat skew(const Vec& a) { return {{0, -a.x[2], a.x[1], a.x[2], 0, -a.x[0], -a.x[1], a.x[0], 0}}; }
Vec cross(const Vec& a, const Vec& b) { return skew(a) * b; }
Vec vec(const double* a) { return {{a[0], a[1], a[2]}}; }
Mat mat(const double* a) {
    Mat out;
    std::copy_n(a, 9, out.x);
    return out;
}
Mat rotation_in(const double* pose) { return {{pose[0], pose[1], pose[2], pose[4], pose[5], pose[6], pose[8], pose[9], pose[10]}}; }
constexpr Mat EYE{{1, 0, 0, 0, 1, 0, 0, 0, 1}};

Mat exp_so3(const Vec& w) {
    double xi[6] = {0, 0, 0, w.x[0], w.x[1], w.x[2]};
    Array<double, 3> pose = pose_exp({xi, {1, 6}});
    return rotation_in(pose[0]);
}
Vec log_so3(const Mat& r) {
    Array<double, 2> w = rotation_vectors({r.x, {1, 3, 3}});
    return vec(w[0]);
}

// ∂Log(Exp(w) Exp(δ))/∂δ inverted: Exp(w + δ) = Exp(w) Exp(J δ).
Mat right_jacobian(const Vec& w) {
    double angle2 = w.x[0] * w.x[0] + w.x[1] * w.x[1] + w.x[2] * w.x[2], angle = std::sqrt(angle2);
    double a = angle < 1e-4 ? 0.5 - angle2 / 24 : (1 - std::cos(angle)) / angle2;
    double b = angle < 1e-4 ? 1.0 / 6 - angle2 / 120 : (angle - std::sin(angle)) / (angle2 * angle);
    Mat k = skew(w), k2 = k * k, out = EYE;
    for (int i = 0; i < 9; i++) out.x[i] += -a * k.x[i] + b * k2.x[i];
    return out;
}

void put(double* rows, std::size_t stride, std::size_t row, std::size_t column, const Mat& m, double scale = 1) {
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) rows[(row + i) * stride + column + k] += scale * m.x[3 * i + k];
}
void put(double* rows, std::size_t stride, std::size_t row, std::size_t column, const Vec& v) {
    for (int i = 0; i < 3; i++) rows[(row + i) * stride + column] += v.x[i];
}

// One step of the integration: F (9, 9) of (rotation, velocity, position) and B (9, 6) of the samples' errors.
void step_errors(const Mat& r, const Mat& turn, const Vec& w, const Vec& a, double h, double* f, double* b) {
    std::fill(f, f + 81, 0.0);
    std::fill(b, b + 54, 0.0);
    Mat of_turn = r * skew(a);
    put(f, 9, 0, 0, transposed(turn));
    put(f, 9, 3, 0, of_turn, -h);
    put(f, 9, 3, 3, EYE);
    put(f, 9, 6, 0, of_turn, -0.5 * h * h);
    put(f, 9, 6, 3, EYE, h);
    put(f, 9, 6, 6, EYE);
    put(b, 6, 0, 0, right_jacobian(h * w), -h);
    // an error of the gyroscope turns the accelerations of its own step by half of it, and by a sixth in the position
    Mat turned = of_turn * right_jacobian(h * w);
    put(b, 6, 3, 0, turned, h * h / 2);
    put(b, 6, 6, 0, turned, h * h * h / 6);
    put(b, 6, 3, 3, r * exp_so3(0.5 * h * w), -h);
    put(b, 6, 6, 3, r * exp_so3((h / 3) * w), -0.5 * h * h);
}

// cov (9, 9) becomes F cov Fᵀ + var B Bᵀ over three columns of B from `first` on.
void propagate(double* cov, const double* f, const double* b, std::size_t first, double var) {
    double product[81];
    multiply<9, 9, 9>(f, cov, product);
    multiply_transposed<9, 9, 9>(product, f, cov);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++)
            for (std::size_t k = first; k < first + 3; k++) cov[9 * i + j] += var * b[6 * i + k] * b[6 * j + k];
}

// The interval between two frames at the biases and the clock offset of a state.
struct Corrected {
    Mat r;
    Vec v, p, clock[3];

    Corrected(const IntervalViews& of, std::size_t n, const double* s) {
        double by_bias[9], change[6];
        for (int k = 0; k < 6; k++) change[k] = s[B_G + k] - of.biases[n][k];
        multiply<9, 6, 1>(of.by_bias[n], change, by_bias);
        double late = s[CLOCK] - of.clock.data[n];
        for (int k = 0; k < 3; k++) clock[k] = vec(of.by_clock[n] + 3 * k);
        r = mat(of.rotation[n]) * exp_so3(vec(by_bias)) * exp_so3(late * clock[0]);
        v = vec(of.motion[n]) + vec(by_bias + 3) + late * clock[1];
        p = vec(of.motion[n] + 3) + vec(by_bias + 6) + late * clock[2];
    }
};

// The residual (9,) of interval n and its Jacobian (9, columns): poses from column 6n − 6 on, the state at 6F, velocities.
void residual_of(const IntervalViews& of, std::size_t n, Matrices cams, Matrix velocities, const double* s,
                 const Mat& axes, const Vec& lever, double* e, double* j, std::size_t columns) {
    std::size_t frames = of.seconds.shape[0], at_s = 6 * frames, at_v = at_s + STATE;
    const double *cam_i = cams[n], *cam_j = cams[n + 1];
    Mat ri = transposed(rotation_in(cam_i)), rj = transposed(rotation_in(cam_j));
    Vec pi = -1 * (ri * Vec{{cam_i[3], cam_i[7], cam_i[11]}}), pj = -1 * (rj * Vec{{cam_j[3], cam_j[7], cam_j[11]}});
    Mat mounted = axes * exp_so3(vec(s + AXES)), to_cam = transposed(mounted);
    Vec vi = vec(velocities[n]), vj = vec(velocities[n + 1]), gravity = vec(s + G);
    double scale = 1 + s[SCALE], t = of.seconds.data[n];
    Corrected d(of, n, s);
    Mat bi = transposed(ri * mounted), m = bi * (rj * mounted), mt = transposed(m);
    Vec dv = rj * vj - ri * vi - t * gravity;
    Vec dp = scale * (pj - pi) + rj * lever - ri * lever - t * (ri * vi) - (0.5 * t * t) * gravity;
    Vec own_v = bi * dv, own_p = bi * dp, er = log_so3(transposed(d.r) * m), ev = own_v - d.v, ep = own_p - d.p;
    for (int k = 0; k < 3; k++) e[k] = er.x[k], e[3 + k] = ev.x[k], e[6 + k] = ep.x[k];
    auto at = [&](std::size_t row, std::size_t column, const Mat& block, double by = 1) { put(j, columns, row, column, block, by); };
    std::size_t xi = 6 * n - 6, xj = 6 * n;  // xi: of none where n is 0
    Mat bi_ri = bi * ri, bi_rj = bi * rj;
    at(0, xj + 3, to_cam, -1);
    Mat sv = skew(own_v), sp = skew(own_p), of_axes = right_jacobian(vec(s + AXES));
    at(0, at_s + AXES, of_axes);
    at(0, at_s + AXES, mt * of_axes, -1);
    at(3, at_s + AXES, sv * of_axes);
    at(6, at_s + AXES, sp * of_axes);
    at(3, xj + 3, bi_rj * skew(vj));
    at(6, xj, bi_rj, -scale);
    at(6, xj + 3, bi_rj * skew(lever));
    if (n > 0) {
        at(0, xi + 3, mt * to_cam);
        at(3, xi + 3, sv * to_cam, -1);
        at(6, xi + 3, sp * to_cam, -1);
        at(3, xi + 3, bi_ri * skew(vi), -1);
        at(6, xi, bi_ri, scale);
        at(6, xi + 3, bi_ri * skew(t * vi + lever), -1);
    }
    std::size_t of_vi = n > 0 ? at_v + 3 * n - 3 : at_s;
    at(3, of_vi, bi_ri, -1);
    at(6, of_vi, bi_ri, -t);
    at(3, at_v + 3 * n, bi_rj);
    put(j, columns, 6, at_s + SCALE, bi * (pj - pi));
    at(3, at_s + G, bi, -t);
    at(6, at_s + G, bi, -0.5 * t * t);
    for (std::size_t row = 0; row < 9; row++)
        for (std::size_t k = 0; k < 6; k++) j[row * columns + at_s + B_G + k] -= of.by_bias[n][6 * row + k];
    for (int k = 0; k < 3; k++) put(j, columns, 3 * k, at_s + CLOCK, -1 * d.clock[k]);
}

}  // namespace

Preintegrated preintegrate(Vector seconds, Matrix gyro, Matrix accel, Vector widened, Vector biases, Vector densities) {
    std::size_t n = seconds.shape[0];
    require(n > 1, "an interval needs two samples");
    require_shape(gyro, {n, 3}, "gyro");
    require_shape(accel, {n, 3}, "accel");
    require_shape(widened, {n - 1}, "widened");
    require_shape(biases, {6}, "biases");
    require_shape(densities, {2}, "densities");
    Preintegrated out;
    Mat r = EYE;
    Vec v{}, p{}, bg = vec(biases.data), ba = vec(biases.data + 3);
    double f[81], b[54], moved[54];
    for (std::size_t k = 0; k + 1 < n; k++) {
        double h = seconds.data[k + 1] - seconds.data[k];
        if (!(h > 0)) continue;
        Vec w0 = vec(gyro[k]) - bg, w1 = vec(gyro[k + 1]) - bg, a0 = vec(accel[k]) - ba, a1 = vec(accel[k + 1]) - ba;
        Vec mean = 0.5 * (w0 + w1), turned = h * mean + (h * h / 12) * cross(w0, w1);  // the second: coning
        Mat turn = exp_so3(turned), half = exp_so3((h / 8) * (3 * w0 + w1)), next = r * turn;
        Vec first = r * a0, middle = r * (half * (0.5 * (a0 + a1))), last = next * a1;  // Simpson's rule
        step_errors(r, turn, mean, 0.5 * (a0 + a1), h, f, b);
        double var = widened.data[k] / h;
        propagate(out.cov_gyro[0], f, b, 0, var * densities.data[0] * densities.data[0]);
        propagate(out.cov_accel[0], f, b, 3, var * densities.data[1] * densities.data[1]);
        multiply<9, 9, 6>(f, out.by_bias[0], moved);
        for (int i = 0; i < 54; i++) out.by_bias[0][i] = moved[i] + b[i];
        p = p + h * v + (h * h / 6) * (first + 2 * middle);
        v = v + (h / 6) * (first + 4 * middle + last);
        r = next;
    }
    double total = seconds.data[n - 1] - seconds.data[0];
    Vec w0 = vec(gyro[0]) - bg, w1 = vec(gyro[n - 1]) - bg, a0 = vec(accel[0]) - ba, a1 = vec(accel[n - 1]) - ba;
    Vec by_clock[3] = {w1 - transposed(r) * w0, r * a1 - a0 - cross(w0, v), v - total * a0 - cross(w0, p)};
    std::copy_n(r.x, 9, out.rotation[0]);
    for (int k = 0; k < 3; k++) {
        out.motion[0][k] = v.x[k];
        out.motion[1][k] = p.x[k];
        std::copy_n(by_clock[k].x, 3, out.by_clock[k]);
    }
    return out;
}

InertialRows inertial_rows(const IntervalViews& of, Matrices cams, Matrix velocities, Vector state, Matrix cam_from_imu) {
    std::size_t n = of.seconds.shape[0], columns = 9 * n + STATE;
    require_shape(of.rotation, {n, 3, 3}, "rotation");
    require_shape(of.motion, {n, 6}, "motion");
    require_shape(of.by_bias, {n, 9, 6}, "by_bias");
    require_shape(of.by_clock, {n, 9}, "by_clock");
    require_shape(of.cov, {n, 9, 9}, "cov");
    require_shape(of.biases, {n, 6}, "biases");
    require_shape(of.clock, {n}, "clock");
    require_shape(cams, {n + 1, 4, 4}, "cams");
    require_shape(velocities, {n + 1, 3}, "velocities");
    require_shape(state, {STATE}, "state");
    require_shape(cam_from_imu, {4, 4}, "cam_from_imu");
    InertialRows rows{{9 * n}, {9 * n, columns}};
    Mat axes = rotation_in(cam_from_imu.data);
    Vec lever{{cam_from_imu.data[3], cam_from_imu.data[7], cam_from_imu.data[11]}};
    for (std::size_t k = 0; k < n; k++) {
        double *e = rows.residual.data.get() + 9 * k, *j = rows.jacobian[9 * k], scale[9], scaled[81], lower[81];
        residual_of(of, k, cams, velocities, state.data, axes, lever, e, j, columns);
        for (int i = 0; i < 9; i++) scale[i] = 1 / std::sqrt(of.cov[k][10 * i]);
        for (int i = 0; i < 81; i++) scaled[i] = of.cov[k][i] * scale[i / 9] * scale[i % 9];
        require_definite(cholesky<9>(scaled, lower), "the covariance of an interval is not definite");
        for (std::size_t row = 0; row < 9; row++) {  // L⁻¹ from the left, row by row
            e[row] *= scale[row];
            for (std::size_t c = 0; c < columns; c++) j[row * columns + c] *= scale[row];
            for (std::size_t i = 0; i < row; i++) {
                e[row] -= lower[9 * row + i] * e[i];
                add(-lower[9 * row + i], j + i * columns, columns, j + row * columns);
            }
            e[row] /= lower[10 * row];
            for (std::size_t c = 0; c < columns; c++) j[row * columns + c] /= lower[10 * row];
        }
    }
    return rows;
}

InertialMotion inertial_motion(const IntervalViews& of, Vector state, Matrix cam_from_imu) {
    require(of.seconds.shape[0] == 1, "one interval");
    require_shape(of.rotation, {1, 3, 3}, "rotation");
    require_shape(of.motion, {1, 6}, "motion");
    require_shape(of.by_bias, {1, 9, 6}, "by_bias");
    require_shape(of.by_clock, {1, 9}, "by_clock");
    require_shape(of.cov, {1, 9, 9}, "cov");
    require_shape(of.biases, {1, 6}, "biases");
    require_shape(of.clock, {1}, "clock");
    require_shape(state, {STATE}, "state");
    require_shape(cam_from_imu, {4, 4}, "cam_from_imu");
    InertialMotion out;
    const double* s = state.data;
    Corrected d(of, 0, s);
    Mat mounted = rotation_in(cam_from_imu.data) * exp_so3(vec(s + AXES)), turned = mounted * d.r * transposed(mounted);
    Vec lever{{cam_from_imu.data[3], cam_from_imu.data[7], cam_from_imu.data[11]}};
    double t = of.seconds.data[0];
    Mat back = transposed(turned);
    Vec moved = (1 / (1 + s[SCALE])) * (lever + t * vec(s) + (0.5 * t * t) * vec(s + G) + mounted * d.p - turned * lever);
    Vec velocity = back * (vec(s) + t * vec(s + G) + mounted * d.v), gravity = back * vec(s + G);
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) out.previous_from_now[0][4 * i + k] = turned.x[3 * i + k];
        out.previous_from_now[0][4 * i + 3] = moved.x[i];
    }
    out.previous_from_now[0][15] = 1;
    std::copy_n(s, STATE, out.state.data.get());
    std::copy_n(velocity.x, 3, out.state.data.get());
    std::copy_n(gravity.x, 3, out.state.data.get() + G);
    return out;
}

}  // namespace core
