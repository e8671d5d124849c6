// Small matrices, in C order, and medians.
#pragma once

#include "arrays.hpp"

namespace core {

constexpr int LANES = 8;  // partial sums, always in the same order
constexpr double DAMPING = 1e-9;        // of a scaled information matrix: undetermined directions do not move
constexpr double MAX_ROTATION_STEP_RAD = 0.3;  // of one step of an iteration
constexpr double CAUCHY_WIDTH = 2.4;    // exported by geometry/medians.py
constexpr double MEDIAN_CHI2_4 = 3.36;  // closed form: the median of χ² with four degrees of freedom
constexpr std::size_t MIN_VIEWS = 6;    // for a motion; exported by geometry/resection.py
constexpr double ROUNDING = 1e-30;      // of squares, relative

// Σ a b over k samples.
inline double dot(const float* a, const float* b, int k) {
    float sums[LANES] = {};
    int whole = k - k % LANES;
    for (int i = 0; i < whole; i += LANES)
        for (int lane = 0; lane < LANES; lane++) sums[lane] += a[i + lane] * b[i + lane];
    double sum = 0;
    for (float lane : sums) sum += lane;
    for (int i = whole; i < k; i++) sum += a[i] * b[i];
    return sum;
}

// out (R, C) = a (R, K) b (K, C).
template <int R, int K, int C>
void multiply(const double* a, const double* b, double* out) {
    for (int i = 0; i < R; i++)
        for (int j = 0; j < C; j++) {
            double sum = a[K * i] * b[j];
            for (int k = 1; k < K; k++) sum += a[K * i + k] * b[C * k + j];
            out[C * i + j] = sum;
        }
}

// out (R, C) = a (R, K) bᵀ of b (C, K).
template <int R, int K, int C>
void multiply_transposed(const double* a, const double* b, double* out) {
    for (int i = 0; i < R; i++)
        for (int j = 0; j < C; j++) {
            double sum = a[K * i] * b[K * j];
            for (int k = 1; k < K; k++) sum += a[K * i + k] * b[K * j + k];
            out[C * i + j] = sum;
        }
}

// The inverse of a matrix (3, 3), by its adjugate.
inline void invert3(const double* a, double* out) {
    double c0 = a[4] * a[8] - a[5] * a[7], c1 = a[5] * a[6] - a[3] * a[8], c2 = a[3] * a[7] - a[4] * a[6];
    double scale = 1 / (a[0] * c0 + a[1] * c1 + a[2] * c2);
    out[0] = c0 * scale;
    out[1] = (a[2] * a[7] - a[1] * a[8]) * scale;
    out[2] = (a[1] * a[5] - a[2] * a[4]) * scale;
    out[3] = c1 * scale;
    out[4] = (a[0] * a[8] - a[2] * a[6]) * scale;
    out[5] = (a[2] * a[3] - a[0] * a[5]) * scale;
    out[6] = c2 * scale;
    out[7] = (a[1] * a[6] - a[0] * a[7]) * scale;
    out[8] = (a[0] * a[4] - a[1] * a[3]) * scale;
}

// The upper triangle of a symmetric A (n, n) becomes the factor U with Uᵀ U = A. False if A is not positive definite.
// Terms are subtracted one by one in their order, those of four rows in one pass.
inline bool factor_upper(double* a, std::size_t n) {
    for (std::size_t first = 0, end = 0; first < n; first = end) {
        end = std::min(first + 4, n);
        for (std::size_t k = first; k < end; k++) {
            double* row = a + k * n;
            if (!(row[k] > 0)) return false;
            row[k] = std::sqrt(row[k]);
            for (std::size_t c = k + 1; c < n; c++) row[c] /= row[k];
            for (std::size_t i = k + 1; i < end; i++)
                for (std::size_t c = i; c < n; c++) a[i * n + c] -= row[i] * row[c];
        }
        const double *u0 = a + first * n, *u1 = u0 + n, *u2 = u1 + n, *u3 = u2 + n;
        for (std::size_t i = end; i < n; i++)  // only after four rows
            for (std::size_t c = i; c < n; c++)
                a[i * n + c] = a[i * n + c] - u0[i] * u0[c] - u1[i] * u1[c] - u2[i] * u2[c] - u3[i] * u3[c];
    }
    return true;
}

// The lower triangle of a symmetric A (n, n) becomes the factor L with L Lᵀ = A, and the upper one its transpose. False if
// A is not positive definite.
inline bool factor_positive(double* a, std::size_t n) {
    for (std::size_t i = 1; i < n; i++)
        for (std::size_t c = 0; c < i; c++) a[c * n + i] = a[i * n + c];
    if (!factor_upper(a, n)) return false;
    for (std::size_t i = 1; i < n; i++)
        for (std::size_t c = 0; c < i; c++) a[i * n + c] = a[c * n + i];
    return true;
}

// The lower Cholesky factor of a symmetric matrix (N, N); false if it is not positive definite.
template <int N>
bool cholesky(const double* a, double* lower) {
    std::copy(a, a + N * N, lower);
    if (!factor_positive(lower, N)) return false;
    for (int i = 0; i < N; i++) std::fill(lower + i * N + i + 1, lower + i * N + N, 0.0);
    return true;
}

// The inverse of a lower triangle (N, N).
template <int N>
void invert_lower(const double* lower, double* out) {
    std::fill(out, out + N * N, 0.0);
    for (int j = 0; j < N; j++) {
        out[j * N + j] = 1 / lower[j * N + j];
        for (int i = j + 1; i < N; i++) {
            double sum = 0;
            for (int k = j; k < i; k++) sum -= lower[i * N + k] * out[k * N + j];
            out[i * N + j] = sum / lower[i * N + i];
        }
    }
}

// The inverse of a symmetric positive definite matrix (N, N); NaN if it is not positive definite.
template <int N>
void invert_positive(const double* a, double* out) {
    double lower[N * N], root[N * N];
    if (!cholesky<N>(a, lower)) {
        std::fill(out, out + N * N, std::numeric_limits<double>::quiet_NaN());
        return;
    }
    invert_lower<N>(lower, root);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            double sum = 0;
            for (int k = std::max(i, j); k < N; k++) sum += root[k * N + i] * root[k * N + j];
            out[i * N + j] = sum;
        }
}

// b becomes L⁻¹ b of a lower triangle (n, n).
inline void substitute(const double* lower, double* b, std::size_t n) {
    for (std::size_t i = 0; i < n; i++) {
        for (std::size_t k = 0; k < i; k++) b[i] -= lower[i * n + k] * b[k];
        b[i] /= lower[i * n + i];
    }
}

// b becomes A⁻¹ b of a symmetric A = L Lᵀ (n, n), from L.
inline void solve_factored(const double* lower, double* b, std::size_t n) {
    substitute(lower, b, n);
    for (std::size_t i = n; i-- > 0;) {
        for (std::size_t k = i + 1; k < n; k++) b[i] -= lower[k * n + i] * b[k];
        b[i] /= lower[i * n + i];
    }
}

// Solve A x = b for a symmetric positive definite A (n, n), which becomes its factor; b becomes x. False if it is not
// positive definite.
inline bool solve_positive(double* a, double* b, std::size_t n) {
    if (!factor_positive(a, n)) return false;
    solve_factored(a, b, n);
    return true;
}

// Eigenvalues of a symmetric matrix A (n, n), which become its diagonal, and its axes as columns (n, n): Jacobi's rotations,
// until the squares of all other elements add up to rounding, or to what is `left`.
inline void diagonalise(double* a, double* axes, std::size_t n, double left = 0) {
    for (std::size_t i = 0; i < n * n; i++) axes[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
    for (int sweep = 0; sweep < 30; sweep++) {  // matrices of up to 20 take six
        double off = 0, on = 0;
        for (std::size_t i = 0; i < n; i++)
            for (std::size_t j = 0; j < n; j++) (i == j ? on : off) += a[i * n + j] * a[i * n + j];
        double end = std::max(on * ROUNDING, left);
        if (!(off > end)) break;
        double least = end / static_cast<double>(n * n);  // all elements below it together end the sweeps
        for (std::size_t i = 0; i < n; i++)
            for (std::size_t j = i + 1; j < n; j++) {
                if (!(a[i * n + j] * a[i * n + j] > least)) continue;
                double ratio = (a[j * n + j] - a[i * n + i]) / (2 * a[i * n + j]);
                double t = std::copysign(1.0, ratio) / (std::abs(ratio) + std::sqrt(1 + ratio * ratio));
                double c = 1 / std::sqrt(1 + t * t), s = t * c, shift = t * a[i * n + j];
                double on_i = a[i * n + i] - shift, on_j = a[j * n + j] + shift;
                for (double* of : {a, axes})  // rows of both, as the matrix is symmetric
                    for (std::size_t k = 0; k < n; k++) {
                        double before = of[i * n + k];
                        of[i * n + k] = c * before - s * of[j * n + k];
                        of[j * n + k] = s * before + c * of[j * n + k];
                    }
                a[i * n + i] = on_i, a[j * n + j] = on_j, a[i * n + j] = a[j * n + i] = 0;
                for (std::size_t k = 0; k < n; k++) a[k * n + i] = a[i * n + k], a[k * n + j] = a[j * n + k];
            }
    }
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t j = i + 1; j < n; j++) std::swap(axes[i * n + j], axes[j * n + i]);
}

// Solve A x = b in place for an information matrix (n, n), with each direction scaled; a direction that the data do not
// determine does not move. NaN if A is not finite.
inline void solve_damped(std::vector<double>& a, double* b, std::size_t n) {
    std::vector<double> scale(n);
    for (std::size_t i = 0; i < n; i++) scale[i] = 1 / std::sqrt(std::max(a[i * n + i], 1e-12));
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t j = 0; j < n; j++) a[i * n + j] = a[i * n + j] * scale[i] * scale[j] + (i == j ? DAMPING : 0.0);
    for (std::size_t i = 0; i < n; i++) b[i] *= scale[i];
    bool solved = solve_positive(a.data(), b, n);
    for (std::size_t i = 0; i < n; i++) b[i] = solved ? scale[i] * b[i] : std::numeric_limits<double>::quiet_NaN();
}

// out += a x, n numbers.
inline void add(double a, const double* x, std::size_t n, double* out) {
    for (std::size_t i = 0; i < n; i++) out[i] += a * x[i];
}

// Rows of a matrix, `stride` numbers apart.
struct Rows {
    const double* data;
    std::size_t stride;
    Rows from(std::size_t column) const { return {data + column, stride}; }
};

// Numbers that are summed side by side, and their layout in memory: one, two or four without alignment.
struct One {
    using Sum = double;
    using At = double;
};
struct Two {
    typedef double Sum __attribute__((vector_size(16)));
    typedef double At __attribute__((vector_size(16), aligned(8), may_alias));
};
struct Four {
    typedef double Sum __attribute__((vector_size(32)));
    typedef double At __attribute__((vector_size(32), aligned(8), may_alias));
};

// C (P, Q) += Aᵀ B of n rows of each. Sums stay in registers: one array per column of B, or compilers spill them.
template <int P, int Q>
void add_product_tile(Rows a, Rows b, std::size_t n, double* c, std::size_t stride) {
    static_assert(Q == 1 || Q == 2 || Q == 4 || Q == 8);
    using Numbers = std::conditional_t<Q == 1, One, std::conditional_t<Q == 2, Two, Four>>;
    using At = typename Numbers::At;
    typename Numbers::Sum s0[P] = {}, s1[P] = {};
    for (std::size_t k = 0; k < n; k++, a.data += a.stride, b.data += b.stride) {
        const At* right = reinterpret_cast<const At*>(b.data);
        for (int i = 0; i < P; i++) {
            s0[i] += a.data[i] * right[0];
            if constexpr (Q == 8) s1[i] += a.data[i] * right[1];
        }
    }
    for (int i = 0; i < P; i++, c += stride) {
        At* out = reinterpret_cast<At*>(c);
        out[0] += s0[i];
        if constexpr (Q == 8) out[1] += s1[i];
    }
}

// C (p, q) += Aᵀ B of n rows of each, of q columns. Rows of C belong to symmetric blocks (period, q): of these the lower
// triangles may be left out. `period` 0: to none. Rows of C are q numbers apart, or a `stride`.
inline void add_product(Rows a, std::size_t p, Rows b, std::size_t q, std::size_t n, std::size_t period, double* c, std::size_t stride = 0) {
    if (stride == 0) stride = q;
    for (std::size_t i = 0, rows = 0; i < p; i += rows) {
        rows = i + 4 <= p ? 4 : i + 2 <= p ? 2 : 1;
        std::size_t in_block = period ? i % period : 0, j = in_block + rows > period ? 0 : in_block / 4 * 4;
        auto add_columns = [&](auto columns) {
            constexpr int Q = decltype(columns)::value;
            for (; j + Q <= q; j += Q)
                if (rows == 4) add_product_tile<4, Q>(a.from(i), b.from(j), n, c + i * stride + j, stride);
                else if (rows == 2) add_product_tile<2, Q>(a.from(i), b.from(j), n, c + i * stride + j, stride);
                else add_product_tile<1, Q>(a.from(i), b.from(j), n, c + i * stride + j, stride);
        };
        add_columns(std::integral_constant<int, 8>());
        add_columns(std::integral_constant<int, 4>());
        add_columns(std::integral_constant<int, 2>());
        add_columns(std::integral_constant<int, 1>());
    }
}

// The median of at least one value; NaN if any value is NaN.
inline double median(std::vector<double> values) {
    for (double value : values)
        if (std::isnan(value)) return value;
    std::size_t n = values.size();
    auto upper = values.begin() + static_cast<std::ptrdiff_t>(n / 2);
    std::nth_element(values.begin(), upper, values.end());
    if (n % 2) return *upper;
    return 0.5 * (*std::max_element(values.begin(), upper) + *upper);
}

}  // namespace core
