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

Array<double, 3> whiten_blocks(Matrices cov, Matrices b) {
    std::size_t n = cov.shape[0], k = b.shape[2];
    require_shape(cov, {n, 3, 3}, "cov");
    require_shape(b, {n, 3, k}, "b");
    Array<double, 3> result(n, 3, k);
    for (std::size_t i = 0; i < n; i++) {
        double lower[9], *x = result[i], *y = x + k, *z = y + k;
        require_definite(cholesky<3>(cov[i], lower), "cov is not positive definite");
        for (std::size_t c = 0; c < k; c++) {
            x[c] = b[i][c] / lower[0];
            y[c] = (b[i][k + c] - lower[3] * x[c]) / lower[4];
            z[c] = (b[i][2 * k + c] - lower[6] * x[c] - lower[7] * y[c]) / lower[8];
        }
    }
    return result;
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

WIDER Reflections reflections(Matrix columns) {
    std::size_t n = columns.shape[0], r = columns.shape[1];
    require(r <= n, "there are more columns than rows");
    Reflections result{{n, r}, {n, r}};
    std::vector<double> rows(n * r), moved(n * r);  // the columns, and of each reflection what the earlier ones make of it
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t k = 0; k < r; k++) rows[k * n + i] = columns[i][k];
    for (std::size_t k = 0; k < r; k++) {
        double *x = rows.data() + k * n, *to = moved.data() + k * n;
        double norm = std::sqrt(std::inner_product(x + k, x + n, x + k, 0.0));
        std::fill(x, x + k, 0.0);
        x[k] += std::copysign(norm, x[k]);  // now the axis that is reflected
        double square = std::inner_product(x + k, x + n, x + k, 0.0), by = square > 0 ? 2 / square : 0.0;
        for (std::size_t later = k + 1; later < r; later++) {
            double* y = rows.data() + later * n;
            add(-by * std::inner_product(x + k, x + n, y + k, 0.0), x + k, n - k, y + k);
        }
        std::copy_n(x, n, to);
        for (std::size_t before = 0; before < k; before++)
            add(-std::inner_product(x + k, x + n, rows.data() + before * n + k, 0.0), moved.data() + before * n, n, to);
        for (std::size_t i = 0; i < n; i++) {
            to[i] *= by;
            result.along[i][k] = to[i];
            result.axes[i][k] = x[i];
        }
    }
    return result;
}

WIDER Array<double, 2> minor_directions(Matrix covariance, double least) {
    std::size_t n = covariance.shape[0];
    require_shape(covariance, {n, n}, "covariance");
    std::vector<double> left(n), factor(n * n);  // variances given the variables that are chosen, and what these explain
    for (std::size_t i = 0; i < n; i++) left[i] = covariance[i][i];
    std::vector<std::size_t> chosen;
    std::vector<char> is_chosen(n);
    while (chosen.size() < n) {
        std::size_t k = chosen.size(), at = static_cast<std::size_t>(std::max_element(left.begin(), left.end()) - left.begin());
        if (!(left[at] >= least) || is_chosen[at]) break;
        double *row = factor.data() + k * n, root = std::sqrt(left[at]);
        std::copy_n(covariance[at], n, row);
        std::size_t i = 0;
        for (; i + 4 <= k; i += 4) {
            const double *r0 = factor.data() + i * n, *r1 = r0 + n, *r2 = r1 + n, *r3 = r2 + n;
            double a = r0[at], b = r1[at], c = r2[at], d = r3[at];
            for (std::size_t j = 0; j < n; j++) row[j] -= a * r0[j] + b * r1[j] + c * r2[j] + d * r3[j];
        }
        for (; i < k; i++) add(-factor[i * n + at], factor.data() + i * n, n, row);
        for (std::size_t j = 0; j < n; j++) row[j] /= root, left[j] -= row[j] * row[j];
        for (std::size_t before : chosen) row[before] = 0;
        left[at] = -std::numeric_limits<double>::infinity();
        is_chosen[at] = 1;
        chosen.push_back(at);
    }
    std::vector<std::size_t> others = rows_where(n, [&](std::size_t i) { return !is_chosen[i]; });
    std::size_t r = others.size();
    Array<double, 2> result(n, r);
    for (std::size_t c = 0; c < r; c++) result[others[c]][c] = 1;
    for (std::size_t i = chosen.size(); i-- > 0;) {  // the chosen ones move against the others
        const double* row = factor.data() + i * n;
        double* out = result[chosen[i]];
        for (std::size_t c = 0; c < r; c++) out[c] = -row[others[c]];
        for (std::size_t j = i + 1; j < chosen.size(); j++) add(-row[chosen[j]], result[chosen[j]], r, out);
        for (std::size_t c = 0; c < r; c++) out[c] /= row[chosen[i]];
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
