// The oldest frame leaves the window: its views become part of the prior, eqs. (31) to (35).
// Points of the prior that this frame or later ones see are part of the dense system. Points outside the prior that
// this frame and later ones see enter it by the views of this frame alone.

#include "window.hpp"
#include "poses.hpp"

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

LeavingViews leaving_views(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, Flags stereo,
                           Matrix var_drift, Flags seen_later, Indices known, Matrices cov) {
    std::size_t points = state.ids.shape[0], n = views.ids.shape[0];
    require_shape(views.used, {n}, "used");
    require_shape(stereo, {n}, "stereo");
    require_shape(seen_later, {points}, "seen_later");
    require_shape(cov, {known.shape[0], 3, 3}, "cov");
    std::vector<char> in_prior(points);
    for (std::size_t i = 0; i < known.shape[0]; i++) {
        require(static_cast<std::uint64_t>(known.data[i]) < points, "the prior knows a point that is not of the window");
        in_prior[static_cast<std::size_t>(known.data[i])] = 1;
    }
    Array<bool, 1> counts(n);
    Lookup of_map{state.ids};
    for (std::size_t i = 0; i < n; i++) {  // a point enters with a stereo view, as one side alone does not determine its depth
        std::size_t at = of_map.row(views.ids.data[i]);
        counts.data[i] = views.used.data[i] && (stereo.data[i] || (at != NONE && in_prior[at]));
    }
    Array<std::int64_t, 1> seen = times_among(state.ids, views.ids, counts);
    std::vector<std::size_t> rows, at_rows;
    for (std::size_t i = 0; i < known.shape[0]; i++) {
        auto at = static_cast<std::size_t>(known.data[i]);
        if (seen.data[at] || seen_later.data[at]) rows.push_back(i), at_rows.push_back(at);
    }
    std::vector<std::size_t> fresh =
        rows_where(points, [&](std::size_t at) { return seen.data[at] && seen_later.data[at] && !in_prior[at]; });
    WindowViews counted = views;
    counted.used = counts;
    Part absorbed(state, at_rows), begun(state, fresh);
    NormalBlocks own = normal_blocks(pinholes, begun.in(state), counted, true);
    Array<double, 3> drifted = rows_of(cov, rows);
    Array<double, 3> drift = drift_covariances(absorbed.ids, absorbed.anchors, absorbed.q, views.ids, var_drift);
    add(1.0, drift.data.get(), 9 * rows.size(), drifted.data.get());
    Array<bool, 1> stays = rows_of(seen_later, at_rows);
    Array<double, 1> held(state.rig_error.shape[0]);  // errors of the rig do not move
    PointsAlone alone = points_alone(own.v, own.w, own.g_point, own.rig_point, begun.q, held);
    NormalBlocks blocks = normal_blocks(pinholes, absorbed.in(state), counted, true);
    return {numbers(rows), std::move(stays), std::move(drifted), std::move(absorbed.anchors), std::move(absorbed.q),
            std::move(blocks), std::move(begun.ids), std::move(alone)};
}

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
    require_shape(blocks.u, {1, by_frame, by_frame}, "u");
    require_shape(blocks.w, {n, 3, by_frame}, "w");
    require_shape(blocks.g_pose, {1, by_frame}, "g_pose");
    require_shape(blocks.rig_pose, {1, by_frame, m}, "rig_pose");
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
    for (std::size_t x = 0; x < e + k + 6; x++)
        for (std::size_t y = 0; y < x; y++) result.h[y][x] = result.h[x][y];
    return result;
}

AbsorbedPoints absorbed_points(Indices ids, Matrices std_given, Matrices moved, Matrix given, Matrix q, Flags stays,
                               Indices ids_new, Matrix mean_new, Matrices cov_new, Matrices modes_new) {
    std::size_t n = ids.shape[0], more = ids_new.shape[0];
    require(moved.shape[2] > 0, "there is no step");
    std::size_t k = moved.shape[2] - 1;
    require_shape(std_given, {n, 3, 3}, "std_given");
    require_shape(moved, {n, 3, k + 1}, "moved");
    require_shape(given, {n, 3}, "given");
    require_shape(q, {n, 3}, "q");
    require_shape(stays, {n}, "stays");
    require_shape(mean_new, {more, 3}, "mean_new");
    require_shape(cov_new, {more, 3, 3}, "cov_new");
    require_shape(modes_new, {more, 3, k}, "modes_new");
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

}  // namespace core
