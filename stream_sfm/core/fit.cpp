// The motion that brings points onto their views: annealed Cauchy weights, a gate, and plain least squares, eqs. (20)–(23).

#include "resection.hpp"
#include "poses.hpp"

namespace core {
namespace {

constexpr std::size_t CHUNK = 16;  // views whose products are summed at once

// The median of the squared residuals within `gates` gates, over its expected value; at least 1.
double spread_of(const double* squares, const double* gate, double gates, std::size_t n) {
    std::vector<double> within;
    within.reserve(n);
    for (std::size_t i = 0; i < n; i++)
        if (gate ? squares[i] < gates * gate[i] : std::isfinite(squares[i])) within.push_back(squares[i]);
    return within.empty() ? 1.0 : std::max(1.0, median(std::move(within)) / MEDIAN_CHI2_4);
}

// The inverse of an information matrix (n, n), scaled by its own diagonal; false if a direction is not determined.
bool invert_information(const std::vector<double>& information, std::size_t n, double* out) {
    std::vector<double> scale(n), factor(n * n), inverse(n * n);
    for (std::size_t i = 0; i < n; i++) {
        if (!(information[i * n + i] > 0)) return false;
        scale[i] = 1 / std::sqrt(information[i * n + i]);
    }
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t j = 0; j < n; j++) factor[i * n + j] = information[i * n + j] * scale[i] * scale[j];
    if (!factor_positive(factor.data(), n)) return false;
    double variances = 0;  // of the scaled matrix, whose diagonal is 1
    for (std::size_t j = 0; j < n; j++) {
        double* column = inverse.data() + j * n;
        column[j] = 1;
        solve_factored(factor.data(), column, n);
        variances += column[j];
    }
    if (!(variances < 1e10)) return false;  // the data do not determine a direction
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t j = 0; j < n; j++) out[i * n + j] = 0.5 * scale[i] * scale[j] * (inverse[i * n + j] + inverse[j * n + i]);
    return true;
}

class Fit {
   public:
    Fit(const PointViews& views, Matrix start, Vector amplitudes, const ResectionRules& rules)
        : views(views), rules(rules), n(views.points.shape[0]), size(6 + amplitudes.shape[0]), motion(start.data, start.data + 16),
          shared(amplitudes.data, amplitudes.data + amplitudes.shape[0]), weights(n),
          linear{{0, 4, 4}, {0, 4, 6}}, seen{{0, 0, 4}, {0, 0}} {}

    // Gauss-Newton with Cauchy weights relative to the spread of the residuals, eq. (22).
    void anneal() {
        linearise();
        look();
        int k = 0;
        for (; k < rules.robust_steps; k++) {
            double spread = spread_of(squares(), nullptr, 0, n);
            double width = spread * (k < rules.wide_steps ? rules.first_half_weight : CAUCHY_WIDTH * CAUCHY_WIDTH);
            for (std::size_t i = 0; i < n; i++) weights[i] = 1 / (1 + squares()[i] / width);
            if (step() < rules.robust_converged && (k >= rules.wide_steps - 1 || spread < rules.settled_spread)) break;
            if ((k + 1) % rules.relinearised == 0) linearise();
            look();
        }
        if (k >= rules.relinearised) linearise();  // with fewer steps, the start was good enough for linearisation
    }

    // Gauss-Newton over the views that pass the gate, eq. (23), which is applied again after each step.
    Fitted finish(const double* votes) {
        Fitted result(n, size - 6);
        bool* accepted = result.accepted.data.get();
        look();
        auto judge = [&] {
            bool same = true;
            for (std::size_t i = 0; i < n; i++) {
                bool before = accepted[i];
                accepted[i] = squares()[i] < views.gate.data[i];
                same = same && before == accepted[i];
            }
            return same;
        };
        judge();
        for (int k = 0; k < rules.final_steps; k++) {
            for (std::size_t i = 0; i < n; i++) weights[i] = accepted[i] ? 1.0 : 0.0;
            double moved = step();
            look();
            if (judge() && moved < rules.final_converged) break;
        }
        Array<double, 3> found = orthonormalise({motion.data(), {1, 4, 4}});
        std::copy_n(found[0], 16, result.cam_from_ref[0]);
        std::copy(shared.begin(), shared.end(), result.amplitudes.data.get());
        bool determined = give_covariance(result);
        std::copy(squares(), squares() + n, result.squared_residuals.data.get());
        result.spread = spread_of(squares(), views.gate.data, rules.spread_gates, n);
        double all = 0;
        std::size_t agree = 0;
        for (std::size_t i = 0; i < n; i++) {
            all += votes[i];
            if (!accepted[i]) continue;
            result.chi2 += squares()[i];
            result.share += votes[i];
            agree++;
            for (int k = 0; k < 4; k++) result.dof += std::isfinite(views.z_px[i][k]);
        }
        result.share /= std::max(all, std::numeric_limits<double>::min());
        result.ok = determined && agree >= MIN_VIEWS;
        return result;
    }

    void linearise() { linear = linearise_views(views, {motion.data(), {4, 4}}); }

   private:
    // Whether the views determine the motion.
    bool give_covariance(Fitted& result) const {
        std::vector<double> cov(size * size);
        bool determined = invert_information(information, size, cov.data());
        std::size_t j = size - 6;
        for (std::size_t a = 0; a < 6; a++)
            for (std::size_t b = 0; b < 6; b++)
                result.cov_pose[a][b] = determined ? cov[a * size + b] : std::numeric_limits<double>::infinity();
        for (std::size_t a = 0; a < j; a++)
            for (std::size_t b = 0; b < j; b++)
                result.cov_amplitudes[a][b] = determined ? cov[(6 + a) * size + 6 + b] : (a == b ? 1.0 : 0.0);
        return determined;
    }

    void look() {
        seen = view_residuals(views, linear.root, {shared.data(), {size - 6}}, {motion.data(), {1, 4, 4}});
    }

    const double* squares() const { return seen.squares.data.get(); }

    // Take a weighted step, and return its squared length in standard deviations.
    double step() {
        std::vector<double> delta(size), weighted(CHUNK * 4 * size), jacobians(CHUNK * 4 * size), residuals(CHUNK * 4);
        information.assign(size * size, 0.0);
        std::size_t rows = 0;
        auto add_rows = [&] {
            add_product({weighted.data(), size}, size, {residuals.data(), 1}, 1, rows, 0, delta.data());
            add_product({weighted.data(), size}, size, {jacobians.data(), size}, size, rows, size, information.data());
            rows = 0;
        };
        for (std::size_t i = 0; i < n; i++) {
            if (weights[i] == 0) continue;
            const double* jacobian = linear.jacobian[i];
            for (std::size_t c = 0; c < 4 * size; c++) weighted[rows * size + c] = weights[i] * jacobian[c];
            std::copy_n(jacobian, 4 * size, jacobians.data() + rows * size);
            std::copy_n(seen.residuals[0] + 4 * i, 4, residuals.data() + rows);
            if ((rows += 4) == 4 * CHUNK) add_rows();
        }
        add_rows();
        for (std::size_t a = 6; a < size; a++) {  // amplitudes have σ = 1
            information[a * size + a] += 1;
            delta[a] -= shared[a - 6];
        }
        for (std::size_t a = 0; a < size; a++)
            for (std::size_t b = a + 1; b < size; b++) information[b * size + a] = information[a * size + b];
        std::vector<double> damped = information;
        solve_damped(damped, delta.data(), size);
        double length2 = 0, angle = std::sqrt(delta[3] * delta[3] + delta[4] * delta[4] + delta[5] * delta[5]);
        if (angle > MAX_ROTATION_STEP_RAD)
            for (std::size_t i = 0; i < size; i++) delta[i] *= MAX_ROTATION_STEP_RAD / angle;
        for (std::size_t i = 0; i < size; i++)
            for (std::size_t j = 0; j < size; j++) length2 += delta[i] * information[i * size + j] * delta[j];
        Array<double, 3> by = pose_exp({delta.data(), {1, 6}});
        std::vector<double> before = motion;
        multiply<4, 4, 4>(by[0], before.data(), motion.data());
        for (std::size_t i = 6; i < size; i++) shared[i - 6] += delta[i];
        return length2;
    }

    const PointViews& views;
    const ResectionRules& rules;
    std::size_t n, size;
    std::vector<double> motion, shared, weights, information;
    LinearisedViews linear;
    ViewResiduals seen;
};

}  // namespace

WIDER Fitted fit_motion(const PointViews& views, Matrix start, Vector amplitudes, Vector votes, const ResectionRules& rules, bool anneal) {
    require_shape(start, {4, 4}, "cam_from_ref");
    require_shape(amplitudes, {views.shared.shape[2]}, "amplitudes");
    require_shape(votes, {views.points.shape[0]}, "votes");
    require(amplitudes.shape[0] <= 1000, "there are too many shared errors");
    Fit fit(views, start, amplitudes, rules);
    if (anneal) fit.anneal();
    else fit.linearise();
    return fit.finish(votes.data);
}

// The motions of halves of the views: far and near, left and right, upper and lower ones.
Halves motions_of_halves(const PointViews& views, Matrix motion, Vector amplitudes, Flags accepted,
                         double shared_noise) {
    std::size_t all = views.points.shape[0], m = 6 + amplitudes.shape[0], size = m + 6;
    require_shape(accepted, {all}, "accepted");
    require_shape(amplitudes, {views.shared.shape[2]}, "amplitudes");
    require_shape(motion, {4, 4}, "cam_from_ref");
    require(m <= 1000, "there are too many shared errors");
    LinearisedViews linear = linearise_views(views, motion);
    ViewResiduals seen = view_residuals(views, linear.root, amplitudes, {motion.data, {1, 4, 4}});
    Halves result{0.0, {6, 4, 4}};
    std::vector<std::size_t> rows = rows_where(all, [&](std::size_t i) { return accepted.data[i]; });
    auto of_view = [&](std::size_t i) { return Rows{linear.jacobian[i], m}; };
    std::vector<double> information(m * m), of_half(m * 6), h(size * size), x(size);
    for (std::size_t a = 6; a < m; a++) information[a * m + a] = 1;  // of the errors that all share
    for (std::size_t i : rows) add_product(of_view(i), m, of_view(i), m, 4, m, information.data());
    for (std::size_t a = 0; a < m; a++)
        for (std::size_t b = 0; b < a; b++) information[a * m + b] = information[b * m + a];
    for (std::size_t by = 0; by < 3; by++) {
        auto value = [&](std::size_t i) { return by == 0 ? views.points[i][3] : views.z_px[i][by - 1]; };
        auto half = rows;
        auto middle = half.begin() + static_cast<std::ptrdiff_t>(rows.size() / 2);
        std::nth_element(half.begin(), middle, half.end(), [&](std::size_t i, std::size_t j) {
            return value(i) < value(j) || (value(i) == value(j) && i < j);
        });
        std::sort(middle, half.end());
        std::fill(of_half.begin(), of_half.end(), 0.0);
        std::fill(x.begin(), x.end(), 0.0);
        for (auto i = middle; i != half.end(); ++i) {
            add_product(of_view(*i), m, of_view(*i), 6, 4, 0, of_half.data());
            for (std::size_t row = 0; row < 4; row++)  // the motion is at the minimum of all views, but not at that of the half
                for (std::size_t a = 0; a < 6; a++)
                    x[m + a] += linear.jacobian[*i][row * m + a] * seen.residuals[0][4 * *i + row];
        }
        for (std::size_t a = 0; a < size; a++)
            for (std::size_t b = 0; b < size; b++)
                h[a * size + b] = a < m && b < m ? information[a * m + b]
                                  : b >= m       ? of_half[(a < m ? a : a - m) * 6 + b - m]
                                                 : of_half[b * 6 + a - m];
        std::vector<double> g = x;
        solve_damped(h, x.data(), size);
        double distance = 0;
        for (std::size_t a = 0; a < size; a++) distance += g[a] * x[a];
        result.apart = std::max(result.apart, distance / (1 + shared_noise * static_cast<double>(rows.size())));
        double both[12];
        for (std::size_t a = 0; a < 6; a++) both[a] = x[a], both[6 + a] = x[a] + x[m + a];
        Array<double, 3> by_step = pose_exp({both, {2, 6}});
        for (std::size_t k = 0; k < 2; k++) multiply<4, 4, 4>(by_step[k], motion.data, result.motions[2 * by + k]);
    }
    return result;
}

}  // namespace core
