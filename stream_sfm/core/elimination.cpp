// Points eliminated from the normal equations of a window, and its right-hand sides.
//
// Given the poses and the modes of the prior, points are independent of each other, so each is eliminated separately,
// eqs. (27) and (30).

#include "products.hpp"
#include "window.hpp"

namespace core {
namespace {

// The lower root (3, 3) of the inverse of a point's information.
void root_of_inverse(const double* information, double* root) {
    double given[9];
    invert_positive<3>(information, given);
    require_definite(cholesky<3>(given, root), "the information about a point is not positive definite");
}

// out (3, n) = rootᵀ, an upper triangle, times rows (3, n); `stride` of out.
void reach_of(const double* root, const double* rows, std::size_t n, double* out, std::size_t stride) {
    const double *a = rows, *b = a + n, *c = b + n, xx = root[0], xy = root[3], xz = root[6], yy = root[4], yz = root[7], zz = root[8];
    double *x = out, *y = x + stride, *z = y + stride;
    for (std::size_t i = 0; i < n; i++) {
        x[i] = xx * a[i] + xy * b[i] + xz * c[i];
        y[i] = yy * b[i] + yz * c[i];
        z[i] = zz * c[i];
    }
}

// The rows in a map of the points of the prior.
std::vector<std::size_t> check(const BlockViews& blocks, const PriorViews& prior, Indices ids, Matrix q, Vector amplitudes,
                               std::size_t of_pose) {
    std::size_t frames = blocks.u.shape[0], points = blocks.v.shape[0], n = prior.ids.shape[0], m = blocks.rig.shape[0];
    std::size_t k = prior.modes.shape[2], by_frame = blocks.u.shape[1], of_rig = prior.rig.information.shape[0];
    require(by_frame >= of_pose, "a frame has fewer unknowns than its pose");
    require_shape(blocks.u, {frames, by_frame, by_frame}, "u");
    require_shape(blocks.v, {points, 3, 3}, "v");
    require_shape(blocks.w, {points, 3, by_frame * frames}, "w");
    require_shape(blocks.g_pose, {frames, by_frame}, "g_pose");
    require_shape(blocks.g_point, {points, 3}, "g_point");
    require_shape(blocks.rig, {m, m}, "rig");
    require_shape(blocks.rig_pose, {frames, by_frame, m}, "rig_pose");
    require_shape(blocks.rig_point, {points, 3, m}, "rig_point");
    require_shape(blocks.g_rig, {m}, "g_rig");
    require_shape(prior.mean, {n, 3}, "mean");
    require_shape(prior.cov, {n, 3, 3}, "cov");
    require_shape(prior.modes, {n, 3, k}, "modes");
    require_shape(prior.rig.information, {of_rig, of_rig}, "information");
    require_shape(prior.rig.weighted, {of_rig}, "weighted");
    require_shape(ids, {points}, "ids");
    require_shape(q, {points, 3}, "q");
    require_shape(amplitudes, {k}, "amplitudes");
    require(of_rig <= k, "there are fewer modes than errors of the rig");
    require(m == of_rig || m == 0, "the prior has other errors of the rig");
    std::vector<std::size_t> known(n);
    Lookup rows{ids};
    for (std::size_t i = 0; i < n; i++) {
        known[i] = rows.row(prior.ids.data[i]);
        require(known[i] != NONE, "the prior knows a point that is not of the window");
    }
    return known;
}

}  // namespace

EliminatedPoints eliminate_points(Matrices v, Matrices w) {
    std::size_t points = v.shape[0], size = w.shape[2];
    require_shape(v, {points, 3, 3}, "v");
    require_shape(w, {points, 3, size}, "w");
    EliminatedPoints result{{points, 3, 3}, {{points, 3, size}, Unset{}}};
    for (std::size_t i = 0; i < points; i++) {
        root_of_inverse(v[i], result.root[i]);
        reach_of(result.root[i], w[i], size, result.reach[i], size);
    }
    return result;
}

WIDER WithoutPoints without_points(const BlockViews& blocks, const PriorViews& prior, Indices ids, Matrix q, Vector amplitudes,
                                   std::size_t of_pose) {
    const std::vector<std::size_t> known = check(blocks, prior, ids, q, amplitudes, of_pose);
    std::size_t frames = blocks.u.shape[0], points = blocks.v.shape[0], m = blocks.rig.shape[0], n = known.size();
    std::size_t all = prior.modes.shape[2], of_rig = prior.rig.information.shape[0], k = all - of_rig + m;  // used modes come first
    std::size_t by_frame = blocks.u.shape[1], own = by_frame - of_pose;
    std::size_t poses = by_frame * frames, size = poses + k;  // all poses come first, then the amplitudes of each frame's own
    std::vector<std::size_t> column(poses);
    for (std::size_t i = 0; i < poses; i++) {
        std::size_t f = i / by_frame, x = i % by_frame;
        column[i] = x < of_pose ? of_pose * f + x : of_pose * frames + own * f + x - of_pose;
    }
    WithoutPoints result{{size, size}, {size}, {points, 3, 3}, {{points, 3, size}, Unset{}}, {points, 3}};
    double* g = result.g.data.get();
    for (std::size_t f = 0; f < frames; f++)
        for (std::size_t x = 0; x < by_frame; x++)
            for (std::size_t y = 0; y < by_frame; y++)
                result.h[column[by_frame * f + x]][column[by_frame * f + y]] = blocks.u[f][by_frame * x + y];
    for (std::size_t x = 0; x < m; x++) {  // the lower triangle
        double* row = result.h[size - m + x];
        for (std::size_t y = 0; y < poses; y++) row[column[y]] = blocks.rig_pose.data[y * m + x];
        std::copy(blocks.rig[x], blocks.rig[x] + m, row + size - m);
        add(1.0, prior.rig.information[x], m, row + size - m);
    }
    for (std::size_t y = 0; y < poses; y++) g[column[y]] = blocks.g_pose.data[y];
    std::copy(blocks.g_rig.data, blocks.g_rig.data + m, g + size - m);
    for (std::size_t y = 0; y < k - m; y++) {  // modes of σ = 1
        g[poses + y] -= amplitudes.data[y];
        result.h[poses + y][poses + y] += 1;
    }
    const double* off = amplitudes.data + all - of_rig;  // the rig's errors, relative to the prior's mean
    for (std::size_t x = 0; x < m; x++)
        g[size - m + x] += prior.rig.weighted.data[x] - std::inner_product(off, off + m, prior.rig.information[x], 0.0);

    std::vector<double> information(blocks.v.data, blocks.v.data + 9 * points), of_modes(3 * k), of_frames(3 * poses);
    std::vector<std::size_t> row_in_prior(points, n);
    Array<double, 2> right(points, 3);
    std::copy(blocks.g_point.data, blocks.g_point.data + 3 * points, right.data.get());
    std::vector<double> inverse_root(9 * n), whitened_modes(3 * n * k);  // L⁻¹ with L Lᵀ = D, and L⁻¹F
    for (std::size_t i = 0; i < n; i++) {
        double lower[9], *root = inverse_root.data() + 9 * i, away[3], whitened[3] = {}, *modes = whitened_modes.data() + 3 * i * k;
        std::size_t at = known[i];
        require_definite(cholesky<3>(prior.cov[i], lower), "the covariance of a point is not positive definite");
        invert_lower<3>(lower, root);
        for (std::size_t x = 0; x < 3; x++) away[x] = q[at][x] - prior.mean[i][x];
        for (std::size_t y = 0; y < all; y++)  // three independent sums, which the processor can overlap
            for (std::size_t x = 0; x < 3; x++) away[x] -= prior.modes[i][x * all + y] * amplitudes.data[y];
        for (std::size_t x = 0; x < 3; x++)
            for (std::size_t y = 0; y <= x; y++) {
                whitened[x] += root[3 * x + y] * away[y];
                add(root[3 * x + y], prior.modes[i] + y * all, k, modes + x * k);
            }
        for (std::size_t x = 0; x < 3; x++) add(whitened[x], modes + x * k, k, g + poses);
        for (std::size_t x = 0; x < 3; x++)
            for (std::size_t z = x; z < 3; z++) {
                right[at][x] -= root[3 * z + x] * whitened[z];
                for (std::size_t y = 0; y <= z; y++) information[9 * at + 3 * x + y] += root[3 * z + x] * root[3 * z + y];
            }
        row_in_prior[at] = i;
    }
    for (std::size_t at = 0; at < points; at++) {
        double* std_given = result.std_given[at];
        root_of_inverse(information.data() + 9 * at, std_given);
        std::fill(of_modes.begin(), of_modes.end(), 0.0);
        for (std::size_t x = 0; x < 3; x++) {
            double* out = of_modes.data() + x * k;
            if (std::size_t i = row_in_prior[at]; i < n)  // D⁻¹F
                for (std::size_t z = x; z < 3; z++) add(-inverse_root[9 * i + 3 * z + x], whitened_modes.data() + (3 * i + z) * k, k, out);
            add(1.0, blocks.rig_point[at] + x * m, m, out + k - m);
            for (std::size_t y = x; y < 3; y++) result.given[at][x] += std_given[3 * y + x] * right[at][y];
        }
        for (std::size_t x = 0; x < 3; x++)
            for (std::size_t y = 0; y < poses; y++) of_frames[x * poses + column[y]] = blocks.w[at][x * poses + y];
        reach_of(std_given, of_frames.data(), poses, result.reach[at], size);
        reach_of(std_given, of_modes.data(), k, result.reach[at] + poses, size);
    }
    Rows modes{whitened_modes.data(), k}, reach{result.reach.data.get(), size};
    add_large_product(1.0, down(modes), k, down(modes), k, 3 * n, Needed::LOWER, result.h.data.get() + poses * (size + 1), size);
    add_large_product(-1.0, down(reach), size, down(reach), size, 3 * points, Needed::LOWER, result.h.data.get(), size);
    for (std::size_t row = 0; row < 3 * points; row++) add(-result.given.data[row], reach.data + row * size, size, g);
    return result;
}

}  // namespace core
