// One step of a window: its normal equations without the points, factored, and all variables moved, eqs. (26) to (30).

#include "poses.hpp"
#include "products.hpp"
#include "window.hpp"

namespace core {
namespace {

constexpr std::size_t POSE = 6, STATE = 17;  // of the world, and of the inertial state, among the rows of its modes

// Adds information about poses and inertial state, eq. (82), to that about poses and modes of the prior.
void add_inertial(Matrix about, Vector weighted, const PriorViews& prior, std::size_t poses, std::size_t modes, WithoutPoints& system) {
    std::size_t size = about.shape[0];
    if (size == 0) return;
    require_shape(about, {poses + STATE, poses + STATE}, "about_state");
    require_shape(weighted, {size}, "weighted_state");
    require_shape(prior.world_modes, {POSE + STATE, prior.modes.shape[2]}, "world_modes");
    for (std::size_t x = 0; x < poses; x++) {
        add(1.0, about[x], poses, system.h[x]);
        system.g.data[x] += weighted.data[x];
    }
    std::vector<double> by_both(size);
    for (std::size_t x = modes; x < system.g.size(); x++) {
        double* row = system.h[x];
        std::fill(by_both.begin(), by_both.end(), 0.0);
        for (std::size_t r = 0; r < STATE; r++) {
            double of = prior.world_modes[POSE + r][x - modes];
            if (of == 0) continue;  // most modes do not touch the state
            add(of, about[poses + r], size, by_both.data());
            system.g.data[x] += of * weighted.data[poses + r];
        }
        add(1.0, by_both.data(), poses, row);
        for (std::size_t r = 0; r < STATE; r++) add(by_both[poses + r], prior.world_modes[POSE + r], x - modes + 1, row + modes);
    }
}

// R Rᵀ of a matrix (n, n) of positive diagonal.
Array<double, 2> inverse_of(Rows matrix, std::size_t n) {
    Array<double, 2> root = inverse_root_of(matrix, n, true), result(n, n);
    Rows rows{root.data.get(), n};
    add_large_product(1.0, along(rows), n, along(rows), n, n, Needed::ALL, result.data.get(), n);
    return result;
}

// The variables moved by a step: poses by Exp(ξ) on the left, points as these roots and couplings follow, from their own
// steps `given` (P, 3).
MovedWindow moved(const WindowState& state, Vector amplitudes, Array<double, 1>&& step, Matrices std_given, Matrices reach, double* given) {
    std::size_t frames = state.cams_from_ref.shape[0], points = state.q.shape[0], k = amplitudes.shape[0], size = reach.shape[2];
    std::size_t own = frames * state.own.shape[1];
    Array<double, 3> poses = pose_exp({step.data.get(), {frames, 6}});
    for (std::size_t f = 0; f < frames; f++) {
        double by[16];
        std::copy_n(poses[f], 16, by);
        multiply<4, 4, 4>(by, state.cams_from_ref[f], poses[f]);
    }
    MovedWindow result{orthonormalise(poses), {frames, state.own.shape[1]}, {points, 3}, {k}, std::move(step)};
    const double* by = result.step.data.get();
    std::transform(state.own.data, state.own.data + own, by + 6 * frames, result.own.data.get(), std::plus<>());
    std::transform(amplitudes.data, amplitudes.data + k, by + 6 * frames + own, result.amplitudes.data.get(), std::plus<>());
    for (std::size_t i = 0; i < points; i++, given += 3)
        for (std::size_t x = 0; x < 3; x++) given[x] -= sum_of_products(reach[i] + x * size, by, size);
    given -= 3 * points;
    for (std::size_t i = 0; i < 3 * points; i++)
        result.q.data[i] = state.q.data[i] + std::inner_product(given + i / 3 * 3, given + i / 3 * 3 + 3, std_given.data + 3 * i, 0.0);
    return result;
}

}  // namespace

// The last m variables are errors of the rig, eq. (72).
WIDER FactoredWindow factored(WithoutPoints& system, std::size_t m) {
    std::size_t size = system.g.size(), n = size - m;
    const double *h = system.h.data.get(), *g = system.g.data.get();
    Array<double, 2> of_others = inverse_root_of({h, size}, n, true);
    FactoredWindow result{{std::move(of_others), {n, m}, std::move(system.std_given), std::move(system.reach), {m}, {0, 0}, {m, m}}, {n}, {m}};
    Rows root{result.solved.root.data.get(), n};
    std::vector<double> coupling(m * n), whitened(n);
    Rows coupled{coupling.data(), n};
    add_large_product(1.0, along({h + n * size, size}), m, down(root), n, n, Needed::ALL, coupling.data(), n);
    add_large_product(-1.0, along(root), n, along(coupled), m, n, Needed::ALL, result.solved.by_rig.data.get(), m);
    Array<double, 2>& left = result.solved.information_of_rig;
    for (std::size_t x = 0; x < m; x++) std::copy_n(h + (n + x) * size + n, x + 1, left[x]);
    add_large_product(-1.0, along(coupled), m, along(coupled), m, n, Needed::LOWER, left.data.get(), m);
    for (std::size_t x = 0; x < m; x++)
        for (std::size_t y = 0; y < x; y++) left[y][x] = left[x][y];
    for (std::size_t x = 0; x < n; x++) add(g[x], root.data + x * n, n, whitened.data());
    for (std::size_t x = 0; x < n; x++) result.alone.data[x] = sum_of_products(root.data + x * n, whitened.data(), n);
    for (std::size_t x = 0; x < m; x++) result.pull_of_rig.data[x] = g[n + x] - sum_of_products(coupling.data() + x * n, whitened.data(), n);
    return result;
}

WIDER WindowStep window_step(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, const PriorViews& prior,
                             Vector amplitudes, bool with_rig, Matrix about_state, Vector weighted_state) {
    NormalBlocks blocks = normal_blocks(pinholes, state, views, with_rig);
    std::size_t frames = state.cams_from_ref.shape[0], of_rig = state.rig_error.shape[0], m = with_rig ? of_rig : 0;
    std::size_t modes = blocks.u.shape[1] * frames;
    require_shape(state.own, {frames, blocks.u.shape[1] - 6}, "own amplitudes");
    require_shape(prior.rig.held, {of_rig}, "held");
    WithoutPoints system = without_points(views_of(blocks), prior, state.ids, state.q, amplitudes, 6);
    add_inertial(about_state, weighted_state, prior, 6 * frames, modes, system);
    std::size_t size = system.g.size(), n = size - m;
    FactoredWindow found = factored(system, m);
    SolvedWindow& solved = found.solved;
    solved.cov_of_rig = inverse_of({solved.information_of_rig.data.get(), m}, m);
    for (std::size_t x = 0; x < m; x++)
        solved.mean_of_rig.data[x] = state.rig_error.data[x] + sum_of_products(solved.cov_of_rig[x], found.pull_of_rig.data.get(), m);
    Array<double, 1> step(modes + amplitudes.shape[0]);
    std::copy_n(found.alone.data.get(), n, step.data.get());
    for (std::size_t x = 0; x < m; x++) step.data[n + x] = prior.rig.held.data[x] - state.rig_error.data[x];
    for (std::size_t x = 0; x < n; x++) step.data[x] += sum_of_products(solved.by_rig[x], step.data.get() + n, m);
    double* given = system.given.data.get();
    double decrease = sum_of_products(given, given, system.given.size()) + sum_of_products(system.g.data.get(), step.data.get(), size);
    MovedWindow after = moved(state, amplitudes, std::move(step), solved.std_given, solved.reach, given);
    return {std::move(solved), std::move(after), decrease};
}

WIDER MovedWindow window_with_rig_moved(const WindowState& state, Vector amplitudes, const SolvedViews& solved, Vector change) {
    std::size_t n = solved.root.shape[0], m = change.shape[0], frames = state.cams_from_ref.shape[0], points = state.q.shape[0];
    require_shape(solved.by_rig, {n, m}, "by_rig");
    require_shape(solved.std_given, {points, 3, 3}, "std_given");
    require_shape(solved.reach, {points, 3, n + m}, "reach");
    require_shape(state.cams_from_ref, {frames, 4, 4}, "cams_from_ref");
    require_shape(state.q, {points, 3}, "q");
    require_shape(state.own, {frames, state.own.shape[1]}, "own amplitudes");
    require((6 + state.own.shape[1]) * frames + amplitudes.shape[0] == n + m, "the step is of other variables");
    Array<double, 1> step(n + m);
    for (std::size_t x = 0; x < n; x++) step.data[x] = sum_of_products(solved.by_rig[x], change.data, m);
    std::copy_n(change.data, m, step.data.get() + n);
    std::vector<double> given(3 * points);
    return moved(state, amplitudes, std::move(step), solved.std_given, solved.reach, given.data());
}

}  // namespace core
