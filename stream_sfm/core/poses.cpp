// Rigid motions and rotations: Exp, Log, quaternions (x, y, z, w), and the rotation nearest to a matrix.

#include "poses.hpp"

namespace core {
namespace {

// A velocity follows from a polynomial of fourth order through REACH frames on either side, and at the ends from one of third
// order through NODES frames.
enum : std::size_t { REACH = 2, NODES = 4 };

// The first frame, and the one after the last, whose poses give the motion in frame i of n.
std::pair<std::size_t, std::size_t> nodes_of(std::size_t i, std::size_t n) {
    std::size_t nodes = std::min<std::size_t>(NODES, n), first = std::min(i < REACH ? 0 : i - REACH, n - nodes);
    return {first, std::max(std::min(i + REACH + 1, n), first + nodes)};
}

// The rotation (3, 3) of a vector and the left Jacobian V with t = V ρ, eq. (3) (Barfoot, eq. 8.33). The last
// coefficient, (θ − sin θ)/θ³, loses digits as θ² decreases, but it multiplies a product of that size.
void rotation_of(const double* w, double* rotation, double* left) {
    double angle = std::max(std::sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]), 1e-150);  // a divisor, whose square is still a normal double
    double sine = std::sin(angle) / angle, half = std::sin(angle / 2) / angle;
    double a = 2 * half * half, b = (1 - sine) / (angle * angle);  // 1 − cos θ = 2 sin²(θ/2) without cancellation
    double k[9] = {0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0}, k2[9];
    multiply<3, 3, 3>(k, k, k2);
    for (int i = 0; i < 9; i++) {
        double one = i % 4 == 0 ? 1.0 : 0.0;
        rotation[i] = one + sine * k[i] + a * k2[i];
        left[i] = one + a * k[i] + b * k2[i];
    }
}

// The unit quaternion (4,) with w ≥ 0 of a rotation (3, 3), from the best-conditioned row of 4 q qᵀ.
void quaternion_of(const double* r, double* q) {
    double a = r[0], e = r[4], i = r[8];
    double rows[4][4] = {{1 + a - e - i, r[1] + r[3], r[2] + r[6], r[7] - r[5]},
                         {r[1] + r[3], 1 - a + e - i, r[5] + r[7], r[2] - r[6]},
                         {r[2] + r[6], r[5] + r[7], 1 - a - e + i, r[3] - r[1]},
                         {r[7] - r[5], r[2] - r[6], r[3] - r[1], 1 + a + e + i}};
    int best = 0;
    for (int k = 1; k < 4; k++)
        if (rows[k][k] > rows[best][best]) best = k;
    const double* of = rows[best];
    double norm = std::copysign(std::sqrt(of[0] * of[0] + of[1] * of[1] + of[2] * of[2] + of[3] * of[3]), of[3]);
    for (int k = 0; k < 4; k++) q[k] = of[k] / norm;
}

// The rotation vector (3,), norm ≤ π, of a rotation (3, 3).
void vector_of(const double* rotation, double* w) {
    double q[4];
    quaternion_of(rotation, q);
    double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]), ratio = n / q[3];
    // n: sine of half the angle; if it is small, the next term of the series, n⁴/5, is below rounding.
    double scale = n < 1e-4 ? 2 / q[3] * (1 - ratio * ratio / 3) : 2 * std::atan2(n, q[3]) / n;
    for (int k = 0; k < 3; k++) w[k] = scale * q[k];
}

}  // namespace

Array<double, 3> pose_exp(Matrix xi) {
    std::size_t n = xi.shape[0];
    require_shape(xi, {n, 6}, "xi");
    return each(xi, Array<double, 3>(n, 4, 4), [](const double* of, double* out) {
        double rotation[9], left[9];
        rotation_of(of + 3, rotation, left);
        for (int row = 0; row < 3; row++) {
            std::copy(rotation + 3 * row, rotation + 3 * row + 3, out + 4 * row);
            for (int k = 0; k < 3; k++) out[4 * row + 3] += left[3 * row + k] * of[k];
        }
        out[15] = 1;
    });
}

Array<double, 2> pose_log(Matrices poses) {
    std::size_t n = poses.shape[0];
    require_shape(poses, {n, 4, 4}, "pose");
    return each(poses, Array<double, 2>(n, 6), [](const double* pose, double* out) {
        double rotation[9], left[9], inverse[9];
        for (int k = 0; k < 9; k++) rotation[k] = pose[4 * (k / 3) + k % 3];
        vector_of(rotation, out + 3);
        rotation_of(out + 3, rotation, left);
        invert3(left, inverse);
        for (int row = 0; row < 3; row++)
            for (int k = 0; k < 3; k++) out[row] += inverse[3 * row + k] * pose[4 * k + 3];
    });
}

Array<double, 3> pose_inverse(Matrices poses) {
    std::size_t n = poses.shape[0];
    require_shape(poses, {n, 4, 4}, "pose");
    return each(poses, Array<double, 3>(n, 4, 4), [](const double* pose, double* out) {
        for (int row = 0; row < 3; row++) {
            for (int k = 0; k < 3; k++) out[4 * row + k] = pose[4 * k + row];
            out[4 * row + 3] = -(pose[row] * pose[3] + pose[4 + row] * pose[7] + pose[8 + row] * pose[11]);
        }
        out[15] = 1;
    });
}

Array<double, 3> pose_adjoint(Matrices poses) {
    std::size_t n = poses.shape[0];
    require_shape(poses, {n, 4, 4}, "pose");
    return each(poses, Array<double, 3>(n, 6, 6), [](const double* pose, double* out) {
        double x = pose[3], y = pose[7], z = pose[11];
        for (int k = 0; k < 3; k++) {  // column by column: t × r
            double a = pose[k], b = pose[4 + k], c = pose[8 + k];
            out[k] = out[21 + k] = a;
            out[6 + k] = out[27 + k] = b;
            out[12 + k] = out[33 + k] = c;
            out[3 + k] = y * c - z * b;
            out[9 + k] = z * a - x * c;
            out[15 + k] = x * b - y * a;
        }
    });
}

// Derivatives of Lagrange polynomials through the poses around each; the value at its own time is 0.
Array<double, 3> point_motions(Matrices poses, Vector seconds) {
    std::size_t n = poses.shape[0];
    require_shape(seconds, {n}, "seconds");
    Array<double, 3> inverse = pose_inverse(poses), result(n, 2, 6);
    for (std::size_t i = 0; n > 1 && i < n; i++) {
        auto [first, end] = nodes_of(i, n);
        auto apart = [&](std::size_t a, std::size_t b) { return seconds.data[a] - seconds.data[b]; };
        for (std::size_t a = first; a < end; a++) {
            if (apart(a, i) == 0) continue;
            double slope = 1 / apart(a, i), bend = 0, moved[16];
            for (std::size_t b = first; b < end; b++) {
                if (apart(b, i) == 0 || apart(a, b) == 0) continue;
                slope *= apart(i, b) / apart(a, b);
                bend += 2 / apart(i, b);
            }
            multiply<4, 4, 4>(poses[a], inverse[i], moved);
            Array<double, 2> xi = pose_log({moved, {1, 4, 4}});
            for (int k = 0; k < 6; k++) {
                result[i][k] += slope * xi[0][k];
                result[i][6 + k] += bend * slope * xi[0][k];
            }
        }
    }
    return result;
}

// The error of a polynomial through m nodes t_k is (x⁽ᵐ⁾/m!) Π (t − t_k), whose derivative at t_i is the product without t_i, and
// whose second derivative over the first is 2 Σ 1/(t_i − t_k). Of the motions whose errors matter the next derivative is
// about 1.25 per period times larger, and where it counts, inside, has the other sign.
Array<double, 2> errors_of_motions(Vector seconds, double period) {
    std::size_t n = seconds.shape[0];
    require(period > 0, "the period is not positive");
    const double rate = 1.25 / period, unit = 6 * period * period * period / 24;
    Array<double, 2> result(n, 2);
    for (std::size_t i = 0; n > 1 && i < n; i++) {
        auto [first, end] = nodes_of(i, n);
        double size = std::pow(rate, static_cast<double>(end - first) - NODES) / unit, bend = 0;
        for (std::size_t k = first; k < end; k++) {
            double apart = seconds.data[i] - seconds.data[k];
            size /= static_cast<double>(k - first + 1);
            if (apart == 0) continue;
            size *= apart;
            bend += 1 / apart;
        }
        result[i][0] = end - first > NODES ? -size : size;
        result[i][1] = bend;
    }
    return result;
}

Array<double, 2> rotation_vectors(Matrices rotations) {
    std::size_t n = rotations.shape[0];
    require_shape(rotations, {n, 3, 3}, "rotation_matrix");
    return each(rotations, Array<double, 2>(n, 3), vector_of);
}

Array<double, 2> quaternions(Matrices rotations) {
    std::size_t n = rotations.shape[0];
    require_shape(rotations, {n, 3, 3}, "rotation_matrix");
    return each(rotations, Array<double, 2>(n, 4), quaternion_of);
}

Array<double, 3> orthonormalise(Matrices poses) {
    std::size_t n = poses.shape[0];
    require_shape(poses, {n, 4, 4}, "pose");
    Array<double, 3> result(n, 4, 4);
    std::copy(poses.data, poses.data + 16 * n, result.data.get());
    for (std::size_t i = 0; i < n; i++) {
        double r[9], product[9], next[9], *out = result[i];
        for (int k = 0; k < 9; k++) r[k] = out[4 * (k / 3) + k % 3];
        for (int step = 0; step < 2; step++) {  // r (1.5 I − 0.5 rᵀr)
            for (int row = 0; row < 3; row++)
                for (int k = 0; k < 3; k++)
                    product[3 * row + k] = (row == k ? 1.5 : 0.0) - 0.5 * (r[row] * r[k] + r[3 + row] * r[3 + k] + r[6 + row] * r[6 + k]);
            multiply<3, 3, 3>(r, product, next);
            std::copy(next, next + 9, r);
        }
        for (int k = 0; k < 9; k++) out[4 * (k / 3) + k % 3] = r[k];
    }
    return result;
}

}  // namespace core
