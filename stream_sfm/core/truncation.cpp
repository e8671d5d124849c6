// Modes of the prior that add little to all that follows from points, folded into the points' own noise, eqs. (36) and (36a).

#include "poses.hpp"
#include "products.hpp"
#include "window.hpp"

namespace core {

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

namespace {

// Rows (n, k) of A Q, with Q as `reflections` returns it.
void turn(double* rows, std::size_t n, const Reflections& by) {
    std::size_t k = by.along.shape[0], r = by.along.shape[1];
    std::vector<double> of_axes(n * r);
    add_large_product(1.0, along({rows, k}), n, down({by.along.data.get(), r}), r, k, Needed::ALL, of_axes.data(), r);
    add_large_product(-1.0, along({of_axes.data(), r}), n, along({by.axes.data.get(), r}), k, r, Needed::ALL, rows, k);
}

// Some columns of rows (n, k), without those before `first` and from `last` on.
std::vector<double> columns_of(const double* rows, std::size_t n, std::size_t k, std::size_t first, std::size_t last) {
    std::vector<double> result(n * (last - first));
    for (std::size_t i = 0; i < n; i++) std::copy(rows + i * k + first, rows + i * k + last, result.data() + i * (last - first));
    return result;
}

}  // namespace

TruncatedModes truncate_modes(Matrices cov, Matrices modes, Matrix world_modes, std::size_t of_rig, double negligible) {
    std::size_t n = cov.shape[0], k = modes.shape[2], fixed = world_modes.shape[0];
    require_shape(cov, {n, 3, 3}, "cov");
    require_shape(modes, {n, 3, k}, "modes");
    require_shape(world_modes, {fixed, k}, "world_modes");
    require(fixed + of_rig <= k, "there are fewer modes than unknowns of the world and of the rig");
    std::size_t own = k - of_rig, free = own - fixed;
    // the first modes represent the world, and an inertial state, exactly
    std::vector<double> points = columns_of(modes.data, 3 * n, k, 0, own), world = columns_of(world_modes.data, fixed, k, 0, own);
    Array<double, 2> by_world(own, fixed);
    for (std::size_t i = 0; i < own; i++)
        for (std::size_t row = 0; row < fixed; row++) by_world[i][row] = world[row * own + i];
    Reflections to_world = reflections(by_world);
    turn(points.data(), 3 * n, to_world);
    turn(world.data(), fixed, to_world);
    std::vector<double> others = columns_of(points.data(), 3 * n, own, fixed, own);
    Array<double, 3> whitened = whiten_blocks(cov, {others.data(), {n, 3, free}});
    Array<double, 2> squares(free, free);
    Rows rows{whitened.data.get(), free};
    add_large_product(1.0, down(rows), free, down(rows), free, 3 * n, Needed::LOWER, squares.data.get(), free);
    for (std::size_t i = 0; i < free; i++)
        for (std::size_t c = 0; c < i; c++) squares[c][i] = squares[i][c];
    Array<double, 2> minor = minor_directions(squares, negligible);
    turn(others.data(), 3 * n, reflections(minor));
    std::size_t folded = minor.shape[1], kept = k - folded;
    TruncatedModes result{{n, 3, 3}, {n, 3, kept}, {fixed, kept}};
    std::copy_n(cov.data, 9 * n, result.cov.data.get());
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t x = 0; x < 3; x++) {
            const double* of = others.data() + (3 * i + x) * free;
            for (std::size_t y = 0; y < 3; y++) result.cov[i][3 * x + y] += std::inner_product(of, of + folded, others.data() + (3 * i + y) * free, 0.0);
            double* out = std::copy_n(points.data() + (3 * i + x) * own, fixed, result.modes[i] + x * kept);
            std::copy_n(modes[i] + x * k + own, of_rig, std::copy_n(of + folded, free - folded, out));
        }
    for (std::size_t row = 0; row < fixed; row++) {
        double* out = std::copy_n(world.data() + row * own, fixed, result.world_modes[row]);
        std::copy_n(world_modes[row] + own, of_rig, out + free - folded);
    }
    return result;
}

}  // namespace core
