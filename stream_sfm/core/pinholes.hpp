// A rectified pair, and homogeneous points (X, Y, Z, ρ) in front of it.
#pragma once

#include "arrays.hpp"

namespace core {

constexpr double MIN_DEPTH = 1e-3;  // geometry/stereo.py exports it

struct Pinholes {
    double f_px, cx_left_px, cx_right_px, cy_px, baseline_m;
    int width, height;
    RECORD(Pinholes, f_px, cx_left_px, cx_right_px, cy_px, baseline_m, width, height)

    std::array<double, 2> size() const { return {static_cast<double>(width), static_cast<double>(height)}; }
};

// Transforms a homogeneous point (4,) by a motion (4, 4).
inline void move(const double* motion, const double* point, double* out) {
    for (int i = 0; i < 4; i++) {
        const double* row = motion + 4 * i;
        out[i] = row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3] * point[3];
    }
}

// Moves a point to at least MIN_DEPTH in front of the camera; returns whether it was there.
inline bool clamp_depth(double* in_cam) {
    if (!(in_cam[2] < MIN_DEPTH)) return true;
    in_cam[2] = MIN_DEPTH;
    return false;
}

// Views of homogeneous points, eq. (8).
inline void project(const Pinholes& p, const double* point, double* z) {
    double s = p.f_px / point[2], u = s * point[0];
    z[0] = u + p.cx_left_px;
    z[1] = z[3] = s * point[1] + p.cy_px;
    z[2] = u - s * p.baseline_m * point[3] + p.cx_right_px;
}

// ∂z/∂(X, Y, Z, ρ) (4, 4), eq. (9).
inline void jacobian(const Pinholes& p, const double* point, double* a) {
    double s = p.f_px / point[2], sx = -s * point[0] / point[2], sy = -s * point[1] / point[2];
    std::fill(a, a + 16, 0.0);
    a[0] = a[5] = a[8] = a[13] = s;
    a[2] = sx;
    a[6] = a[14] = sy;
    a[10] = sx + s * p.baseline_m * point[3] / point[2];
    a[11] = -s * p.baseline_m;
}

// The rows b (4) of a product with ∂P/∂ξ of Exp(ξ)·P at homogeneous points P, eq. (21): by the motion (6,).
inline void by_motion(const double* b, const double* point, double* out) {
    for (int k = 0; k < 3; k++) out[k] = b[k] * point[3];
    out[3] = b[2] * point[1] - b[1] * point[2];
    out[4] = b[0] * point[2] - b[2] * point[0];
    out[5] = b[1] * point[0] - b[0] * point[1];
}

// The effect (2, 3), px per radian, of a turn of the right camera at (u, v) of its image, eq. (72d).
inline void by_turn(const Pinholes& p, double u, double v, double* out) {
    double x = (u - p.cx_right_px) / p.f_px, y = (v - p.cy_px) / p.f_px;
    double columns[6] = {x * y, -1 - x * x, y, 1 + y * y, -x * y, -x};
    for (int k = 0; k < 6; k++) out[k] = p.f_px * columns[k];
}

}  // namespace core
