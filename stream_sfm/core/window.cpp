// The views of a window of frames: whitened residuals, gates, and Gauss-Newton normal equations.
//
// Points are q = (X/Z, Y/Z, 1/Z) in their anchors, C (q₁, q₂, 1, q₃)ᵀ in the reference camera, eq. (24). Errors c of
// the rig shift a view by B c, with B = [terms | moves ⊗ field]: all parts of the field share its basis, so products
// with the field cost as much as those with one part of it.

#include "window.hpp"
#include "poses.hpp"
#include "row_timing.hpp"

namespace core {
namespace {

enum : std::size_t {
    CHUNK = 16,    // views whose products are summed together
    MAX_PARTS = 4  // of the field: as many as a view has coordinates
};
constexpr std::size_t MOST_PARTS = 1000;  // parts of the points, each with its own system of poses

// A used view: its row, and the rows of its frame and of its point.
struct Seen {
    std::size_t view, frame, point;
};

// The used views of points of the state.
std::vector<Seen> seen_by(const WindowState& state, const WindowViews& views) {
    std::size_t n = views.frame.shape[0], terms = views.terms.shape[2], parts = views.moves.shape[1];
    std::size_t frames = state.cams_from_ref.shape[0], points = state.q.shape[0];
    require_shape(state.cams_from_ref, {frames, 4, 4}, "cams_from_ref");
    require_shape(state.ids, {points}, "ids");
    require_shape(state.ref_from_anchor, {points, 4, 4}, "ref_from_anchor");
    require_shape(state.q, {points, 3}, "q");
    require_shape(views.ids, {n}, "ids");
    require_shape(views.used, {n}, "used");
    require_shape(views.z_px, {n, 4}, "z_px");
    require_shape(views.root, {n, 4, 4}, "root");
    require_shape(views.weight, {n, 4}, "weight");
    require_shape(views.own, {n, 4, views.own.shape[2]}, "own");
    if (views.own.shape[2]) require_shape(state.own, {frames, views.own.shape[2]}, "own amplitudes");
    require_shape(views.terms, {n, 4, terms}, "terms");
    require_shape(views.timing, {n, 4, views.timing.shape[2]}, "timing");
    require(views.timing.shape[2] == 0 || AT_TIMING + views.timing.shape[2] <= terms, "there are no terms of delay and readout");
    require_shape(views.field, {n, views.field.shape[1]}, "field");
    require_shape(views.moves, {4, parts}, "moves");
    require(parts <= MAX_PARTS, "the field has too many parts");
    require_shape(state.rig_error, {terms + parts * views.field.shape[1]}, "rig_error");
    std::vector<Seen> result;
    result.reserve(n);
    Lookup points_of_map{state.ids};
    for (std::size_t i = 0; i < n; i++) {
        if (!views.used.data[i]) continue;
        auto frame = static_cast<std::uint64_t>(views.frame.data[i]);
        require(frame < frames, "a view is of no frame of the window");
        std::size_t point = points_of_map.row(views.ids.data[i]);
        if (point != NONE) result.push_back({i, frame, point});
    }
    return result;
}

// The expected view (4,) of a point in the camera, with the errors of the rig and of the frame.
void predicted(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, const Seen& seen,
               const double* in_cam, double* z) {
    std::size_t i = seen.view, own = views.own.shape[2];
    std::size_t terms = views.terms.shape[2], timed = views.timing.shape[2], basis = views.field.shape[1], parts = views.moves.shape[1];
    const double *c = state.rig_error.data, *by_own = views.own[i], *by_terms = views.terms[i], *by_timing = views.timing[i], *phi = views.field[i];
    double seen_at[4];  // sums of the four rows, computed side by side
    project(pinholes, in_cam, seen_at);
    auto add_rows = [&](const double* by, std::size_t n, const double* amplitudes) {
        for (std::size_t k = 0; k < n; k++)
            for (std::size_t row = 0; row < 4; row++) seen_at[row] += by[row * n + k] * amplitudes[k];
    };
    add_rows(by_own, own, state.own.data + seen.frame * own);
    add_rows(by_terms, terms, c);
    add_rows(by_timing, timed, c + AT_TIMING);
    for (std::size_t part = 0; part < parts; part++) {
        double moved = 0;
        for (std::size_t k = 0; k < basis; k++) moved += phi[k] * c[terms + part * basis + k];
        for (std::size_t row = 0; row < 4; row++) seen_at[row] += views.moves[row][part] * moved;
    }
    std::copy(seen_at, seen_at + 4, z);
}

// The point of a used view in its camera, by way of the reference camera, eq. (24).
void point_of(const WindowState& state, const Seen& seen, double* in_cam) {
    const double* q = state.q[seen.point];
    double in_anchor[4] = {q[0], q[1], 1.0, q[2]}, in_ref[4];
    move(state.ref_from_anchor[seen.point], in_anchor, in_ref);
    move(state.cams_from_ref[seen.frame], in_ref, in_cam);
    clamp_depth(in_cam);
}

// The whitened residual (4,) of a view, and its point in the camera.
void residual(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, const Seen& seen,
              double* in_cam, double* r) {
    double z[4];
    point_of(state, seen, in_cam);
    predicted(pinholes, state, views, seen, in_cam, z);
    for (int row = 0; row < 4; row++) {
        r[row] = 0;
        for (int k = 0; k < 4; k++) r[row] += views.root[seen.view][4 * row + k] * (views.z_px[seen.view][k] - z[k]);
    }
}

bool sees_both(const WindowViews& views, const Seen& seen) {
    return views.root[seen.view][10] != 0;  // of u_right
}

// The squared residual of a view by its own covariance, which contains a slide of this variance a coordinate, eq. (26a).
double own_square(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, const Seen& seen, double var_slide_px2) {
    double in_cam[4], r[4], sum = 0;
    residual(pinholes, state, views, seen, in_cam, r);
    for (int c = 0; c < 4; c++) {
        const double *row = views.root[seen.view] + 4 * c, weight = views.weight[seen.view][c];
        sum += r[c] * r[c] / (weight * weight + var_slide_px2 * (row[0] * row[0] + row[1] * row[1] + row[2] * row[2] + row[3] * row[3]));
    }
    return sum;
}

}  // namespace

Array<double, 2> points_of_views(const WindowState& state, const WindowViews& views) {
    std::vector<Seen> seen = seen_by(state, views);
    Array<double, 2> result(seen.size(), 4);
    for (std::size_t i = 0; i < seen.size(); i++) point_of(state, seen[i], result[i]);
    return result;
}

Array<double, 2> expected_views(const Pinholes& pinholes, const WindowState& state, const WindowViews& views,
                                Flags stereo, Matrix expected) {
    std::size_t n = views.ids.shape[0];
    require_shape(stereo, {n}, "stereo");
    require_shape(expected, {n, 4}, "expected_px");
    Array<double, 2> result(n, 4);
    std::copy(expected.data, expected.data + 4 * n, result.data.get());
    for (const Seen& seen : seen_by(state, views)) {
        double in_cam[4], *z = result[seen.view];
        point_of(state, seen, in_cam);
        predicted(pinholes, state, views, seen, in_cam, z);
        if (!stereo.data[seen.view]) z[2] = z[3] = std::numeric_limits<double>::quiet_NaN();
    }
    return result;
}

Array<double, 3> timing_of_views(const Pinholes& pinholes, const ExposedRows& exposed, const WindowState& state,
                                 const WindowViews& views, Matrix expected, Matrices motions, Vector timing) {
    check(exposed);
    require_shape(expected, {views.ids.shape[0], 4}, "expected_px");
    require_shape(motions, {state.cams_from_ref.shape[0], 2, 6}, "motions");
    require_shape(timing, {2}, "timing");
    Array<double, 3> result(views.ids.shape[0], 4, 2);
    for (const Seen& seen : seen_by(state, views)) {
        double in_cam[4];
        point_of(state, seen, in_cam);
        timing_of_view(pinholes, exposed, in_cam, motions[seen.frame], timing.data, expected[seen.view], result[seen.view]);
    }
    return result;
}

Array<double, 1> slides_of_views(Indices points, Indices ids, Matrix var_drift, double f_px) {
    std::size_t n = ids.shape[0];
    require_shape(var_drift, {n, 3}, "var_drift");
    Array<double, 1> slides(n);
    std::vector<std::size_t> rows(n), end(points.shape[0] + 1), by_track(n);
    Lookup of_points{points};
    for (std::size_t i = 0; i < n; i++)
        if ((rows[i] = of_points.row(ids.data[i])) != NONE) end[rows[i] + 1]++;
    std::partial_sum(end.begin(), end.end(), end.begin());
    std::vector<std::size_t> next(end.begin(), end.end() - 1);
    for (std::size_t i = 0; i < n; i++)
        if (rows[i] != NONE) by_track[next[rows[i]]++] = i;
    for (std::size_t k = 0; k < points.shape[0]; k++) {
        double walked = 0, middle = 0;
        for (std::size_t at = end[k]; at < end[k + 1]; at++) {
            slides.data[by_track[at]] = walked += var_drift[by_track[at]][0] * f_px * f_px;
            if (at - end[k] == (end[k + 1] - end[k]) / 2) middle = walked;
        }
        for (std::size_t at = end[k]; at < end[k + 1]; at++) slides.data[by_track[at]] = std::abs(slides.data[by_track[at]] - middle);
    }
    return slides;
}

Array<bool, 1> views_within_gates(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, Matrix var_drift,
                                  double of_one, double of_both) {
    Array<bool, 1> result(views.frame.shape[0]);
    Array<double, 1> slides = slides_of_views(state.ids, views.ids, var_drift, pinholes.f_px);
    for (const Seen& seen : seen_by(state, views)) {
        double square = own_square(pinholes, state, views, seen, slides.data[seen.view]);
        result.data[seen.view] = !(square > (sees_both(views, seen) ? of_both : of_one));
    }
    return result;
}

TrackSquares squares_of_tracks(const Pinholes& pinholes, const WindowState& state, const WindowViews& views) {
    TrackSquares result{{state.q.shape[0]}, {state.q.shape[0]}};
    for (const Seen& seen : seen_by(state, views)) {
        result.squares.data[seen.point] += own_square(pinholes, state, views, seen, 0.0);
        result.values.data[seen.point] += sees_both(views, seen) ? 4 : 2;
    }
    return result;
}

WIDER NormalBlocks normal_blocks(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, bool with_rig) {
    const std::vector<Seen> seen = seen_by(state, views);
    std::size_t frames = state.cams_from_ref.shape[0], points = state.q.shape[0], m = with_rig ? state.rig_error.shape[0] : 0;
    std::size_t terms = with_rig ? views.terms.shape[2] : 0, timed = with_rig ? views.timing.shape[2] : 0;
    std::size_t basis = with_rig ? views.field.shape[1] : 0, parts = basis ? views.moves.shape[1] : 0;
    const std::size_t of_own = views.own.shape[2], by_frame = 6 + of_own;
    NormalBlocks blocks{{frames, by_frame, by_frame}, {points, 3, 3}, {points, 3, by_frame * frames}, {frames, by_frame, m}, {points, 3, m},
                        {frames, by_frame}, {points, 3}, {m, m}, {m}};
    for (std::size_t f = 0; f < frames; f++)  // the prior of the errors that a frame's views share
        for (std::size_t k = 0; k < of_own; k++) {
            blocks.u[f][(by_frame + 1) * (6 + k)] += 1;
            blocks.g_pose[f][6 + k] -= state.own[f][k];
        }
    // The four whitened rows of a view: by pose (6) and the frame's own amplitudes, residual (1), by terms, by parts of
    // the field, by point (3).
    const std::size_t own = by_frame + 1 + terms, by_point = own + parts, columns = by_point + 3, pairs = parts * (parts + 1) / 2;
    std::vector<double> rows(CHUNK * 4 * columns), with_parts(CHUNK * own * parts), squares(CHUNK * pairs * basis);
    std::vector<double> phis(CHUNK * basis), of_frame(own * own), of_field(own * parts * basis), of_squares(pairs * basis * basis);
    double *rig = blocks.rig.data.get(), *g_rig = blocks.g_rig.data.get();
    std::size_t n = seen.size(), next = 0;
    for (std::size_t first = 0; first < n; first = next) {
        std::size_t f = seen[first].frame;
        while (next < n && next < first + CHUNK && seen[next].frame == f) next++;
        for (std::size_t slot = 0; slot < next - first; slot++) {
            std::size_t i = seen[first + slot].view, at = seen[first + slot].point;
            const double *cam = state.cams_from_ref[f], *anchor = state.ref_from_anchor[at], *root = views.root[i];
            const double* phi = std::copy(views.field[i], views.field[i] + basis, phis.data() + slot * basis) - basis;
            double *j = rows.data() + slot * 4 * columns, *parted = with_parts.data() + slot * own * parts;
            double *square = squares.data() + slot * pairs * basis, *w = blocks.w[at] + by_frame * f, *by_rig = blocks.rig_point[at];
            double p[4], r[4], a[16], by_cam[16], by_ref[16], by_anchor[16], q_by_parts[3 * MAX_PARTS] = {};
            residual(pinholes, state, views, seen[first + slot], p, r);
            jacobian(pinholes, p, a);
            multiply<4, 4, 4>(root, a, by_cam);
            multiply<4, 4, 4>(by_cam, cam, by_ref);
            multiply<4, 4, 4>(by_ref, anchor, by_anchor);
            for (std::size_t row = 0; row < 4; row++) {
                double* out = j + row * columns;
                by_motion(by_cam + 4 * row, p, out);
                std::fill(out + 6, out + by_point, 0.0);
                out[by_frame] = r[row];
                for (std::size_t c = 0; c < 4; c++) {
                    double weight = root[4 * row + c];
                    if (weight == 0) continue;
                    add(weight, views.own[i] + c * of_own, of_own, out + 6);
                    add(weight, views.terms[i] + c * terms, terms, out + by_frame + 1);
                    add(weight, views.timing[i] + c * timed, timed, out + by_frame + 1 + AT_TIMING);
                    add(weight, views.moves[c], parts, out + own);
                }
                for (int k = 0; k < 3; k++) out[by_point + k] = by_anchor[4 * row + Q_COLUMNS[k]];
            }
            auto add_by_point = [&](std::size_t column, std::size_t n, double* out, std::size_t stride) {
                add_product({j + by_point, columns}, 3, {j + column, columns}, n, 4, 0, out, stride);
            };
            add_by_point(by_point, 3, blocks.v[at], 3);
            add_by_point(0, by_frame, w, by_frame * frames);
            add_by_point(by_frame, 1, blocks.g_point[at], 1);
            add_by_point(by_frame + 1, terms, by_rig, m);
            add_by_point(own, parts, q_by_parts, parts);
            for (std::size_t x = 0; x < 3; x++)
                for (std::size_t part = 0; part < parts; part++)
                    add(q_by_parts[x * parts + part], phi, basis, by_rig + x * m + terms + part * basis);
            std::fill(parted, parted + own * parts, 0.0);
            add_product({j, columns}, own, {j + own, columns}, parts, 4, 0, parted);
            for (std::size_t x = 0; x < parts; x++)
                for (std::size_t y = x; y < parts; y++, square += basis) {
                    double both = 0;
                    for (std::size_t row = 0; row < 4; row++) both += j[row * columns + own + x] * j[row * columns + own + y];
                    for (std::size_t k = 0; k < basis; k++) square[k] = both * phi[k];
                }
        }
        std::size_t count = next - first;
        Rows all{rows.data(), columns}, field{phis.data(), basis};
        add_product(all, own, all, own, 4 * count, own, of_frame.data());
        add_product({with_parts.data(), own * parts}, own * parts, field, basis, count, 0, of_field.data());
        add_product({squares.data(), pairs * basis}, pairs * basis, field, basis, count, basis, of_squares.data());
        if (next < n && seen[next].frame == f) continue;
        auto add_by_rig = [&](std::size_t x, double* out) {  // out += the products of column x with all columns of the rig
            add(1.0, of_frame.data() + x * own + by_frame + 1, terms, out);
            add(1.0, of_field.data() + x * parts * basis, parts * basis, out + terms);
        };
        for (std::size_t x = 0; x < by_frame; x++) {
            for (std::size_t y = 0; y < by_frame; y++) blocks.u[f][by_frame * x + y] += of_frame[std::min(x, y) * own + std::max(x, y)];
            blocks.g_pose[f][x] += of_frame[x * own + by_frame];
            add_by_rig(x, blocks.rig_pose[f] + x * m);
        }
        add_by_rig(by_frame, g_rig);
        for (std::size_t x = 0; x < terms; x++) add_by_rig(by_frame + 1 + x, rig + x * m);
        std::fill(of_frame.begin(), of_frame.end(), 0.0);
        std::fill(of_field.begin(), of_field.end(), 0.0);
    }
    const double* square = of_squares.data();
    for (std::size_t x = 0; x < parts; x++)
        for (std::size_t y = x; y < parts; y++)
            for (std::size_t k = 0; k < basis; k++, square += basis)
                for (std::size_t l = k; l < basis; l++)
                    rig[(terms + x * basis + k) * m + terms + y * basis + l] =
                        rig[(terms + x * basis + l) * m + terms + y * basis + k] = square[l];
    for (std::size_t x = 0; x < m; x++)
        for (std::size_t y = x + 1; y < m; y++) rig[y * m + x] = rig[x * m + y];
    return blocks;
}

WIDER PosesByParts poses_by_parts(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, Matrices reach,
                            Matrix given, Indices part, int parts) {
    std::size_t frames = state.cams_from_ref.shape[0], points = state.q.shape[0], size = 6 * frames, n = reach.shape[2];
    std::size_t of_part = static_cast<std::size_t>(std::max(parts, 0));
    require_shape(part, {points}, "part");
    require_shape(reach, {points, 3, n}, "reach");
    require_shape(given, {points, 3}, "given");
    require(n >= size, "reach has fewer columns than the poses");
    require(of_part <= MOST_PARTS, "there are more than 1000 parts");
    PosesByParts result{{of_part, size, size}, {of_part, size}};
    for (const Seen& seen : seen_by(state, views)) {
        auto at = static_cast<std::uint64_t>(part.data[seen.point]);
        require(at < of_part, "a point is of no part");
        double p[4], r[4], a[16], by_cam[16], j[24];
        residual(pinholes, state, views, seen, p, r);
        jacobian(pinholes, p, a);
        multiply<4, 4, 4>(views.root[seen.view], a, by_cam);
        for (std::size_t row = 0; row < 4; row++) by_motion(by_cam + 4 * row, p, j + 6 * row);
        add_product({j, 6}, 6, {j, 6}, 6, 4, 0, result.information[at] + 6 * seen.frame * (size + 1), size);
        add_product({j, 6}, 6, {r, 1}, 1, 4, 0, result.right[at] + 6 * seen.frame);
    }
    std::vector<double> rows, steps, taken(size * size), taken_right(size);
    for (std::size_t k = 0; k < of_part; k++) {  // subtract the eliminated points, eq. (27)
        rows.clear(), steps.clear();
        for (std::size_t i = 0; i < points; i++) {
            if (static_cast<std::uint64_t>(part.data[i]) != k) continue;
            for (std::size_t x = 0; x < 3; x++) rows.insert(rows.end(), reach[i] + x * n, reach[i] + x * n + size);
            steps.insert(steps.end(), given[i], given[i] + 3);
        }
        std::fill(taken.begin(), taken.end(), 0.0);
        std::fill(taken_right.begin(), taken_right.end(), 0.0);
        add_product({rows.data(), size}, size, {rows.data(), size}, size, steps.size(), size, taken.data());
        add_product({rows.data(), size}, size, {steps.data(), 1}, 1, steps.size(), 0, taken_right.data());
        for (std::size_t x = 0; x < size; x++)
            for (std::size_t y = 0; y < size; y++) result.information[k][x * size + y] -= taken[std::min(x, y) * size + std::max(x, y)];
        add(-1.0, taken_right.data(), size, result.right[k]);
    }
    return result;
}

}  // namespace core
