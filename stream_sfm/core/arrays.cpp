// Products, factors and sets of ids for which NumPy has no single call, or a slow one; and errors about arguments.

#include "poses.hpp"

namespace core {

void refuse(const char* why) { throw std::invalid_argument(why); }

void refuse_shape(const char* name, const std::size_t* shape, const std::size_t* wanted, std::size_t n) {
    auto listed = [n](const std::size_t* extents) {
        std::string text;
        for (std::size_t i = 0; i < n; i++) text += (i ? ", " : "") + std::to_string(extents[i]);
        return "(" + text + ")";
    };
    refuse((std::string(name) + " has shape " + listed(shape) + " in place of " + listed(wanted)).c_str());
}

namespace {

// If rounding has cost definiteness, a diagonal of 1 is increased by a thousand times the rounding of a double, or by
// more, up to a change of 10⁻⁵ σ², which no reported figure shows.
constexpr double REPAIRS[] = {0, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5};

}  // namespace

WIDER Array<double, 2> inverse_root_of(Rows matrix, std::size_t n, bool repair) {
    auto at = [&](std::size_t i, std::size_t c) { return matrix.data[i * matrix.stride + c]; };
    std::vector<double> scale(n), a(n * n), inverse(n * n);
    for (std::size_t i = 0; i < n; i++) scale[i] = 1 / std::sqrt(at(i, i) > 0 ? at(i, i) : 1.0);
    bool is_factored = false;
    for (double damping : REPAIRS) {
        for (std::size_t i = 0; i < n; i++)
            for (std::size_t c = 0; c <= i; c++) a[c * n + i] = at(i, c) * scale[i] * scale[c] + (c == i ? damping : 0.0);
        if ((is_factored = factor_upper(a.data(), n)) || !repair) break;
    }
    require_definite(is_factored, "information matrix is not positive definite");
    for (std::size_t i = 0; i < n; i++) {  // rows of the inverse of Uᵀ, which are zero beyond their diagonals
        double* out = inverse.data() + i * n;
        std::size_t k = 0;
        for (; k + 4 <= i; k += 4) {
            const double *of = a.data() + k * n + i, *r0 = inverse.data() + k * n, *r1 = r0 + n, *r2 = r1 + n, *r3 = r2 + n;
            double u0 = of[0], u1 = of[n], u2 = of[2 * n], u3 = of[3 * n];
            for (std::size_t c = 0; c < k + 4; c++) out[c] -= u0 * r0[c] + u1 * r1[c] + u2 * r2[c] + u3 * r3[c];
        }
        for (; k < i; k++) add(-a[k * n + i], inverse.data() + k * n, k + 1, out);
        for (std::size_t c = 0; c < i; c++) out[c] /= a[i * n + i];
        out[i] = 1 / a[i * n + i];
    }
    Array<double, 2> result(n, n);
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t c = 0; c <= i; c++) result[c][i] = inverse[i * n + c] * scale[c];
    return result;
}

Array<double, 2> inverse_root(Matrix matrix, bool repair) {
    std::size_t n = matrix.shape[0];
    require_shape(matrix, {n, n}, "matrix");
    return inverse_root_of({matrix.data, n}, n, repair);
}

SolvedBySize solved_by_size(Matrix information, Matrix weighted, Matrix sizes) {
    std::size_t k = information.shape[0], rights = weighted.shape[1], n = sizes.shape[0];
    require_shape(information, {k, k}, "information");
    require_shape(weighted, {k, rights}, "weighted");
    require_shape(sizes, {n, k}, "sizes");
    SolvedBySize result{{n}, {n, k, rights}};
    std::vector<double> lower(k * k), x(k);
    for (std::size_t row = 0; row < n; row++) {
        const double* size = sizes[row];
        for (std::size_t i = 0; i < k; i++)
            for (std::size_t c = 0; c <= i; c++) lower[i * k + c] = size[i] * information[i][c] * size[c] + (i == c ? 1.0 : 0.0);
        require_definite(factor_positive(lower.data(), k), "information is not positive definite");
        for (std::size_t i = 0; i < k; i++) result.log_det.data[row] += 2 * std::log(lower[i * (k + 1)]);
        for (std::size_t right = 0; right < rights; right++) {
            for (std::size_t i = 0; i < k; i++) x[i] = size[i] * weighted[i][right];
            solve_factored(lower.data(), x.data(), k);
            for (std::size_t i = 0; i < k; i++) result.mean[row][i * rights + right] = size[i] * x[i];
        }
    }
    return result;
}

Array<bool, 1> among(Indices ids, Indices known) {
    Array<bool, 1> result(ids.shape[0]);
    Lookup among_known{known};
    for (std::size_t i = 0; i < ids.shape[0]; i++) result.data[i] = among_known.row(ids.data[i]) != NONE;
    return result;
}

Array<std::int64_t, 1> times_among(Indices ids, Indices others, Flags counted) {
    require_shape(counted, {others.shape[0]}, "counted");
    Array<std::int64_t, 1> result(ids.shape[0]);
    Lookup rows{ids};
    for (std::size_t i = 0; i < others.shape[0]; i++)
        if (std::size_t at = counted.data[i] ? rows.row(others.data[i]) : NONE; at != NONE) result.data[at]++;
    return result;
}

Array<std::int64_t, 1> union_of(Indices ids) {
    std::vector<std::int64_t> sorted(ids.data, ids.data + ids.shape[0]);
    std::sort(sorted.begin(), sorted.end());
    sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    Array<std::int64_t, 1> result(sorted.size());
    std::copy(sorted.begin(), sorted.end(), result.data.get());
    return result;
}

}  // namespace core
