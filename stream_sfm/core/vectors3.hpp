// Vectors of three numbers and matrices of nine, with the rotations that both describe.
#pragma once

#include "algebra.hpp"
#include "poses.hpp"

namespace core {

struct Vec {
    double x[3];
};
struct Mat {
    double x[9];
};

inline Vec operator+(const Vec& a, const Vec& b) { return {{a.x[0] + b.x[0], a.x[1] + b.x[1], a.x[2] + b.x[2]}}; }
inline Vec operator-(const Vec& a, const Vec& b) { return {{a.x[0] - b.x[0], a.x[1] - b.x[1], a.x[2] - b.x[2]}}; }
inline Vec operator*(double s, const Vec& a) { return {{s * a.x[0], s * a.x[1], s * a.x[2]}}; }
inline Mat operator*(double s, const Mat& m) {
    Mat out;
    for (int i = 0; i < 9; i++) out.x[i] = s * m.x[i];
    return out;
}
inline Vec operator*(const Mat& m, const Vec& a) {
    Vec out;
    multiply<3, 3, 1>(m.x, a.x, out.x);
    return out;
}
inline Mat operator*(const Mat& a, const Mat& b) {
    Mat out;
    multiply<3, 3, 3>(a.x, b.x, out.x);
    return out;
}
inline Mat transposed(const Mat& a) { return {{a.x[0], a.x[3], a.x[6], a.x[1], a.x[4], a.x[7], a.x[2], a.x[5], a.x[8]}}; }
inline Mat skew(const Vec& a) { return {{0, -a.x[2], a.x[1], a.x[2], 0, -a.x[0], -a.x[1], a.x[0], 0}}; }
inline Vec cross(const Vec& a, const Vec& b) { return skew(a) * b; }
inline Vec vec(const double* a) { return {{a[0], a[1], a[2]}}; }
inline Mat mat(const double* a) {
    Mat out;
    std::copy_n(a, 9, out.x);
    return out;
}
inline Mat rotation_in(const double* pose) { return {{pose[0], pose[1], pose[2], pose[4], pose[5], pose[6], pose[8], pose[9], pose[10]}}; }
constexpr Mat EYE{{1, 0, 0, 0, 1, 0, 0, 0, 1}};

inline Mat exp_so3(const Vec& w) {
    double xi[6] = {0, 0, 0, w.x[0], w.x[1], w.x[2]};
    Array<double, 3> pose = pose_exp({xi, {1, 6}});
    return rotation_in(pose[0]);
}
inline Vec log_so3(const Mat& r) {
    Array<double, 2> w = rotation_vectors({r.x, {1, 3, 3}});
    return vec(w[0]);
}

// ∂Log(Exp(w) Exp(δ))/∂δ inverted: Exp(w + δ) = Exp(w) Exp(J δ).
inline Mat right_jacobian(const Vec& w) {
    double angle2 = w.x[0] * w.x[0] + w.x[1] * w.x[1] + w.x[2] * w.x[2], angle = std::sqrt(angle2);
    double a = angle < 1e-4 ? 0.5 - angle2 / 24 : (1 - std::cos(angle)) / angle2;
    double b = angle < 1e-4 ? 1.0 / 6 - angle2 / 120 : (angle - std::sin(angle)) / (angle2 * angle);
    Mat k = skew(w), k2 = k * k, out = EYE;
    for (int i = 0; i < 9; i++) out.x[i] += -a * k.x[i] + b * k2.x[i];
    return out;
}

inline void put(double* rows, std::size_t stride, std::size_t row, std::size_t column, const Mat& m, double scale = 1) {
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) rows[(row + i) * stride + column + k] += scale * m.x[3 * i + k];
}
inline void put(double* rows, std::size_t stride, std::size_t row, std::size_t column, const Vec& v) {
    for (int i = 0; i < 3; i++) rows[(row + i) * stride + column] += v.x[i];
}

}  // namespace core
