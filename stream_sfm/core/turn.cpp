// The turn of the right camera that a frame shows, fitted together with the motion, eq. (72d).

#include "resection.hpp"

namespace core {
namespace {

enum : std::size_t { UNKNOWNS = 9, COLUMNS };  // motion and turn; with the residual

// xᵀ A⁻¹ x of a covariance A (3, 3), and log |A|; NaN if A is not definite.
double squared_length(const double* a, const double* x, double& log_det) {
    double lower[9], solved[3], sum = 0;
    log_det = std::numeric_limits<double>::quiet_NaN();
    if (!cholesky<3>(a, lower)) return log_det;
    log_det = 0;
    std::copy_n(x, 3, solved);
    substitute(lower, solved, 3);
    for (int i = 0; i < 3; i++) {
        sum += solved[i] * solved[i];
        log_det += 2 * std::log(lower[4 * i]);
    }
    return sum;
}

// `out` (3, 3) becomes a + by · x xᵀ.
void add_outer(const double* a, double by, const double* x, double* out) {
    for (int i = 0; i < 9; i++) out[i] = a[i] + by * x[i / 3] * x[i % 3];
}

void require_turn(const UsualTurnsView& usual, const TurnView& turn) {
    for (Matrix of : {usual.measured, usual.real, turn.cov, turn.apparent.cov_others}) require_shape(of, {3, 3}, "a covariance");
    require_shape(turn.rad, {3}, "rad");
    require_shape(turn.apparent.per_s, {3}, "per_s");
    require_shape(usual.late, {2}, "late");
}

// The whitened rows of views: columns of motion and turn, and the residual; `squares`: the squared residuals of each view.
std::vector<double> rows_of(const PointViews& views, const LinearisedViews& linear, const ViewResiduals& seen,
                            std::vector<double>& squares) {
    std::vector<double> rows(4 * squares.size() * COLUMNS);
    for (std::size_t i = 0; i < squares.size(); i++) {
        if (!std::isfinite(seen.squares[0][i])) continue;
        double turned[6];
        by_turn(views.projection, views.z_px[i][2], views.z_px[i][3], turned);
        for (std::size_t row = 0; row < 4; row++) {
            double* out = rows.data() + (4 * i + row) * COLUMNS;
            const double* root = linear.root[i] + 4 * row;
            std::copy_n(linear.jacobian[i] + 6 * row, 6, out);
            for (std::size_t k = 0; k < 3; k++) out[6 + k] = root[2] * turned[k] + root[3] * turned[3 + k];
            out[9] = seen.residuals[0][4 * i + row];
            squares[i] += out[9] * out[9];
        }
    }
    return rows;
}

// The turn after `steps` steps of reweighting.
FittedTurn fitted(const PointViews& views, Matrix motion, int steps, Matrix usual, double std_knock) {
    std::size_t n = views.points.shape[0];
    LinearisedViews linear = linearise_views(views, motion);
    ViewResiduals seen = view_residuals(views, linear.root, Array<double, 1>(0), {motion.data, {1, 4, 4}});
    FittedTurn result{{3}, {3, 3}, {n}, 0.0, 0.0};
    std::vector<double> squares(n), rows = rows_of(views, linear, seen, squares);
    double spread = 1, step[UNKNOWNS], information[UNKNOWNS * UNKNOWNS], cov[UNKNOWNS * UNKNOWNS];
    for (int k = 0; k < steps; k++) {
        spread = std::max(1.0, median(squares) / MEDIAN_CHI2_4);
        std::fill(information, information + UNKNOWNS * UNKNOWNS, 0.0);
        std::fill(step, step + UNKNOWNS, 0.0);
        for (std::size_t i = 0; i < 4 * n; i++) {
            const double* j = rows.data() + i * COLUMNS;
            double weight = 1 / (1 + squares[i / 4] / (CAUCHY_WIDTH * CAUCHY_WIDTH * spread));
            for (std::size_t a = 0; a < UNKNOWNS; a++) {
                for (std::size_t b = 0; b < UNKNOWNS; b++) information[a * UNKNOWNS + b] += weight * j[a] * j[b];
                step[a] += weight * j[a] * j[9];
            }
        }
        for (std::size_t a = 0; a < UNKNOWNS; a++)  // an undetermined part of the motion stays unchanged
            information[a * (UNKNOWNS + 1)] += DAMPING * (information[a * (UNKNOWNS + 1)] + DAMPING);
        double factor[UNKNOWNS * UNKNOWNS];
        std::copy(information, information + UNKNOWNS * UNKNOWNS, factor);
        require_definite(solve_positive(factor, step, UNKNOWNS), "the views do not determine a turn");
        for (std::size_t i = 0; i < n; i++) {
            squares[i] = 0;
            for (std::size_t row = 0; row < 4; row++) {
                const double* j = rows.data() + (4 * i + row) * COLUMNS;
                double left = j[9];
                for (std::size_t a = 0; a < UNKNOWNS; a++) left -= j[a] * step[a];
                squares[i] += left * left;
            }
        }
    }
    invert_positive<UNKNOWNS>(information, cov);
    std::copy_n(step + 6, 3, result.rad.data.get());
    for (std::size_t i = 0; i < n; i++)
        result.agree.data[i] = std::isfinite(seen.squares[0][i]) && squares[i] < spread * views.gate.data[i];
    double expected[9], knocked[9], log_det, log_det_knocked;
    for (std::size_t k = 0; k < 9; k++) {
        result.cov.data[k] = spread * cov[(6 + k / 3) * UNKNOWNS + 6 + k % 3];
        expected[k] = result.cov.data[k] + usual.data[k];
        knocked[k] = expected[k] + (k % 4 == 0 ? std_knock * std_knock : 0.0);
    }
    result.squared = squared_length(expected, result.rad.data.get(), log_det);
    double of_knock = squared_length(knocked, result.rad.data.get(), log_det_knocked);
    result.log_odds = (result.squared - of_knock + log_det - log_det_knocked) / 2;
    return result;
}

}  // namespace

void turn_by(const Pinholes& pinholes, Vector rad, double sign, Array<double, 2>& right) {
    if (rad.data[0] == 0 && rad.data[1] == 0 && rad.data[2] == 0) return;
    for (std::size_t i = 0; i < right.shape[0]; i++) {
        double effect[6];
        by_turn(pinholes, right[i][0], right[i][1], effect);
        for (int c = 0; c < 2; c++)
            right[i][c] += sign * (effect[3 * c] * rad.data[0] + effect[3 * c + 1] * rad.data[1] + effect[3 * c + 2] * rad.data[2]);
    }
}

Array<double, 3> effects_of_turn(const Pinholes& pinholes, Matrix right) {
    require_shape(right, {right.shape[0], 2}, "right_px");
    return each(right, Array<double, 3>(right.shape[0], 2, 3),
                [&](const double* at, double* out) { by_turn(pinholes, at[0], at[1], out); });
}

Array<double, 3> views_by_turn(const Pinholes& pinholes, Matrix z, Matrix root) {
    std::size_t n = z.shape[0], e = root.shape[1];
    require_shape(z, {n, 4}, "z_px");
    require_shape(root, {3, e}, "root");
    Array<double, 3> result(n, 4, e);
    for (std::size_t i = 0; i < n; i++) {
        if (!std::isfinite(z[i][2])) continue;
        double turned[6];
        by_turn(pinholes, z[i][2], z[i][3], turned);
        for (std::size_t c = 0; c < 6; c++) add(turned[c], root[c % 3], e, result[i] + (2 + c / 3) * e);
    }
    return result;
}

Array<double, 3> with_turn(const Pinholes& pinholes, Matrix z, Matrices cov, Matrix root) {
    std::size_t n = z.shape[0], e = root.shape[1];
    require_shape(cov, {n, 4, 4}, "cov_px");
    Array<double, 3> moved = views_by_turn(pinholes, z, root), result(n, 4, 4);
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t c = 0; c < 16; c++) {
            const double *a = moved[i] + c / 4 * e, *b = moved[i] + c % 4 * e;
            result[i][c] = std::inner_product(a, a + e, b, cov[i][c]);
        }
    return result;
}

WeighedTurn weigh_turn(const UsualTurnsView& usual, const TurnView& turn, Vector sizes) {
    require_turn(usual, turn);
    WeighedTurn result{0, {sizes.shape[0]}};
    double own[9], with_usual[9], knocked[9], sized[9], log_det, log_det_knocked;
    add_outer(turn.apparent.cov_others.data, turn.apparent.var_delay_s2, turn.apparent.per_s.data, own);
    for (int i = 0; i < 9; i++) {
        own[i] += turn.cov.data[i];
        with_usual[i] = own[i] + usual.measured.data[i];
        if (i % 4 == 0) with_usual[i] += turn.apparent.std_rad * turn.apparent.std_rad;
        knocked[i] = with_usual[i] + (i % 4 == 0 ? usual.rules.std_rad * usual.rules.std_rad : 0.0);
    }
    double squared = squared_length(with_usual, turn.rad.data, log_det);
    double of_knock = squared_length(knocked, turn.rad.data, log_det_knocked);
    // `measured` follows from three numbers in each frame, so usual turns have a t-distribution
    double n = 3.0 * (std::max(usual.frames - usual.rules.guess_frames, 0) + 1);
    double log_usual = std::lgamma((n + 3) / 2) - std::lgamma(n / 2) - 1.5 * std::log(n / 2);
    log_usual -= (n + 3) / 2 * std::log1p(squared / n) + log_det / 2;
    result.log_odds = -of_knock / 2 - log_det_knocked / 2 - log_usual;
    for (std::size_t k = 0; k < sizes.shape[0]; k++) {
        for (int i = 0; i < 9; i++) sized[i] = own[i] + sizes.data[k] * sizes.data[k] * usual.real.data[i];
        double distance2 = squared_length(sized, turn.rad.data, log_det);
        result.log_likelihoods.data[k] = -0.5 * (distance2 + log_det);
    }
    return result;
}

LearntTurns learn_turn(const UsualTurnsView& usual, const TurnView& turn, int frames) {
    require_turn(usual, turn);
    require(frames > 0, "a turn is learnt from some frames");
    LearntTurns result;
    const double *per_s = turn.apparent.per_s.data, *rad = turn.rad.data, *real = usual.real.data;
    double others[9], all[9], by_delay[3], cov[9], inverse[9], left[3], gain[9], moved[3];
    for (int i = 0; i < 9; i++) {
        others[i] = turn.cov.data[i] + turn.apparent.cov_others.data[i];
        all[i] = real[i] + others[i];
    }
    std::copy_n(per_s, 3, by_delay);
    require_definite(solve_positive(all, by_delay, 3), "the covariance of turns is not definite");
    double keep = 1 - 1.0 / frames, var_s2 = turn.apparent.var_delay_s2;
    result.late.data[0] = keep * usual.late.data[0] + std::inner_product(by_delay, by_delay + 3, per_s, 0.0);
    result.late.data[1] = keep * usual.late.data[1] + std::inner_product(by_delay, by_delay + 3, rad, 0.0);
    var_s2 = var_s2 > 0 ? 1 / (1 / var_s2 + result.late.data[0]) : 0.0;
    add_outer(others, var_s2, per_s, cov);
    for (int i = 0; i < 9; i++) cov[i] += real[i];
    for (int i = 0; i < 3; i++) left[i] = rad[i] - var_s2 * result.late.data[1] * per_s[i];
    invert3(cov, inverse);
    multiply<3, 3, 3>(real, inverse, gain);
    multiply<3, 3, 1>(gain, left, moved);
    multiply<3, 3, 3>(gain, real, all);
    double counts = turn.chi2 < usual.rules.limit ? 1.0 : usual.rules.limit / turn.chi2;
    for (int i = 0; i < 9; i++) {
        int j = i % 3 * 3 + i / 3;
        double expected = counts * moved[i / 3] * moved[i % 3] + real[i] - 0.5 * (all[i] + all[j]);
        result.real.data[i] = real[i] + (expected - real[i]) / frames;
        result.measured.data[i] = usual.measured.data[i] + (counts * rad[i / 3] * rad[i % 3] - usual.measured.data[i]) / frames;
    }
    return result;
}

FittedTurn fit_turn(const PointViews& views, Matrix motion, Matrix usual, const TurnRules& rules) {
    std::size_t n = views.points.shape[0];
    require_shape(motion, {4, 4}, "cam_from_ref");
    require_shape(usual, {3, 3}, "usual");
    require_shape(views.z_px, {n, 4}, "z_px");
    require(views.shared.shape[2] == 0, "a turn is fitted without other errors");
    std::vector<std::size_t> seen = rows_where(n, [&](std::size_t i) { return std::isfinite(views.z_px[i][2]); });
    require(!seen.empty(), "no right side was seen");
    SelectedViews of_right(views, seen);
    FittedTurn found = fitted(of_right.views(), motion, 1, usual, rules.std_rad);  // one step suffices to rule out a knock
    if (found.log_odds > 0) found = fitted(of_right.views(), motion, rules.steps, usual, rules.std_rad);
    Array<bool, 1> agree(n);
    for (std::size_t k = 0; k < seen.size(); k++) agree.data[seen[k]] = found.agree.data[k];
    found.agree = std::move(agree);
    return found;
}

}  // namespace core
