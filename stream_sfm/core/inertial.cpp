// Inertial measurements: preintegration between two times, and residuals by the poses and velocities at both, eq. (78).

#include "inertial.hpp"
#include "poses.hpp"
#include "vectors3.hpp"

namespace core {
namespace {

// Positions in the state, after the velocity: gravity, biases of gyroscope and accelerometer, scale, axes and clock.
enum : std::size_t { G = 3, B_G = G + 3, B_A = B_G + 3, SCALE = B_A + 3, AXES, CLOCK = AXES + 3, STATE };
constexpr std::size_t SIZE = 6 + STATE;  // of a pose and a state
constexpr double HERE[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};  // the reference camera in its own axes

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
    // an error of the gyroscope rotates the accelerations of its own step by half of it, and by a sixth in the position
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

// The interval between two frames, at the biases and the clock offset of a state.
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

// The whitened residual (9,) of one interval and its Jacobian (9, 35) by both poses, perturbed on the left, the state
// of the reference, and both velocities.
struct Rows9 {
    enum : std::size_t { POSE_I, POSE_J = 6, OF_STATE = 12, VELOCITY_I = OF_STATE + STATE, VELOCITY_J = VELOCITY_I + 3, COLUMNS = VELOCITY_J + 3 };
    double e[9] = {}, j[9 * COLUMNS] = {};

    void at(std::size_t row, std::size_t column, const Mat& block, double by = 1) { put(j, COLUMNS, row, column, block, by); }

    Rows9(const IntervalViews& of, std::size_t n, const double* cam_i, const double* cam_j, const Vec& vi, const Vec& vj,
          const double* s, const Mat& axes, const Vec& lever) {
        Mat ri = transposed(rotation_in(cam_i)), rj = transposed(rotation_in(cam_j));
        Vec pi = -1 * (ri * Vec{{cam_i[3], cam_i[7], cam_i[11]}}), pj = -1 * (rj * Vec{{cam_j[3], cam_j[7], cam_j[11]}});
        Mat mounted = axes * exp_so3(vec(s + AXES)), to_cam = transposed(mounted);
        Vec gravity = vec(s + G);
        double scale = 1 + s[SCALE], t = of.seconds.data[n];
        Corrected d(of, n, s);
        Mat bi = transposed(ri * mounted), m = bi * (rj * mounted), mt = transposed(m);
        Vec dv = rj * vj - ri * vi - t * gravity;
        Vec dp = scale * (pj - pi) + rj * lever - ri * lever - t * (ri * vi) - (0.5 * t * t) * gravity;
        Vec own_v = bi * dv, own_p = bi * dp, er = log_so3(transposed(d.r) * m), ev = own_v - d.v, ep = own_p - d.p;
        for (int k = 0; k < 3; k++) e[k] = er.x[k], e[3 + k] = ev.x[k], e[6 + k] = ep.x[k];
        Mat bi_ri = bi * ri, bi_rj = bi * rj;
        Mat sv = skew(own_v), sp = skew(own_p), of_axes = right_jacobian(vec(s + AXES));
        at(0, POSE_J + 3, to_cam, -1);
        at(3, POSE_J + 3, bi_rj * skew(vj));
        at(6, POSE_J, bi_rj, -scale);
        at(6, POSE_J + 3, bi_rj * skew(lever));
        at(0, POSE_I + 3, mt * to_cam);
        at(3, POSE_I + 3, sv * to_cam, -1);
        at(6, POSE_I + 3, sp * to_cam, -1);
        at(3, POSE_I + 3, bi_ri * skew(vi), -1);
        at(6, POSE_I, bi_ri, scale);
        at(6, POSE_I + 3, bi_ri * skew(t * vi + lever), -1);
        at(0, OF_STATE + AXES, of_axes);
        at(0, OF_STATE + AXES, mt * of_axes, -1);
        at(3, OF_STATE + AXES, sv * of_axes);
        at(6, OF_STATE + AXES, sp * of_axes);
        at(3, VELOCITY_I, bi_ri, -1);
        at(6, VELOCITY_I, bi_ri, -t);
        at(3, VELOCITY_J, bi_rj);
        put(j, COLUMNS, 6, OF_STATE + SCALE, bi * (pj - pi));
        at(3, OF_STATE + G, bi, -t);
        at(6, OF_STATE + G, bi, -0.5 * t * t);
        for (std::size_t row = 0; row < 9; row++)
            for (std::size_t k = 0; k < 6; k++) j[row * COLUMNS + OF_STATE + B_G + k] -= of.by_bias[n][6 * row + k];
        for (int k = 0; k < 3; k++) put(j, COLUMNS, 3 * k, OF_STATE + CLOCK, -1 * d.clock[k]);
        whiten(of.cov[n]);
    }

    void whiten(const double* cov) {
        double scale[9], scaled[81], lower[81];
        for (int i = 0; i < 9; i++) scale[i] = 1 / std::sqrt(cov[10 * i]);
        for (int i = 0; i < 81; i++) scaled[i] = cov[i] * scale[i / 9] * scale[i % 9];
        require_definite(cholesky<9>(scaled, lower), "the covariance of an interval is not definite");
        for (std::size_t row = 0; row < 9; row++) {  // L⁻¹ from the left, row by row
            double* own = j + row * COLUMNS;
            e[row] *= scale[row];
            for (std::size_t c = 0; c < COLUMNS; c++) own[c] *= scale[row];
            for (std::size_t i = 0; i < row; i++) {
                e[row] -= lower[9 * row + i] * e[i];
                add(-lower[9 * row + i], j + i * COLUMNS, COLUMNS, own);
            }
            e[row] /= lower[10 * row];
            for (std::size_t c = 0; c < COLUMNS; c++) own[c] /= lower[10 * row];
        }
    }

    // Adds a block of n columns to rows of a larger matrix.
    void copy(std::size_t column, std::size_t n, double* rows, std::size_t stride) const {
        for (std::size_t row = 0; row < 9; row++)
            for (std::size_t k = 0; k < n; k++) rows[row * stride + k] += j[row * COLUMNS + column + k];
    }

    // Adds a block of six columns times (6, 3) rows of `lead` to rows of a larger matrix.
    void copy_led(std::size_t column, const double* lead, std::size_t of_lead, double* rows, std::size_t stride) const {
        for (std::size_t row = 0; row < 9; row++)
            for (std::size_t i = 0; i < 6; i++) add(j[row * COLUMNS + column + i], lead + i * of_lead, 3, rows + row * stride);
    }
};

void require_intervals(const IntervalViews& of, std::size_t n, Vector state, Matrix cam_from_imu) {
    require_shape(of.seconds, {n}, "seconds");
    require_shape(of.rotation, {n, 3, 3}, "rotation");
    require_shape(of.motion, {n, 6}, "motion");
    require_shape(of.by_bias, {n, 9, 6}, "by_bias");
    require_shape(of.by_clock, {n, 9}, "by_clock");
    require_shape(of.cov, {n, 9, 9}, "cov");
    require_shape(of.biases, {n, 6}, "biases");
    require_shape(of.clock, {n}, "clock");
    require_shape(state, {STATE}, "state");
    require_shape(cam_from_imu, {4, 4}, "cam_from_imu");
}

// The Jacobian (23, 23) of pose and state at the end of an interval by those at its beginning. `by_state` (9, 17): the
// negative Jacobian of pose and velocity by the state; `turn`: that of gravity by the rotation of the camera.
void put_end(double* rows, const Mat& back, const Vec& there, const Mat& turn, const double* by_state) {
    auto at = [&](std::size_t row, std::size_t column, const Mat& block) { put(rows, SIZE, row, column, block); };
    at(0, 0, back);
    at(0, 3, skew(there) * back);
    at(3, 3, back);
    for (std::size_t k = 0; k < STATE; k++) rows[(6 + k) * SIZE + 6 + k] = 1;
    for (std::size_t row = 0; row < 6; row++)
        for (std::size_t k = 0; k < STATE; k++) rows[row * SIZE + 6 + k] = by_state[row * STATE + k];
    for (std::size_t row = 0; row < 3; row++)
        for (std::size_t k = 0; k < STATE; k++) {
            rows[(6 + row) * SIZE + 6 + k] = -by_state[(6 + row) * STATE + k];
            double sum = k < G || k >= G + 3 ? 0.0 : back.x[3 * row + k - G];
            for (std::size_t i = 0; i < 3; i++) sum -= turn.x[3 * row + i] * by_state[(3 + i) * STATE + k];
            rows[(6 + G + row) * SIZE + 6 + k] = sum;
        }
}

// The Jacobian (23, 9) of pose and state at the end of an interval by the noise (9,) of the samples, from `at_end` (9,
// 9).
void put_noise(double* noise, const Mat& turn, const double* at_end) {
    for (std::size_t k = 0; k < 9; k++)
        for (std::size_t row = 0; row < 3; row++) {
            noise[row * 9 + k] = at_end[row * 9 + k];
            noise[(3 + row) * 9 + k] = at_end[(3 + row) * 9 + k];
            noise[(6 + row) * 9 + k] = -at_end[(6 + row) * 9 + k];
            for (std::size_t i = 0; i < 3; i++) noise[(6 + G + row) * 9 + k] -= turn.x[3 * row + i] * at_end[(3 + i) * 9 + k];
        }
}

// The inverse of a matrix (9, 9), by elimination with the largest pivot of each column.
void invert9(double* a, double* out) {
    for (int i = 0; i < 81; i++) out[i] = i % 10 == 0 ? 1.0 : 0.0;
    for (int c = 0; c < 9; c++) {
        int best = c;
        for (int r = c + 1; r < 9; r++)
            if (std::abs(a[9 * r + c]) > std::abs(a[9 * best + c])) best = r;
        require_definite(std::abs(a[9 * best + c]) > 0, "samples do not lead to the end of an interval");
        std::swap_ranges(a + 9 * c, a + 9 * c + 9, a + 9 * best);
        std::swap_ranges(out + 9 * c, out + 9 * c + 9, out + 9 * best);
        double pivot = a[10 * c];
        for (int k = 0; k < 9; k++) a[9 * c + k] /= pivot, out[9 * c + k] /= pivot;
        for (int r = 0; r < 9; r++) {
            double by = a[9 * r + c];
            if (r == c || by == 0) continue;
            add(-by, a + 9 * c, 9, a + 9 * r);
            add(-by, out + 9 * c, 9, out + 9 * r);
        }
    }
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

Leads slide_leads(Matrices cams, Matrix slides) {
    std::size_t n = cams.shape[0];
    require_shape(cams, {n, 4, 4}, "cams");
    require_shape(slides, {n, 3}, "slides");
    Leads out{{6 * n, 3 * n}, {n, 4, 4}};
    Array<double, 2> turns{n, 6};
    for (std::size_t k = 0; k < n; k++)
        for (std::size_t i = 0; i <= k; i++) {
            Mat turned = rotation_in(cams[k]) * transposed(rotation_in(cams[i]));
            Vec ti{{cams[i][3], cams[i][7], cams[i][11]}}, tk{{cams[k][3], cams[k][7], cams[k][11]}};
            double* block = out.lead[6 * k] + 3 * i;
            put(block, 3 * n, 0, 0, skew(tk - turned * ti) * turned);
            put(block, 3 * n, 3, 0, turned);
            for (std::size_t row = 0; row < 6; row++)
                for (std::size_t c = 0; c < 3; c++) turns[k][row] += block[3 * n * row + c] * slides[i][c];
        }
    Array<double, 3> moved = pose_exp(turns);
    for (std::size_t k = 0; k < n; k++) multiply<4, 4, 4>(moved[k], cams[k], out.true_cams[k]);
    out.true_cams = orthonormalise(out.true_cams);
    return out;
}

InertialRows inertial_rows(const IntervalViews& of, Matrices cams, Matrix lead, Matrix velocities, Vector state,
                           Matrix cam_from_imu) {
    std::size_t n = of.seconds.shape[0];
    require_intervals(of, n, state, cam_from_imu);
    require_shape(cams, {n, 4, 4}, "cams");
    require_shape(lead, {6 * n, 3 * n}, "lead");
    require_shape(velocities, {n, 3}, "velocities");
    InertialRows rows{{9 * n}, {9 * n, 6 * n + STATE}, {9 * n, 6 * n}};
    Mat axes = rotation_in(cam_from_imu.data);
    Vec lever{{cam_from_imu.data[3], cam_from_imu.data[7], cam_from_imu.data[11]}};
    std::size_t of_shared = 6 * n + STATE, of_local = 6 * n, of_lead = 3 * n;
    for (std::size_t k = 0; k < n; k++) {
        const double *before = k ? cams[k - 1] : HERE, *velocity = k ? velocities[k - 1] : state.data;
        Rows9 own(of, k, before, cams[k], vec(velocity), vec(velocities[k]), state.data, axes, lever);
        double *shared = rows.shared[9 * k], *local = rows.local[9 * k];
        std::copy_n(own.e, 9, rows.residual.data.get() + 9 * k);
        own.copy(Rows9::OF_STATE, STATE, shared + 6 * n, of_shared);
        own.copy(Rows9::POSE_J, 6, shared + 6 * k, of_shared);
        own.copy(Rows9::VELOCITY_J, 3, local + of_lead + 3 * k, of_local);
        for (std::size_t i = 0; i <= k; i++) own.copy_led(Rows9::POSE_J, lead[6 * k] + 3 * i, of_lead, local + 3 * i, of_local);
        if (!k) own.copy(Rows9::VELOCITY_I, 3, shared + 6 * n, of_shared);
        if (!k) continue;
        own.copy(Rows9::POSE_I, 6, shared + 6 * k - 6, of_shared);
        own.copy(Rows9::VELOCITY_I, 3, local + of_lead + 3 * k - 3, of_local);
        for (std::size_t i = 0; i < k; i++)
            own.copy_led(Rows9::POSE_I, lead[6 * k - 6] + 3 * i, of_lead, local + 3 * i, of_local);
    }
    return rows;
}

WIDER InertialInformation inertial_information(const IntervalViews& of, Matrices cams, Matrix slides, Vector std_slides,
                                               Matrix velocities, Vector state, Matrix cam_from_imu) {
    Leads led = slide_leads(cams, slides);
    InertialRows rows = inertial_rows(of, led.true_cams, led.lead, velocities, state, cam_from_imu);
    std::size_t n = cams.shape[0], of_rows = 9 * n, own = 6 * n, others = 6 * n + STATE, all = of_rows + 3 * n;
    require_shape(std_slides, {n}, "std_slides");
    Rows local{rows.local.data.get(), own}, shared{rows.shared.data.get(), others}, residual{rows.residual.data.get(), 1};
    InertialInformation out{{others, others}, {others}, std::move(led.lead), {own, own}, {own, others}, {own}};
    double *right = out.right.data.get(), *gain = out.gain.data.get();
    Array<double, 2> h(own, own), coupling(own, others), root_rows(own, own), local_columns(own, of_rows);
    add_product(local, own, local, own, of_rows, 0, h.data.get());
    add_product(local, own, shared, others, of_rows, 0, coupling.data.get());
    add_product(local, own, residual, 1, of_rows, 0, right);
    for (std::size_t i = 0; i < own; i++) {
        right[i] = -right[i];
        if (i >= 3 * n) continue;
        double known = 1 / (std_slides.data[i / 3] * std_slides.data[i / 3]);
        h[i][i] += known;
        right[i] -= known * slides.data[i];
    }
    Array<double, 2> root = inverse_root(h, true);
    for (std::size_t i = 0; i < own; i++) {
        for (std::size_t k = i; k < own; k++) root_rows[k][i] = root[i][k];
        for (std::size_t row = 0; row < of_rows; row++) local_columns[i][row] = rows.local[row][i];
    }
    add_product({root_rows.data.get(), own}, own, {root_rows.data.get(), own}, own, own, 0, out.cov.data.get());
    add_product({out.cov.data.get(), own}, own, {coupling.data.get(), others}, others, own, 0, gain);
    for (std::size_t i = 0; i < own * others; i++) gain[i] = -gain[i];
    // As a sum of squares the information stays definite, however different the variances of two intervals are: rows
    // with the best slides and velocities, then the slides themselves, in σ.
    Array<double, 2> left(all, others);
    Array<double, 1> left_residual(all);
    std::copy_n(shared.data, of_rows * others, left.data.get());
    std::copy_n(residual.data, of_rows, left_residual.data.get());
    add_product({local_columns.data.get(), of_rows}, of_rows, {gain, others}, others, own, 0, left.data.get());
    for (std::size_t i = 0; i < 3 * n; i++) {
        add(1 / std_slides.data[i / 3], gain + i * others, others, left[of_rows + i]);
        left_residual.data[of_rows + i] = slides.data[i] / std_slides.data[i / 3];
    }
    Rows rest{left.data.get(), others};
    add_product(rest, others, rest, others, all, 0, out.about.data.get());
    add_product(rest, others, {left_residual.data.get(), 1}, 1, all, 0, out.weighted.data.get());
    for (std::size_t i = 0; i < others; i++) out.weighted.data[i] = -out.weighted.data[i];
    return out;
}

InertialMotion inertial_motion(const IntervalViews& of, Vector state, Matrix cam_from_imu, Vector std_walk) {
    require_intervals(of, 1, state, cam_from_imu);
    require_shape(std_walk, {6}, "std_walk");
    InertialMotion out;
    const double* s = state.data;
    Corrected d(of, 0, s);
    Mat axes = rotation_in(cam_from_imu.data), mounted = axes * exp_so3(vec(s + AXES));
    Mat turned = mounted * d.r * transposed(mounted), back = transposed(turned);
    Vec lever{{cam_from_imu.data[3], cam_from_imu.data[7], cam_from_imu.data[11]}};
    double t = of.seconds.data[0];
    Vec moved = (1 / (1 + s[SCALE])) * (lever + t * vec(s) + (0.5 * t * t) * vec(s + G) + mounted * d.p - turned * lever);
    Vec velocity = back * (vec(s) + t * vec(s + G) + mounted * d.v), gravity = back * vec(s + G), there = -1 * (back * moved);
    double cam[16] = {0};
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            out.previous_from_now[0][4 * i + k] = turned.x[3 * i + k];
            cam[4 * i + k] = back.x[3 * i + k];
        }
        out.previous_from_now[0][4 * i + 3] = moved.x[i];
        cam[4 * i + 3] = there.x[i];
    }
    out.previous_from_now[0][15] = cam[15] = 1;
    std::copy_n(s, STATE, out.state.data.get());
    std::copy_n(velocity.x, 3, out.state.data.get());
    std::copy_n(gravity.x, 3, out.state.data.get() + G);
    // whitened residuals are zero at the end and N(0, I): J_end (ξ, δv) + J_s δs + n = 0
    Rows9 own(of, 0, HERE, cam, vec(s), velocity, s, axes, lever);
    own.copy(Rows9::VELOCITY_I, 3, own.j + Rows9::OF_STATE, Rows9::COLUMNS);
    double end[81] = {}, at_end[81], by_state[9 * STATE] = {}, of_state[9 * STATE] = {}, noise[SIZE * 9] = {};
    own.copy(Rows9::POSE_J, 6, end, 9);
    own.copy(Rows9::VELOCITY_J, 3, end + 6, 9);
    own.copy(Rows9::OF_STATE, STATE, of_state, STATE);
    invert9(end, at_end);
    multiply<9, 9, STATE>(at_end, of_state, by_state);  // negative: the end moves in the opposite direction
    Mat turn = -1 * skew(gravity);
    put_end(out.rows[0], back, there, turn, by_state);
    put_noise(noise, turn, at_end);
    multiply_transposed<SIZE, 9, SIZE>(noise, noise, out.cov[0]);
    for (std::size_t k = 0; k < 6; k++) out.cov[6 + B_G + k][6 + B_G + k] += std_walk.data[k] * std_walk.data[k];
    return out;
}

}  // namespace core
