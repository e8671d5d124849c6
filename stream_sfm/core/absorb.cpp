// The oldest frame leaves the window: its views become part of the prior, eqs. (31) to (35).
// Points of the prior that this frame or later ones see are part of the dense system. Points outside the prior that
// this frame and later ones see enter it by the views of this frame alone.

#include "poses.hpp"
#include "products.hpp"
#include "window.hpp"

namespace core {
namespace {

// Copies of some points of a window.
struct Part {
    Array<std::int64_t, 1> ids;
    Array<double, 3> anchors;
    Array<double, 2> q;

    Part(const WindowState& of, const std::vector<std::size_t>& rows)
        : ids(rows_of(of.ids, rows)), anchors(rows_of(of.ref_from_anchor, rows)), q(rows_of(of.q, rows)) {}
    WindowState in(const WindowState& all) const {
        return {all.cams_from_ref, ids, anchors, q, all.rig_error, all.own};
    }
};

// Points of the prior after a frame.
struct AbsorbedPoints {
    Array<std::int64_t, 1> ids;
    Array<double, 2> mean;
    Array<double, 3> cov, modes;
};

// What the views of a frame say: of points of the prior that this frame or later ones see, in these rows of the prior, and
// whether later ones do, with D after its drift; and of points that it sees in stereo and later ones see, alone.
struct LeavingViews {
    std::vector<std::size_t> rows;
    Array<bool, 1> stays;
    Array<double, 3> cov, anchors;
    Array<double, 2> q;
    NormalBlocks blocks;
    Array<std::int64_t, 1> fresh;
    PointsAlone alone;
};

LeavingViews leaving_views(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, Flags stereo,
                           Matrix var_drift, Flags seen_later, const PriorViews& prior) {
    std::size_t points = state.ids.shape[0], n = views.ids.shape[0], in_all = prior.ids.shape[0];
    require_shape(views.used, {n}, "used");
    require_shape(stereo, {n}, "stereo");
    require_shape(seen_later, {points}, "seen_later");
    require_shape(prior.cov, {in_all, 3, 3}, "cov");
    std::vector<char> in_prior(points);
    std::vector<std::size_t> known(in_all);
    Lookup of_points{state.ids};
    for (std::size_t i = 0; i < in_all; i++) {
        known[i] = of_points.row(prior.ids.data[i]);
        require(known[i] != NONE, "the prior knows a point that is not of the window");
        in_prior[known[i]] = 1;
    }
    Array<bool, 1> counts(n);
    Lookup of_map{state.ids};
    for (std::size_t i = 0; i < n; i++) {  // a point enters with a stereo view, as one side alone does not determine its depth
        std::size_t at = of_map.row(views.ids.data[i]);
        counts.data[i] = views.used.data[i] && (stereo.data[i] || (at != NONE && in_prior[at]));
    }
    Array<std::int64_t, 1> seen = times_among(state.ids, views.ids, counts);
    std::vector<std::size_t> rows, at_rows;
    for (std::size_t i = 0; i < in_all; i++) {
        std::size_t at = known[i];
        if (seen.data[at] || seen_later.data[at]) rows.push_back(i), at_rows.push_back(at);
    }
    std::vector<std::size_t> fresh =
        rows_where(points, [&](std::size_t at) { return seen.data[at] && seen_later.data[at] && !in_prior[at]; });
    WindowViews counted = views;
    counted.used = counts;
    Part absorbed(state, at_rows), begun(state, fresh);
    NormalBlocks own = normal_blocks(pinholes, begun.in(state), counted, true);
    Array<double, 3> drifted = rows_of(prior.cov, rows);
    Array<double, 3> drift = drift_covariances(absorbed.ids, absorbed.anchors, absorbed.q, views.ids, var_drift);
    add(1.0, drift.data.get(), 9 * rows.size(), drifted.data.get());
    Array<bool, 1> stays = rows_of(seen_later, at_rows);
    Array<double, 1> held(state.rig_error.shape[0]);  // errors of the rig do not move
    PointsAlone alone = points_alone(own.v, own.w, own.g_point, own.rig_point, begun.q, held);
    NormalBlocks blocks = normal_blocks(pinholes, absorbed.in(state), counted, true);
    return {rows, std::move(stays), std::move(drifted), std::move(absorbed.anchors), std::move(absorbed.q),
            std::move(blocks), std::move(begun.ids), std::move(alone)};
}

// The system of [own e | k + 6 modes] of one frame that is the new reference: six modes of its unknown pose come before those
// of the rig's errors, eqs. (31) to (35). Points q (n, 3), all in the prior, have anchors (n, 4, 4) in this frame.
WithoutPoints absorbing_system(const BlockViews& blocks, const PriorViews& prior, Matrices anchors, Matrix q,
                               Vector amplitudes) {
    std::size_t n = q.shape[0], k = prior.modes.shape[2], m = blocks.rig.shape[0];
    require_shape(prior.modes, {n, 3, k}, "modes");
    require_shape(amplitudes, {k}, "amplitudes");
    require(m <= k, "there are fewer modes than errors of the rig");
    std::size_t own = k - m;
    Array<double, 3> by_pose = q_by_reference(anchors, q), modes(n, 3, k + 6);
    Array<double, 1> at(k + 6);
    auto with_pose = [&](const double* before, const double* pose, double* out) {
        std::copy(before, before + own, out);
        std::copy(pose, pose + 6, out + own);
        std::copy(before + own, before + k, out + own + 6);
    };
    const double here[6] = {};
    with_pose(amplitudes.data, here, at.data.get());
    for (std::size_t row = 0; row < 3 * n; row++)
        with_pose(prior.modes.data + row * k, by_pose.data.get() + 6 * row, modes.data.get() + row * (k + 6));
    require(blocks.u.shape[0] == 1 && blocks.u.shape[1] >= 6, "one frame leaves");
    std::size_t by_frame = blocks.u.shape[1], e = by_frame - 6;
    Array<double, 3> u(1, e, e), w(n, 3, e), rig_pose(1, e, m);  // the pose is the reference, which is exact
    Array<double, 2> g(1, e);
    for (std::size_t x = 0; x < e; x++) {
        std::copy_n(blocks.u[0] + by_frame * (6 + x) + 6, e, u[0] + e * x);
        std::copy_n(blocks.rig_pose[0] + (6 + x) * m, m, rig_pose[0] + x * m);
        g[0][x] = blocks.g_pose[0][6 + x];
    }
    for (std::size_t row = 0; row < 3 * n; row++)
        std::copy_n(blocks.w.data + by_frame * row + 6, e, w.data.get() + e * row);
    BlockViews exact = blocks;
    exact.u = u, exact.w = w, exact.g_pose = g, exact.rig_pose = rig_pose;
    PriorViews with_modes = prior;
    with_modes.modes = modes;
    WithoutPoints result = without_points(exact, with_modes, prior.ids, q, at, 0);
    for (std::size_t x = e + own; x < e + own + 6; x++) result.h[x][x] -= 1;  // the new modes have no prior information
    return result;
}

// For the points that stay, linearised at q, roots of their covariances given the modes, and in units of these their steps
// `given` and the parts `moved` (n, 3, k + 1) that the new modes and their step subtract; and new points with their modes.
AbsorbedPoints absorbed_points(Indices ids, Matrices std_given, Matrices moved, Matrix given, Matrix q, Flags stays,
                               Indices ids_new, Matrix mean_new, Matrices cov_new, Matrices modes_new) {
    std::size_t n = ids.shape[0], more = ids_new.shape[0], k = moved.shape[2] - 1;
    std::size_t total = more + static_cast<std::size_t>(std::count(stays.data, stays.data + n, true)), at = 0, j = 0;
    AbsorbedPoints result{{total}, {total, 3}, {total, 3, 3}, {total, 3, k}};
    auto begin = [&] {
        result.ids.data[at] = ids_new.data[j];
        std::copy(mean_new[j], mean_new[j] + 3, result.mean[at]);
        std::copy(cov_new[j], cov_new[j] + 9, result.cov[at]);
        std::copy(modes_new[j], modes_new[j] + 3 * k, result.modes[at]);
        at++, j++;
    };
    for (std::size_t i = 0; i < n; i++) {
        if (!stays.data[i]) continue;
        while (j < more && ids_new.data[j] < ids.data[i]) begin();
        result.ids.data[at] = ids.data[i];
        for (std::size_t x = 0; x < 3; x++) {
            double sum = 0;
            for (std::size_t y = 0; y < 3; y++) {
                double root = std_given[i][3 * x + y];
                const double* of = moved[i] + y * (k + 1);
                sum += root * (given[i][y] - of[k]);
                add(-root, of, k, result.modes[at] + x * k);
                for (std::size_t z = 0; z < 3; z++) result.cov[at][3 * x + z] += root * std_given[i][3 * z + y];
            }
            result.mean[at][x] = q[i][x] + sum;
        }
        at++;
    }
    while (j < more) begin();
    return result;
}

// Rows (n, e + l) by eliminated variables and l others, as rows by the others (n, k), of which the last ones are these, and
// their step. `by_new` (…, k + 1): the eliminated variables.
Array<double, 2> carried(Rows rows, std::size_t n, std::size_t e, std::size_t l, const Array<double, 2>& by_new) {
    std::size_t k = by_new.shape[1] - 1;
    Array<double, 2> result(n, k + 1);
    add_large_product(1.0, along(rows), n, down({by_new.data.get(), k + 1}), k + 1, e, Needed::ALL, result.data.get(), k + 1);
    for (std::size_t i = 0; i < n; i++) add(1.0, rows.data + i * rows.stride + e, l, result[i] + k - l);
    return result;
}

// Adds `more` variables before the last m ones, and information about all of them.
void widen(WithoutPoints& system, std::size_t more, std::size_t m, Matrix about, Vector weighted) {
    std::size_t before = system.g.size(), size = before + more;
    if (about.shape[0] == 0) return;
    require_shape(about, {size, size}, "about");
    require_shape(weighted, {size}, "weighted");
    auto at = [&](std::size_t i) { return i + m < before ? i : i + more; };
    Array<double, 2> h(size, size);
    Array<double, 1> g(size);
    std::copy_n(about.data, size * size, h.data.get());
    std::copy_n(weighted.data, size, g.data.get());
    for (std::size_t i = 0; i < before; i++) {
        g.data[at(i)] += system.g.data[i];
        for (std::size_t c = 0; c <= i; c++) h[at(i)][at(c)] += system.h[i][c];
    }
    system.h = std::move(h), system.g = std::move(g);
}

}  // namespace

PointsAlone points_alone(Matrices v, Matrices w, Matrix g_point, Matrices rig_point, Matrix q, Vector rig_step) {
    std::size_t n = q.shape[0], m = rig_step.shape[0];
    require_shape(v, {n, 3, 3}, "v");
    require_shape(g_point, {n, 3}, "g_point");
    require_shape(rig_point, {n, 3, m}, "rig_point");
    require_shape(q, {n, 3}, "q");
    std::size_t by_frame = w.shape[2];
    require(by_frame >= 6, "a frame has fewer unknowns than its pose");
    require_shape(w, {n, 3, by_frame}, "w");
    std::size_t e = by_frame - 6;
    PointsAlone result{{n, 3}, {n, 3, 3}, {n, 3, e}, {n, 3, m}};
    for (std::size_t i = 0; i < n; i++) {
        double* cov = result.cov[i];
        invert_positive<3>(v[i], cov);
        require_definite(!std::isnan(cov[0]), "the views of a point do not determine it");
        for (std::size_t x = 0; x < 3; x++) {
            double *by_rig = result.by_rig[i] + x * m, moved = q[i][x];
            for (std::size_t y = 0; y < 3; y++) {
                moved += cov[3 * x + y] * g_point[i][y];
                add(-cov[3 * x + y], w[i] + y * by_frame + 6, e, result.by_own[i] + x * e);
                add(-cov[3 * x + y], rig_point[i] + y * m, m, by_rig);
            }
            result.mean[i][x] = std::inner_product(by_rig, by_rig + m, rig_step.data, moved);
        }
    }
    return result;
}

AbsorbedFrame absorb_frame(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, Flags stereo, Matrix var_drift,
                           Flags seen_later, const PriorViews& prior, Vector amplitudes, Matrix world_modes, Matrix about,
                           Vector weighted, double negligible) {
    std::size_t k = prior.modes.shape[2], m = prior.rig.information.shape[0], e = state.own.shape[1], size = world_modes.shape[1];
    require_shape(prior.mean, {prior.ids.shape[0], 3}, "mean");
    require_shape(prior.modes, {prior.ids.shape[0], 3, k}, "modes");
    require(m <= k && size >= e + k + 6, "the world has fewer modes than the frame leaves");
    require_shape(views.own, {views.ids.shape[0], 4, e}, "own");
    LeavingViews seen = leaving_views(pinholes, state, views, stereo, var_drift, seen_later, prior);
    Array<std::int64_t, 1> ids = rows_of(prior.ids, seen.rows);
    Array<double, 2> mean = rows_of(prior.mean, seen.rows);
    Array<double, 3> modes = rows_of(prior.modes, seen.rows);
    PriorViews kept{ids, mean, seen.cov, modes, prior.world_modes, prior.rig};
    WithoutPoints system = absorbing_system(views_of(seen.blocks), kept, seen.anchors, seen.q, amplitudes);
    std::size_t points = ids.size(), narrow = e + k + 6 - m, own = size - m, fresh = seen.fresh.size();
    widen(system, size - m - narrow, m, about, weighted);
    require(system.g.size() == size, "the world has other modes than the frame leaves");
    FactoredWindow found = factored(system, m);
    const SolvedWindow& solved = found.solved;
    // the other variables by the new modes and by the rig's errors, which only the window moves, and their step
    Array<double, 2> by_new(own, size + 1);
    for (std::size_t i = 0; i < own; i++) {
        double* out = std::copy_n(solved.root[i], own, by_new[i]);
        *std::copy_n(solved.by_rig[i], m, out) = found.alone.data[i];
    }
    Array<double, 2> world = carried({world_modes.data, size}, world_modes.shape[0], own, m, by_new);
    Array<double, 2> moved = carried({solved.reach.data.get(), narrow + m}, 3 * points, narrow, m, by_new);
    std::vector<double> shared(3 * fresh * (e + m));  // of new points, by the frame's own and by the rig's errors
    for (std::size_t row = 0; row < 3 * fresh; row++) {
        double* out = std::copy_n(seen.alone.by_own.data.get() + row * e, e, shared.data() + row * (e + m));
        std::copy_n(seen.alone.by_rig.data.get() + row * m, m, out);
    }
    Array<double, 2> new_moved = carried({shared.data(), e + m}, 3 * fresh, e, m, by_new);
    Array<double, 3> modes_new(fresh, 3, size);
    for (std::size_t row = 0; row < 3 * fresh; row++) {
        std::copy_n(new_moved[row], size, modes_new.data.get() + row * size);
        seen.alone.mean.data[row] += new_moved[row][size];
    }
    AbsorbedPoints after = absorbed_points(ids, solved.std_given, {moved.data.get(), {points, 3, size + 1}}, system.given, seen.q, seen.stays,
                                           seen.fresh, seen.alone.mean, seen.alone.cov, modes_new);
    Array<double, 2> of_world(world_modes.shape[0], size);
    Array<double, 1> world_step(world_modes.shape[0]);
    for (std::size_t row = 0; row < world_modes.shape[0]; row++) {
        std::copy_n(world[row], size, of_world[row]);
        world_step.data[row] = world[row][size];
    }
    TruncatedModes left = truncate_modes(after.cov, after.modes, of_world, m, negligible);
    return {std::move(after.ids), std::move(after.mean), std::move(left.cov), std::move(left.modes), std::move(left.world_modes),
            std::move(world_step), std::move(found.solved.information_of_rig), std::move(found.pull_of_rig)};
}

}  // namespace core
