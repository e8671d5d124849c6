// The duration of a track's errors, from its row differences, and the information that a further view adds, eqs. (68) and (69).

#include "tracks.hpp"

namespace core {
namespace {

// Row differences (n,) in standard deviations, at most `most`, less the frame's median; NaN without a right side.
Array<double, 1> whitened_rows(Matrix z, Matrices cov, double most) {
    std::size_t n = z.shape[0];
    Array<double, 1> rows(n);
    std::vector<double> seen;
    for (std::size_t i = 0; i < n; i++) {
        rows.data[i] = z[i][1] - z[i][3];
        if (std::isfinite(rows.data[i])) seen.push_back(rows.data[i]);
    }
    if (seen.empty()) return rows;
    double shared = median(seen);
    for (std::size_t i = 0; i < n; i++) {
        double whitened = (rows.data[i] - shared) / std::sqrt(cov[i][5] + cov[i][15] - 2 * cov[i][7]);
        rows.data[i] = std::isnan(whitened) ? whitened : std::clamp(whitened, -most, most);
    }
    return rows;
}

// Variances of white noise, in units of the white part, with the information that the n-th view adds. A Kalman filter
// estimates the lasting part, with variance p, eq. (69); b is the share of a constant that it mistakes for that part.
std::vector<double> inflation_by_age(double ratio, double decay, std::int64_t oldest) {
    std::vector<double> result;
    double p = ratio, b = 0;
    for (std::int64_t n = 0; n < oldest; n++) {
        double innovation = 1 + p, gain = p / innovation;
        result.push_back(innovation / ((1 - b) * (1 - b)));
        b = decay * (b + gain * (1 - b));
        p = decay * decay * (1 - gain) * p + (1 - decay * decay) * ratio;
    }
    return result;
}

void check(const LastingRules& rules) {
    require(rules.most_row_sigmas > 0, "most_row_sigmas is not above 0");
    require(rules.oldest_views >= 1 && rules.oldest_views <= 100'000, "oldest_views is not within 1 and 100 000");
}

}  // namespace

RowErrors row_errors_of_tracks(Indices known, Indices ages, Matrix rows, Indices ids, Matrix z, Matrices cov,
                               const LastingRules& rules) {
    std::size_t n = ids.shape[0], m = known.shape[0], kept = rows.shape[1];
    require_shape(ages, {m}, "ages");
    require_shape(rows, {m, kept}, "rows");
    check(rules);
    require(kept > 1, "rows must be of two frames or more");
    require_shape(z, {n, 4}, "z_px");
    require_shape(cov, {n, 4, 4}, "cov_px");
    RowErrors result{{n}, {n, kept}, {6}};
    Array<double, 1> now = whitened_rows(z, cov, rules.most_row_sigmas);
    double* sums = result.sums.data.get();
    for (std::size_t i = 0, j = 0; i < n; i++) {
        double* row = result.rows[i];
        std::fill_n(row, kept, std::numeric_limits<double>::quiet_NaN());
        row[0] = now.data[i];
        while (j < m && known.data[j] < ids.data[i]) j++;
        if (j == m || known.data[j] != ids.data[i]) continue;
        const double* before = rows[j];
        std::copy_n(before, kept - 1, row + 1);
        result.ages.data[i] = std::min(std::clamp<std::int64_t>(ages.data[j], 0, rules.oldest_views) + 1, rules.oldest_views - 1);
        double product = row[0] * before[0], later = row[0] * before[kept - 1];
        if (!std::isfinite(product)) continue;
        sums[0] += 0.5 * (row[0] * row[0] + before[0] * before[0]);
        sums[1] += product;
        sums[2] += 1;
        if (!std::isfinite(later)) continue;
        sums[3] += product;
        sums[4] += later;
        sums[5] += 1;
    }
    return result;
}

Array<double, 2> view_inflation(Indices ages, double ratio_left, double ratio_right, double decay, const LastingRules& rules) {
    check(rules);
    std::vector<double> left = inflation_by_age(ratio_left, decay, rules.oldest_views);
    std::vector<double> right = inflation_by_age(ratio_right, decay, rules.oldest_views);
    Array<double, 2> result(ages.shape[0], 2);
    for (std::size_t i = 0; i < ages.shape[0]; i++) {
        std::size_t age = static_cast<std::size_t>(std::clamp<std::int64_t>(ages.data[i], 0, rules.oldest_views - 1));
        result[i][0] = left[age];
        result[i][1] = right[age];
    }
    return result;
}

}  // namespace core
