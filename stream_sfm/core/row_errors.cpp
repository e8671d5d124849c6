// Row differences of left and right: their estimation, and whether a match lies on its row, eq. (19).

#include "rig.hpp"

namespace core {
namespace {

enum : std::size_t { POLYNOMIAL = 6 };  // coefficients; then the delay, then the field

// The covariance (3, 3) of the apparent turn of the right camera by errors (n, k) of right rows.
Array<double, 2> as_turn(const Pinholes& pinholes, Matrix z, const Array<double, 2>& errors) {
    std::size_t k = errors.shape[1];
    std::vector<double> seen(3 * k), turns(3 * k);
    double information[9] = {}, axes[9];
    for (std::size_t i = 0; i < z.shape[0]; i++) {
        if (!std::isfinite(z[i][2])) continue;
        double effect[6];
        by_turn(pinholes, z[i][2], z[i][3], effect);
        for (std::size_t a = 0; a < 3; a++) {
            for (std::size_t b = 0; b < 3; b++) information[3 * a + b] += effect[a] * effect[b] + effect[3 + a] * effect[3 + b];
            for (std::size_t c = 0; c < k; c++) seen[a * k + c] += effect[3 + a] * errors[i][c];
        }
    }
    diagonalise(information, axes, 3);
    double most = std::max({information[0], information[4], information[8]});
    for (std::size_t axis = 0; axis < 3; axis++) {
        if (!(information[4 * axis] > most * 1e-15)) continue;  // views do not show this turn
        for (std::size_t c = 0; c < k; c++) {
            double along = 0;
            for (std::size_t a = 0; a < 3; a++) along += axes[3 * a + axis] * seen[a * k + c] / information[4 * axis];
            for (std::size_t a = 0; a < 3; a++) turns[a * k + c] += axes[3 * a + axis] * along;
        }
    }
    Array<double, 2> result(3, 3);
    for (std::size_t a = 0; a < 3; a++)
        for (std::size_t b = 0; b < 3; b++)
            for (std::size_t c = 0; c < k; c++) result[a][b] += turns[a * k + c] * turns[b * k + c];
    return result;
}

}  // namespace

Array<double, 2> row_terms(const Pinholes& pinholes, const Field& field, Matrix at, Vector speed) {
    std::size_t n = at.shape[0];
    if (speed.shape[0] != 1) require_shape(speed, {n}, "row_speed_px_s");
    Array<double, 2> basis = field_basis(field, at);
    std::size_t k = basis.shape[1];
    const auto size = pinholes.size();
    double centre[2] = {(size[0] - 1) / 2, (size[1] - 1) / 2}, unit = std::max(centre[0], centre[1]);
    Array<double, 2> result(n, POLYNOMIAL + 1 + k);
    for (std::size_t i = 0; i < n; i++) {
        double x = (at[i][0] - centre[0]) / unit, y = (at[i][1] - centre[1]) / unit, *out = result[i];
        double own[POLYNOMIAL + 1] = {1, x, y, x * x, x * y, y * y, -speed.data[speed.shape[0] == 1 ? 0 : i]};
        std::copy(basis[i], basis[i] + k, std::copy(own, own + POLYNOMIAL + 1, out));
    }
    return result;
}

Array<double, 1> row_offsets(const RowModel& rows, Matrix at, Vector speed) {
    Array<double, 2> terms = row_terms(rows.projection, rows.field, at, speed);
    std::size_t n = terms.shape[0], k = terms.shape[1];
    require_shape(rows.mean, {k}, "mean");
    Array<double, 1> result(n);
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t c = 0; c < k; c++) result.data[i] += terms[i][c] * rows.mean.data[c];
    return result;
}

FittedRows fit_rows(const RowModel& rows, Matrix at, Vector difference, Vector speed, Matrix own, double step_px, double half_weight,
                    int reweightings) {
    Array<double, 2> terms = row_terms(rows.projection, rows.field, at, speed);
    std::size_t n = terms.shape[0], k = terms.shape[1], e = own.shape[1], all = k + e;
    require_shape(difference, {n}, "difference_px");
    require_shape(own, {n, e}, "own_px");
    require_shape(rows.mean, {k}, "mean");
    require_shape(rows.cov, {k, k}, "cov of rows");
    require(reweightings >= 1 && reweightings <= 1000, "reweightings is not within 1 and 1000");
    const char* otherwise = "the covariance of rows is not positive definite";
    FittedRows result{{k, k}, {k}, {k}, {n}, {n}};
    std::vector<double> factor(rows.cov.data, rows.cov.data + k * k), before(k * k), weighted(k);
    for (std::size_t a = 0; a < POLYNOMIAL; a++) factor[a * k + a] += step_px * step_px;
    require_definite(factor_positive(factor.data(), k), otherwise);
    for (std::size_t a = 0; a < k; a++) {
        before[a * k + a] = 1;
        solve_factored(factor.data(), before.data() + a * k, k);
        weighted[a] = std::inner_product(rows.mean.data, rows.mean.data + k, before.data() + a * k, 0.0);
    }
    // the frame's own errors first: eliminating them leaves what it says of the rows
    std::vector<double> information(all * all), right(all), mean(all), columns(n * all);
    for (std::size_t i = 0; i < n; i++) std::copy_n(terms[i], k, std::copy_n(own[i], e, columns.data() + i * all));
    auto look = [&] {
        for (std::size_t i = 0; i < n; i++) {
            const double* column = columns.data() + i * all;
            result.left_over.data[i] = difference.data[i] - std::inner_product(column + e, column + all, mean.data() + e, 0.0);
            result.unexplained.data[i] = result.left_over.data[i] - std::inner_product(column, column + e, mean.data(), 0.0);
        }
    };
    std::copy_n(rows.mean.data, k, mean.data() + e);
    look();
    for (int round = 0; round < reweightings; round++) {  // earlier frames keep their weight
        std::fill(information.begin(), information.end(), 0.0);
        std::fill(right.begin(), right.end(), 0.0);
        for (std::size_t a = 0; a < e; a++) information[a * all + a] = 1;
        for (std::size_t a = 0; a < k; a++) {
            std::copy_n(before.data() + a * k, k, information.data() + (e + a) * all + e);
            right[e + a] = weighted[a];
        }
        for (std::size_t i = 0; i < n; i++) {
            double residual = result.unexplained.data[i] / rows.unexplained_px / half_weight;
            double weight = 1 / (1 + residual * residual) / (rows.unexplained_px * rows.unexplained_px);
            const double* column = columns.data() + i * all;
            add(weight * difference.data[i], column, all, right.data());
            for (std::size_t a = 0; a < all; a++) add(weight * column[a], column, a + 1, information.data() + a * all);
        }
        factor = information;
        mean = right;
        require_definite(solve_positive(factor.data(), mean.data(), all), otherwise);
        look();
    }
    for (std::size_t a = 0; a < all; a++)
        for (std::size_t b = 0; b < a; b++) information[b * all + a] = information[a * all + b];
    for (std::size_t c = 0; c < e; c++)  // Schur complement, one own error after the other
        for (std::size_t a = c + 1; a < all; a++) {
            double share = information[a * all + c] / information[c * all + c];
            for (std::size_t b = c + 1; b < all; b++) information[a * all + b] -= share * information[c * all + b];
            right[a] -= share * right[c];
        }
    for (std::size_t a = 0; a < k; a++) {
        std::copy_n(information.data() + (e + a) * all + e, k, result.information[a]);
        result.weighted.data[a] = right[e + a];
        result.mean.data[a] = mean[e + a];
    }
    return result;
}

Array<bool, 1> on_one_row(const RowModel& rows, Matrix left, Matrix right, Vector speed, double scale) {
    std::size_t n = left.shape[0];
    require_shape(left, {n, 2}, "left_px");
    require_shape(right, {n, 2}, "right_px");
    if (speed.shape[0] != 1) require_shape(speed, {n}, "row_speed_px_s");
    Array<bool, 1> result(n);
    require(rows.cov.shape[0] > POLYNOMIAL && rows.cov.shape[1] == rows.cov.shape[0], "there is no covariance of rows");
    double gate = rows.rules.gate_sigmas, std_delay = std::sqrt(rows.cov[POLYNOMIAL][POLYNOMIAL]);
    for (std::size_t i = 0; i < n; i++) {
        double late = std::abs(speed.data[speed.shape[0] == 1 ? 0 : i]) * std_delay;
        double wide = std::max(gate * std::hypot(rows.scatter_px, late), rows.rules.least_gate_px);
        result.data[i] = std::abs(right[i][1] - left[i][1]) < scale * std::min(wide, rows.max_px + gate * late);
    }
    return result;
}

WIDER UnknownOfViews unknown_errors(const Timing& timing, const RowModel& rows, Matrix before, Matrix now, Matrix z, Vector twist,
                              Vector std_twist) {
    std::size_t n = z.shape[0], k = rows.mean.shape[0];
    require_shape(z, {n, 4}, "z_px");
    require_shape(now, {n, 4}, "points");
    require_shape(rows.cov, {k, k}, "cov of rows");
    Array<double, 3> by_time = timing_unknowns(rows.projection, timing.row_of, before, timing.twist.value_or(twist), now, twist,
                                               timing.mean, timing.cov, std_twist);
    Array<double, 2> terms =
        row_terms(rows.projection, rows.field, two_columns_of(z, 0), row_speeds(rows.projection, now, twist));
    Array<double, 2> errors(n, k);
    require(terms.shape[1] == k, "there are not as many amplitudes of rows as terms");
    std::vector<double> root(rows.cov.data, rows.cov.data + k * k);
    require_definite(factor_positive(root.data(), k), "the covariance of rows is not positive definite");
    for (std::size_t i = 0; i < n; i++) {
        if (!std::isfinite(z[i][2])) continue;
        for (std::size_t a = 0; a < k; a++)
            for (std::size_t b = 0; b <= a; b++) errors[i][b] += terms[i][a] * root[a * k + b];
    }
    Array<double, 2> own = principal_components(errors), cov_turn = as_turn(rows.projection, z, errors);
    std::size_t others = by_time.shape[2];
    Array<double, 3> both(n, 4, others + own.shape[1]);
    for (std::size_t i = 0; i < n; i++) {
        for (std::size_t c = 0; c < 4; c++) std::copy_n(by_time[i] + c * others, others, both[i] + c * both.shape[2]);
        std::copy_n(own[i], own.shape[1], both[i] + 3 * both.shape[2] + others);
    }
    return {principal_errors(both), std::move(cov_turn)};
}

}  // namespace core
