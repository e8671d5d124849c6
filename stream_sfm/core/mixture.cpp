// A rig's errors as a mixture in which groups may be exactly zero, by ratios of densities at zero (Dickey 1971), eqs.
// (72).

#include "rig.hpp"

namespace core {
namespace {

using Numbers = std::vector<double>;
using Which = std::vector<std::size_t>;

struct Gaussian {
    Numbers mean, cov;
    std::size_t size() const { return mean.size(); }
};

// The marginal Gaussian of the rows `which`.
Gaussian part(const Gaussian& of, const Which& which) {
    std::size_t m = of.size(), n = which.size();
    Gaussian result{Numbers(n), Numbers(n * n)};
    for (std::size_t i = 0; i < n; i++) {
        result.mean[i] = of.mean[which[i]];
        for (std::size_t j = 0; j < n; j++) result.cov[i * n + j] = of.cov[which[i] * m + which[j]];
    }
    return result;
}

// The lower Cholesky factor of a covariance (n, n), in place.
void factor(Numbers& a, std::size_t n) {
    for (std::size_t j = 0; j < n; j++) {
        double variance = a[j * n + j], pivot = variance;
        for (std::size_t k = 0; k < j; k++) pivot -= a[j * n + k] * a[j * n + k];
        a[j * n + j] = std::sqrt(std::max(pivot, 1e-15 * variance));  // above rounding
        std::size_t i = j + 1;
        for (; i + 4 <= n; i += 4) {  // independent rows
            double *of = a.data() + i * n, rest[4] = {of[j], of[n + j], of[2 * n + j], of[3 * n + j]};
            for (std::size_t k = 0; k < j; k++)
                for (std::size_t row = 0; row < 4; row++) rest[row] -= of[row * n + k] * a[j * n + k];
            for (std::size_t row = 0; row < 4; row++) of[row * n + j] = rest[row] / a[j * n + j];
        }
        for (; i < n; i++) {
            for (std::size_t k = 0; k < j; k++) a[i * n + j] -= a[i * n + k] * a[j * n + k];
            a[i * n + j] /= a[j * n + j];
        }
    }
}

// C⁻¹ and C⁻¹ m of a Gaussian.
Gaussian information_of(Gaussian of) {
    std::size_t n = of.size();
    factor(of.cov, n);
    Gaussian result{Numbers(n), Numbers(n * n)};
    Numbers inverse(n * n);  // its rows: columns of L⁻¹, which begin on the diagonal
    for (std::size_t i = 0; i < n; i++) {
        double* row = inverse.data() + i * n;
        for (std::size_t k = i; k < n; k++)
            row[k] = ((k == i ? 1.0 : 0.0) - std::inner_product(row + i, row + k, of.cov.data() + k * n + i, 0.0)) / of.cov[k * n + k];
    }
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t j = 0; j <= i; j++)
            result.cov[i * n + j] = result.cov[j * n + i] =
                std::inner_product(inverse.data() + i * n + i, inverse.data() + i * n + n, inverse.data() + j * n + i, 0.0);
    for (std::size_t i = 0; i < n; i++)
        result.mean[i] = std::inner_product(of.mean.begin(), of.mean.end(), result.cov.data() + i * n, 0.0);
    return result;
}

// The conditional Gaussian of the rows `kept`, given that those of `zero` are 0.
Gaussian without(const Gaussian& of, const Which& zero, const Which& kept) {
    std::size_t m = of.size(), n = zero.size(), others = kept.size();
    Gaussian given = part(of, zero), result = part(of, kept);
    factor(given.cov, n);
    substitute(given.cov.data(), given.mean.data(), n);
    Numbers half(others * n);  // rows: L⁻¹ of the covariances with one of the others
    for (std::size_t i = 0; i < others; i++) {
        double* row = half.data() + i * n;
        for (std::size_t k = 0; k < n; k++) row[k] = of.cov[kept[i] * m + zero[k]];
        substitute(given.cov.data(), row, n);
        result.mean[i] -= std::inner_product(row, row + n, given.mean.data(), 0.0);
        for (std::size_t j = 0; j <= i; j++) {
            result.cov[i * others + j] -= std::inner_product(row, row + n, half.data() + j * n, 0.0);
            result.cov[j * others + i] = result.cov[i * others + j];
        }
    }
    return result;
}

// The log odds that an error is N(0, variance) rather than 0.
double log_evidence(double information, double weighted, double variance = 1) {
    double ratio = variance * information;
    return 0.5 * (variance * weighted * weighted / (1 + ratio) - std::log1p(ratio));
}

// The log odds that errors are N(0, 1) each rather than all 0, from C⁻¹ and C⁻¹ m with the sizes so far; only a share
// of the views' information counts.
double log_odds_wrong(Gaussian information, const Numbers& size, double counts) {
    std::size_t n = information.size();
    for (std::size_t i = 0; i < n; i++) information.cov[i * n + i] -= 1 / (size[i] * size[i]);
    double sum = 0;
    Numbers lower = information.cov, solved = information.mean;
    if (solve_positive(lower.data(), solved.data(), n)) {  // the information of views is not negative along any axis
        for (std::size_t i = 0; i < n * n; i++) lower[i] = counts * information.cov[i] + (i % (n + 1) == 0 ? 1.0 : 0.0);
        solved = information.mean;
        solve_positive(lower.data(), solved.data(), n);
        for (std::size_t i = 0; i < n; i++)
            sum += 0.5 * counts * counts * information.mean[i] * solved[i] - std::log(lower[i * n + i]);
        return sum;
    }
    Numbers axes(n * n), along(n);
    diagonalise(information.cov.data(), axes.data(), n);
    for (std::size_t i = 0; i < n; i++) add(information.mean[i], axes.data() + i * n, n, along.data());
    for (std::size_t i = 0; i < n; i++)
        sum += log_evidence(counts * std::max(information.cov[i * n + i], 0.0), counts * along[i]);
    return sum;
}

Numbers at(const Numbers& values, const Which& which) {
    Numbers result;
    for (std::size_t i : which) result.push_back(values[i]);
    return result;
}

// The log odds that lenses have errors rather than none, given the other terms: in all terms, or in any single one.
double log_odds_given(const Gaussian& lenses, const Numbers& size, double counts, double share_alone) {
    std::size_t n = lenses.size();
    Gaussian information = information_of(lenses);
    Numbers alone;
    for (std::size_t i = 0; i < n; i++) {
        double by_views = std::max(information.cov[i * n + i] - 1 / (size[i] * size[i]), 0.0);
        alone.push_back(log_evidence(counts * by_views, counts * information.mean[i]));
    }
    double together = log_odds_wrong(information, size, counts), largest = together, sum = 0;
    for (double one : alone) largest = std::max(largest, one);
    for (double one : alone) sum += std::exp(one - largest);
    return largest + std::log((1 - share_alone) * std::exp(together - largest) + share_alone * sum / static_cast<double>(n));
}

// Which of the considered terms are 0 in each combination.
std::vector<Which> zeros_of(View<bool, 2> is_zero) {
    std::vector<Which> result(is_zero.shape[0]);
    for (std::size_t i = 0; i < result.size(); i++)
        for (std::size_t k = 0; k < is_zero.shape[1]; k++)
            if (is_zero[i][k]) result[i].push_back(k);
    return result;
}

// log Σ exp of some numbers.
double log_sum(const Numbers& of) {
    double largest = *std::max_element(of.begin(), of.end()), sum = 0;
    for (double one : of) sum += std::exp(one - largest);
    return largest + std::log(sum);
}

// The log odds that lenses have errors rather than none, eq. (72m): those given each combination of zero terms,
// weighted by the probability `own` of the combination if lenses have no errors.
double log_odds_lenses(const Gaussian& all, const Gaussian& own, const Numbers& sizes, const Which& of_lenses,
                       const std::vector<Which>& zeros, const double* log_prior, double counts, double counts_of_lenses,
                       double share_alone) {
    std::size_t lenses = of_lenses.size();
    Numbers size_of_lenses = at(sizes, of_lenses), size(sizes.begin() + static_cast<std::ptrdiff_t>(lenses), sizes.end());
    Numbers none, wrong;
    for (std::size_t i = 0; i < zeros.size(); i++) {
        none.push_back(log_prior[i] - log_odds_wrong(information_of(part(own, zeros[i])), at(size, zeros[i]), counts));
        Which zero = zeros[i];
        for (std::size_t& k : zero) k += lenses;
        wrong.push_back(none[i] + log_odds_given(without(all, zero, of_lenses), size_of_lenses, counts_of_lenses, share_alone));
    }
    return log_sum(wrong) - log_sum(none);
}

// C⁻¹ m of the `considered` terms, averaged over the combinations by their probability: the density at zero of these
// terms.
Numbers averaged(const Gaussian& considered, const Numbers& size, const std::vector<Which>& zeros,
                 const double* log_prior, double counts) {
    std::size_t n = considered.size(), number = zeros.size();
    Numbers log_p(number), weighted(number * n), result(n);
    for (std::size_t i = 0; i < number; i++) {
        Gaussian information = information_of(part(considered, zeros[i]));
        for (std::size_t k = 0; k < zeros[i].size(); k++) weighted[i * n + zeros[i][k]] = information.mean[k];
        log_p[i] = log_prior[i] - log_odds_wrong(std::move(information), at(size, zeros[i]), counts);
    }
    double all = log_sum(log_p);
    for (std::size_t i = 0; i < number; i++)
        for (std::size_t k = 0; k < n; k++) result[k] += std::exp(log_p[i] - all) * weighted[i * n + k];
    return result;
}

// Errors with the considered terms, the first of which is `first`, at their probable values; they count in full.
void consider(Gaussian& of, std::size_t first, const Numbers& weighted) {
    std::size_t m = of.size();
    Numbers away(m);
    for (std::size_t i = 0; i < m; i++)
        for (std::size_t k = 0; k < weighted.size(); k++) away[i] += of.cov[i * m + first + k] * weighted[k];
    for (std::size_t i = 0; i < m; i++) {
        of.mean[i] -= away[i];
        for (std::size_t j = 0; j < m; j++) of.cov[i * m + j] += away[i] * away[j];
    }
}

}  // namespace

Array<double, 2> log_evidence(Vector information, Vector weighted, Vector variances) {
    std::size_t n = information.shape[0], sizes = variances.shape[0];
    require_shape(weighted, {n}, "weighted");
    Array<double, 2> result(sizes, n);
    for (std::size_t s = 0; s < sizes; s++)
        for (std::size_t i = 0; i < n; i++)
            result[s][i] = log_evidence(information.data[i], weighted.data[i], variances.data[s]);
    return result;
}

Mixture rig_mixture(Vector mean, Matrix cov, Vector size, std::size_t lenses, View<bool, 2> is_zero, Vector log_prior,
                    double counts, double counts_of_lenses, double share_alone, bool known_wrong) {
    std::size_t m = mean.shape[0], terms = lenses + is_zero.shape[1];
    require_shape(cov, {m, m}, "cov");
    require_shape(size, {m}, "size");
    require_shape(log_prior, {is_zero.shape[0]}, "log_prior");
    require(lenses > 0 && terms <= m && is_zero.shape[0] > 0, "there are fewer errors than terms");
    Which of_lenses(lenses), considered(terms - lenses), others(m - lenses);
    std::iota(of_lenses.begin(), of_lenses.end(), 0);
    std::iota(considered.begin(), considered.end(), lenses);
    std::iota(others.begin(), others.end(), lenses);  // the considered terms, then the field
    Numbers sizes(size.data, size.data + m), of_considered = at(sizes, considered);
    auto zeros = zeros_of(is_zero);
    Gaussian all{Numbers(mean.data, mean.data + m), Numbers(cov.data, cov.data + m * m)}, wrong = all;
    Gaussian right = without(all, of_lenses, others);
    Which first(considered.size());
    std::iota(first.begin(), first.end(), 0);
    Gaussian own = part(right, first);
    double log_odds =
        log_odds_lenses(all, own, sizes, of_lenses, zeros, log_prior.data, counts, counts_of_lenses, share_alone);
    require_definite(std::isfinite(log_odds), "the errors of the rig are not determined");
    double p = 1 / (1 + std::exp(-log_odds));
    Mixture result{{m}, {m, m}, known_wrong ? 1.0 : p};
    consider(wrong, lenses, averaged(part(all, considered), of_considered, zeros, log_prior.data, counts));
    consider(right, 0, averaged(own, of_considered, zeros, log_prior.data, counts));
    p = result.p_wrong;
    for (std::size_t i = 0; i < m; i++) {
        double mean_i = i < lenses ? 0.0 : right.mean[i - lenses];
        result.mean.data[i] = p * wrong.mean[i] + (1 - p) * mean_i;
        for (std::size_t j = 0; j < m; j++) {
            bool free = i >= lenses && j >= lenses;
            double mean_j = j < lenses ? 0.0 : right.mean[j - lenses];
            double apart = (wrong.mean[i] - mean_i) * (wrong.mean[j] - mean_j);
            double cov = free ? right.cov[(i - lenses) * others.size() + j - lenses] : 0.0;
            result.cov[i][j] = p * wrong.cov[i * m + j] + (1 - p) * cov + p * (1 - p) * apart;
        }
    }
    return result;
}

}  // namespace core
