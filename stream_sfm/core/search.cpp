// The global search of the resection: the motion that most of the weight agrees with, whatever the start.
//
// Motions are fitted to many small random samples of views, each from two starts. All views score each of them at their own
// noise, with truncated costs, so that an outlier counts the same however far off it is. The best ones are refined by all
// views near them.

#include <random>

#include "resection.hpp"
#include "poses.hpp"

namespace core {
namespace {

// Views of a sample. Two stereo views determine a motion; a third one avoids the amplification of their noise. Three views
// of one side have up to four solutions.
enum : std::size_t { STEREO_SAMPLE = 3, ONE_SIDED_SAMPLE = 4 };

using Motion = std::array<double, 16>;
struct Scored {
    Motion motion;
    double support;
};

// The area over which `agreement` (n,) spreads, at least `least`; 1 if it is uniform over the image.
double extent(const Pinholes& p, Matrix z, const std::vector<double>& agreement, double least) {
    double m = 0, mu = 0, mv = 0, uu = 0, uv = 0, vv = 0;
    for (std::size_t i = 0; i < z.shape[0]; i++) {
        double a = agreement[i], u = (z[i][0] - p.cx_left_px) / p.width, v = (z[i][1] - p.cy_px) / p.height;
        m += a, mu += a * u, mv += a * v, uu += a * u * u, uv += a * u * v, vv += a * v * v;
    }
    m = std::max(m, 1e-12);
    mu /= m, mv /= m, uu /= m, uv /= m, vv /= m;
    double determinant = (uu - mu * mu) * (vv - mv * mv) - (uv - mu * mv) * (uv - mu * mv);
    return std::max(12 * std::sqrt(std::max(determinant, 0.0)), least);  // a uniform square has variances of 1/12
}

// The support of a motion by squared residuals (n,): each view adds its weight, reduced by the share of the gate that its
// residual uses up. A larger extent of the agreeing views in the image adds a little, because a background surrounds the
// bodies in front of it, and a body is compact.
double support(const PointViews& views, const double* weights, const double* squares, const ResectionRules& rules) {
    std::size_t n = views.points.shape[0];
    std::vector<double> agreement(n);
    double total = 0;
    for (std::size_t i = 0; i < n; i++) total += agreement[i] = weights[i] * (1 - std::min(squares[i] / views.gate.data[i], 1.0));
    return total * std::pow(extent(views.projection, views.z_px, agreement, rules.min_extent), rules.extent_power);
}

// `samples` sets of `size` different rows of n, drawn by weight (Efraimidis and Spirakis 2006). Random numbers depend on n only.
std::vector<std::size_t> drawn(const double* weights, std::size_t n, std::size_t size, std::size_t samples) {
    std::mt19937_64 random(n);
    std::vector<double> keys(n);
    std::vector<std::size_t> order(n), rows;
    for (std::size_t s = 0; s < samples; s++) {
        for (std::size_t i = 0; i < n; i++) {
            double uniform = (static_cast<double>(random() >> 11) + 0.5) * 0x1p-53;
            keys[i] = -std::log(uniform) / std::max(1e-9, weights[i]);
        }
        std::iota(order.begin(), order.end(), std::size_t{0});
        auto end = order.begin() + static_cast<std::ptrdiff_t>(size);
        std::partial_sort(order.begin(), end, order.end(), [&](std::size_t a, std::size_t b) { return keys[a] < keys[b]; });
        rows.insert(rows.end(), order.begin(), end);
    }
    return rows;
}

class Search {
   public:
    Search(const PointViews& views, Matrix start)
        : views(views), linear(linearise_views(views, start)), amplitudes(views.shared.shape[2]) {}

    // The rotation that best turns points towards the rays of their left views (Davenport's q-method).
    Motion by_rays(const std::size_t* rows, std::size_t k) const {
        const auto& [p, points, cov_points, z, cov, shared, gate] = views;
        double b[9] = {};
        for (const std::size_t* row = rows; row < rows + k; row++) {
            const double* at = points[*row];
            double ray[3] = {(z[*row][0] - p.cx_left_px) / p.f_px, (z[*row][1] - p.cy_px) / p.f_px, 1.0}, lengths = 0;
            lengths = std::sqrt((at[0] * at[0] + at[1] * at[1] + at[2] * at[2]) * (ray[0] * ray[0] + ray[1] * ray[1] + 1));
            for (int i = 0; i < 9; i++) b[i] += ray[i / 3] * at[i % 3] / lengths;
        }
        double trace = b[0] + b[4] + b[8], axes[16];
        double q[16] = {2 * b[0] - trace, b[1] + b[3],      b[2] + b[6],      b[7] - b[5],  //
                        b[1] + b[3],      2 * b[4] - trace, b[5] + b[7],      b[2] - b[6],  //
                        b[2] + b[6],      b[5] + b[7],      2 * b[8] - trace, b[3] - b[1],  //
                        b[7] - b[5],      b[2] - b[6],      b[3] - b[1],      trace};
        diagonalise(q, axes, 4);
        int most = 0;
        for (int i = 1; i < 4; i++)
            if (q[5 * i] > q[5 * most]) most = i;
        double x = axes[most], y = axes[4 + most], v = axes[8 + most], w = axes[12 + most];
        return {1 - 2 * (y * y + v * v), 2 * (x * y - v * w),     2 * (x * v + y * w),     0,
                2 * (x * y + v * w),     1 - 2 * (x * x + v * v), 2 * (y * v - x * w),     0,
                2 * (x * v - y * w),     2 * (y * v + x * w),     1 - 2 * (x * x + y * y), 0,
                0,                       0,                       0,                       1};
    }

    // Gauss-Newton over k views `rows` with `weights` (k,).
    void fit(Motion& motion, const std::size_t* rows, const double* weights, std::size_t k, int steps) const {
        for (int step = 0; step < steps; step++) {
            std::vector<double> h(36);
            double delta[6] = {};
            for (std::size_t i = 0; i < k; i++)
                if (weights[i] != 0) add(motion, rows[i], weights[i], h.data(), delta);
            for (int a = 0; a < 6; a++)
                for (int b = a + 1; b < 6; b++) h[6 * b + a] = h[6 * a + b];
            solve_damped(h, delta, 6);
            if (!std::isfinite(delta[0])) return;
            double angle = std::sqrt(delta[3] * delta[3] + delta[4] * delta[4] + delta[5] * delta[5]);
            for (double& d : delta) d *= std::min(1.0, MAX_ROTATION_STEP_RAD / std::max(angle, 1e-12));
            Array<double, 3> by = pose_exp({delta, {1, 6}});
            Motion before = motion;
            multiply<4, 4, 4>(by[0], before.data(), motion.data());
        }
    }

    // Squared residuals (n,) under a motion.
    std::vector<double> squares(const Motion& motion) const {
        ViewResiduals seen = view_residuals(views, linear.root, amplitudes, {motion.data(), {1, 4, 4}});
        return {seen.squares[0], seen.squares[0] + views.points.shape[0]};
    }

   private:
    // Adds one view to the upper triangle of the information (6, 6), and to the gradient (6,).
    void add(const Motion& motion, std::size_t row, double weight, double* h, double* g) const {
        const double* root = linear.root.data.get() + 16 * row;
        double p[4], a[16], by_cam[16], expected[4], j[6];
        move(motion.data(), views.points[row], p);
        clamp_depth(p);
        jacobian(views.projection, p, a);
        project(views.projection, p, expected);
        multiply<4, 4, 4>(root, a, by_cam);
        for (int c = 0; c < 4; c++) {
            double residual = 0, z;
            for (int k = 0; k < 4; k++) residual += root[4 * c + k] * ((std::isfinite(z = views.z_px[row][k]) ? z : 0.0) - expected[k]);
            by_motion(by_cam + 4 * c, p, j);
            for (int b = 0; b < 6; b++) {
                g[b] += weight * j[b] * residual;
                for (int d = b; d < 6; d++) h[6 * b + d] += weight * j[b] * j[d];
            }
        }
    }

    const PointViews& views;
    LinearisedViews linear;
    Array<double, 1> amplitudes;  // of shared errors: none
};

double choose(std::size_t n, std::size_t k) {
    double result = 1;
    for (std::size_t i = 0; i < k; i++) result *= static_cast<double>(n - i) / static_cast<double>(i + 1);
    return result;
}

}  // namespace

Array<double, 2> search_motion(const PointViews& views, Matrix start, Vector weights, const ResectionRules& rules,
                               std::size_t agreeing) {
    std::size_t n = views.points.shape[0], stereo = 0;
    require_shape(weights, {n}, "weights");
    require_shape(start, {4, 4}, "cam_from_ref");
    Search search(views, start);
    for (std::size_t i = 0; i < n; i++) stereo += std::isfinite(views.z_px[i][2]) && std::isfinite(views.z_px[i][3]);
    std::size_t size = 2 * stereo > n ? STEREO_SAMPLE : ONE_SIDED_SAMPLE;
    require(n > size && (agreeing == 0 || agreeing >= size), "there are too few views");
    double samples = static_cast<double>(rules.samples), clean = static_cast<double>(rules.clean_samples);
    if (agreeing) samples = std::min(samples, std::ceil(clean * choose(n, size) / choose(agreeing, size)));
    std::vector<std::size_t> rows = drawn(weights.data, n, size, static_cast<std::size_t>(samples)), all(n);
    std::iota(all.begin(), all.end(), std::size_t{0});
    std::vector<double> ones(size, 1.0), near(n);
    std::vector<Scored> found;
    auto score = [&](Scored& of) {
        double value = support(views, weights.data, search.squares(of.motion).data(), rules);
        of.support = std::isfinite(value) ? value : -1.0;
    };
    Motion given;
    std::copy(start.data, start.data + 16, given.begin());
    for (std::size_t s = 0; s < rows.size(); s += size)
        for (const Motion& beginning : {given, search.by_rays(&rows[s], size)}) {
            found.push_back({beginning, 0.0});
            search.fit(found.back().motion, &rows[s], ones.data(), size, rules.sample_steps);
            score(found.back());
        }
    auto better = [](const Scored& a, const Scored& b) { return a.support > b.support; };
    std::stable_sort(found.begin(), found.end(), better);
    found.resize(std::min(found.size(), rules.refined));
    for (double refining : {rules.first_refining_gates, rules.refining_gates})
        for (Scored& of : found) {
            std::vector<double> squares = search.squares(of.motion);
            for (std::size_t i = 0; i < n; i++)
                near[i] = squares[i] < refining * views.gate.data[i]
                              ? weights.data[i] / (1 + squares[i] / (CAUCHY_WIDTH * CAUCHY_WIDTH)) : 0.0;
            search.fit(of.motion, all.data(), near.data(), n, rules.refining_steps);
        }
    for (Scored& of : found) score(of);
    Array<double, 2> result(4, 4);
    const Motion& best = std::min_element(found.begin(), found.end(), better)->motion;
    std::copy(best.begin(), best.end(), result.data.get());
    return result;
}

double motion_support(const PointViews& views, Matrix motion, Vector amplitudes, Vector weights, const ResectionRules& rules) {
    std::size_t n = views.points.shape[0];
    require_shape(weights, {n}, "weights");
    LinearisedViews linear = linearise_views(views, motion);
    ViewResiduals seen = view_residuals(views, linear.root, amplitudes, {motion.data, {1, 4, 4}});
    return support(views, weights.data, seen.squares[0], rules);
}

double evidence(const Pinholes& pinholes, Matrix z, Vector weights, const ResectionRules& rules) {
    std::size_t n = z.shape[0];
    require_shape(z, {n, 4}, "z_px");
    require_shape(weights, {n}, "weights");
    std::vector<double> votes(rules.places * rules.places);
    double sum = 0, side = static_cast<double>(rules.places);
    for (std::size_t i = 0; i < n; i++) {
        auto place = [&](double share) { return static_cast<std::size_t>(std::min(std::max(0.0, share * side), side - 1)); };
        double& vote = votes[rules.places * place(z[i][1] / pinholes.height) + place(z[i][0] / pinholes.width)];
        vote = std::max(vote, weights.data[i]);
    }
    for (double vote : votes) sum += vote;
    return sum * extent(pinholes, z, {weights.data, weights.data + n}, rules.min_extent);
}

}  // namespace core
