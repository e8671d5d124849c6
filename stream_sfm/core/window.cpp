// The views of a window of frames: whitened residuals, Gauss-Newton normal equations, and points eliminated from them.
//
// Points are q = (X/Z, Y/Z, 1/Z) in their anchors, C (q₁, q₂, 1, q₃)ᵀ in the reference camera, eq. (24). Errors c of the
// rig move a view by B c, with B = [terms | moves ⊗ field]: all parts of the field share its basis, so products with
// the field cost what those with one part of it do.

#include <cmath>
#include <vector>

#include "algebra.hpp"
#include "stages.hpp"

namespace core {
namespace {

constexpr std::size_t CHUNK = 16;     // views whose products are summed at once
constexpr std::size_t MAX_PARTS = 4;  // of the field: a view has no more coordinates
constexpr std::size_t Q_COLUMNS[3] = {0, 1, 3};  // of a homogeneous point: what q moves

// out += a x, n numbers.
inline void add(double a, const double* x, std::size_t n, double* out) {
    for (std::size_t i = 0; i < n; i++) out[i] += a * x[i];
}

void check(const View<double, 3>& cams, const View<double, 3>& anchors, const View<double, 2>& q, const Indices& frame,
           const Indices& point) {
    std::size_t frames = cams.shape[0], points = q.shape[0];
    require_shape(cams, {frames, 4, 4}, "cams_from_ref");
    require_shape(anchors, {points, 4, 4}, "ref_from_anchor");
    require_shape(q, {points, 3}, "q");
    require_shape(point, {frame.shape[0]}, "point");
    for (std::size_t i = 0; i < frame.shape[0]; i++)
        require(static_cast<std::uint64_t>(frame.data[i]) < frames && static_cast<std::uint64_t>(point.data[i]) < points,
                "a view is of no frame or of no point of the window");
}

void check(const WindowState& state, const WindowViews& views) {
    check(state.cams_from_ref, state.ref_from_anchor, state.q, views.frame, views.point);
    std::size_t n = views.frame.shape[0], terms = views.terms.shape[2], parts = views.moves.shape[1];
    require_shape(views.z, {n, 4}, "z_px");
    require_shape(views.root, {n, 4, 4}, "root");
    require_shape(views.terms, {n, 4, terms}, "terms");
    require_shape(views.field, {n, views.field.shape[1]}, "field");
    require_shape(views.moves, {4, parts}, "moves");
    require(parts <= MAX_PARTS, "the field has too many parts");
    require_shape(state.rig_error, {terms + parts * views.field.shape[1]}, "rig_error");
}

// The point of a view in the reference camera, eq. (24), and in its own.
void points_of(const double* anchor, const double* q, const double* cam, double* in_cam) {
    double in_anchor[4] = {q[0], q[1], 1.0, q[2]}, in_ref[4];
    move(anchor, in_anchor, in_ref);
    move(cam, in_ref, in_cam);
    clamp_depth(in_cam);
}

// The whitened residual (4,) of view i, and its point in the camera.
void residual(const Pinholes& pinholes, const WindowState& state, const WindowViews& views, std::size_t i, double* in_cam,
              double* r) {
    auto at = static_cast<std::size_t>(views.point.data[i]);
    points_of(state.ref_from_anchor[at], state.q[at], state.cams_from_ref[static_cast<std::size_t>(views.frame.data[i])], in_cam);
    std::size_t terms = views.terms.shape[2], basis = views.field.shape[1], parts = views.moves.shape[1];
    double z[4];
    project(pinholes, in_cam, z);
    const double* c = state.rig_error.data;
    for (std::size_t row = 0; row < 4; row++)
        for (std::size_t k = 0; k < terms; k++) z[row] += views.terms[i][row * terms + k] * c[k];
    for (std::size_t part = 0; part < parts; part++) {
        double moved = 0;
        for (std::size_t k = 0; k < basis; k++) moved += views.field[i][k] * c[terms + part * basis + k];
        for (std::size_t row = 0; row < 4; row++) z[row] += views.moves[row][part] * moved;
    }
    for (int row = 0; row < 4; row++) {
        r[row] = 0;
        for (int k = 0; k < 4; k++) r[row] += views.root[i][4 * row + k] * (views.z[i][k] - z[k]);
    }
}

}  // namespace

Array<double, 2> window_points(const View<double, 3>& cams_from_ref, const View<double, 3>& ref_from_anchor,
                               const View<double, 2>& q, const Indices& frame, const Indices& point) {
    check(cams_from_ref, ref_from_anchor, q, frame, point);
    Array<double, 2> result({frame.shape[0], 4});
    for (std::size_t i = 0; i < frame.shape[0]; i++) {
        auto at = static_cast<std::size_t>(point.data[i]);
        points_of(ref_from_anchor[at], q[at], cams_from_ref[static_cast<std::size_t>(frame.data[i])], result[i]);
    }
    return result;
}

Array<double, 3> q_by_reference(const View<double, 3>& ref_from_anchor, const View<double, 2>& q) {
    std::size_t n = q.shape[0];
    require_shape(q, {n, 3}, "q");
    require_shape(ref_from_anchor, {n, 4, 4}, "ref_from_anchor");
    Array<double, 3> anchor_from_ref = pose_inverse(ref_from_anchor), result({n, 3, 6});
    for (std::size_t i = 0; i < n; i++) {
        double point[4] = {q[i][0], q[i][1], 1.0, q[i][2]}, in_ref[4], by_ref[4];
        move(ref_from_anchor[i], point, in_ref);
        for (int row = 0; row < 3; row++) {  // ∂q/∂P in the anchor has the rows e − q e₃
            const double* inverse = anchor_from_ref[i];
            for (int k = 0; k < 4; k++) by_ref[k] = inverse[4 * (row < 2 ? row : 3) + k] - q[i][row] * inverse[8 + k];
            by_motion(by_ref, in_ref, result[i] + 6 * row);
        }
    }
    return result;
}

Array<double, 2> window_residuals(const Pinholes& pinholes, const WindowState& state, const WindowViews& views) {
    check(state, views);
    Array<double, 2> result({views.frame.shape[0], 4});
    double in_cam[4];
    for (std::size_t i = 0; i < views.frame.shape[0]; i++) residual(pinholes, state, views, i, in_cam, result[i]);
    return result;
}

NormalBlocks normal_blocks(const Pinholes& pinholes, const WindowState& state, const WindowViews& views) {
    check(state, views);
    std::size_t frames = state.cams_from_ref.shape[0], points = state.q.shape[0], m = state.rig_error.shape[0];
    std::size_t terms = views.terms.shape[2], basis = views.field.shape[1], parts = views.moves.shape[1];
    NormalBlocks blocks{Array<double, 3>({frames, 6, 6}), Array<double, 3>({points, 3, 3}), Array<double, 3>({points, 3, 6 * frames}),
                        Array<double, 2>({frames, 6}),    Array<double, 2>({points, 3}),    Array<double, 2>({m, m}),
                        Array<double, 3>({frames, 6, m}), Array<double, 3>({points, 3, m}), Array<double, 1>({m})};
    // A view's four whitened rows: by pose (6), residual (1), by terms, by parts of the field, by point (3).
    const std::size_t own = 7 + terms, by_point = own + parts, columns = by_point + 3, pairs = parts * (parts + 1) / 2;
    std::vector<double> rows(CHUNK * 4 * columns), with_parts(CHUNK * own * parts), squares(CHUNK * pairs * basis);
    std::vector<double> of_frame(own * own), of_field(own * parts * basis), of_squares(pairs * basis * basis);
    double *rig = blocks.rig.data.get(), *g_rig = blocks.g_rig.data.get();
    std::size_t n = views.frame.shape[0], next = 0;
    for (std::size_t first = 0; first < n; first = next) {
        auto f = static_cast<std::size_t>(views.frame.data[first]);
        while (next < n && next < first + CHUNK && views.frame.data[next] == views.frame.data[first]) next++;
        for (std::size_t i = first; i < next; i++) {
            auto at = static_cast<std::size_t>(views.point.data[i]);
            const double *cam = state.cams_from_ref[f], *anchor = state.ref_from_anchor[at], *root = views.root[i];
            const double* phi = views.field[i];
            double *j = rows.data() + (i - first) * 4 * columns, *parted = with_parts.data() + (i - first) * own * parts;
            double *square = squares.data() + (i - first) * pairs * basis, *w = blocks.w[at] + 6 * f, *by_rig = blocks.rig_point[at];
            double p[4], r[4], a[16], by_cam[16], by_ref[16], by_anchor[16], q_by_parts[3 * MAX_PARTS] = {};
            residual(pinholes, state, views, i, p, r);
            jacobian(pinholes, p, a);
            multiply(root, a, by_cam);
            multiply(by_cam, cam, by_ref);
            multiply(by_ref, anchor, by_anchor);
            for (std::size_t row = 0; row < 4; row++) {
                double* out = j + row * columns;
                by_motion(by_cam + 4 * row, p, out);
                out[6] = r[row];
                std::fill(out + 7, out + by_point, 0.0);
                for (std::size_t c = 0; c < 4; c++) {
                    double weight = root[4 * row + c];
                    if (weight == 0) continue;
                    add(weight, views.terms[i] + c * terms, terms, out + 7);
                    add(weight, views.moves[c], parts, out + own);
                }
                for (int k = 0; k < 3; k++) out[by_point + k] = by_anchor[4 * row + Q_COLUMNS[k]];
                const double* q = out + by_point;
                for (std::size_t x = 0; x < 3; x++) {
                    add(q[x], q, 3, blocks.v[at] + 3 * x);
                    add(q[x], out, 6, w + 6 * frames * x);
                    add(q[x], out + 7, terms, by_rig + x * m);
                    add(q[x], out + own, parts, q_by_parts + x * parts);
                    blocks.g_point[at][x] += q[x] * r[row];
                }
            }
            for (std::size_t x = 0; x < 3; x++)
                for (std::size_t part = 0; part < parts; part++)
                    add(q_by_parts[x * parts + part], phi, basis, by_rig + x * m + terms + part * basis);
            for (std::size_t x = 0; x < own; x++)
                for (std::size_t part = 0; part < parts; part++) {
                    double sum = 0;
                    for (std::size_t row = 0; row < 4; row++) sum += j[row * columns + x] * j[row * columns + own + part];
                    parted[x * parts + part] = sum;
                }
            for (std::size_t x = 0; x < parts; x++)
                for (std::size_t y = x; y < parts; y++, square += basis) {
                    double both = 0;
                    for (std::size_t row = 0; row < 4; row++) both += j[row * columns + own + x] * j[row * columns + own + y];
                    for (std::size_t k = 0; k < basis; k++) square[k] = both * phi[k];
                }
        }
        std::size_t seen = next - first;
        Rows all{rows.data(), columns}, field{views.field[first], basis};
        add_product(all, own, all, own, 4 * seen, own, of_frame.data());
        add_product({with_parts.data(), own * parts}, own * parts, field, basis, seen, 0, of_field.data());
        add_product({squares.data(), pairs * basis}, pairs * basis, field, basis, seen, basis, of_squares.data());
        if (next < n && views.frame.data[next] == views.frame.data[first]) continue;
        auto add_by_rig = [&](std::size_t x, double* out) {  // out += the product of column x with all of the rig's
            add(1.0, of_frame.data() + x * own + 7, terms, out);
            add(1.0, of_field.data() + x * parts * basis, parts * basis, out + terms);
        };
        for (std::size_t x = 0; x < 6; x++) {
            for (std::size_t y = 0; y < 6; y++) blocks.u[f][6 * x + y] += of_frame[std::min(x, y) * own + std::max(x, y)];
            blocks.g_pose[f][x] += of_frame[x * own + 6];
            add_by_rig(x, blocks.rig_pose[f] + x * m);
        }
        add_by_rig(6, g_rig);
        for (std::size_t x = 0; x < terms; x++) add_by_rig(7 + x, rig + x * m);
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

EliminatedPoints eliminate_points(const View<double, 3>& v, const View<double, 3>& w, const View<double, 3>& by_rig,
                                  const Indices& known, const View<double, 3>& cov, const View<double, 3>& modes) {
    std::size_t points = v.shape[0], n = cov.shape[0], k = modes.shape[2], poses = w.shape[2], m = by_rig.shape[2];
    require_shape(v, {points, 3, 3}, "v");
    require_shape(w, {points, 3, poses}, "w");
    require_shape(by_rig, {points, 3, m}, "by_rig");
    require_shape(known, {n}, "known");
    require_shape(cov, {n, 3, 3}, "cov");
    require_shape(modes, {n, 3, k}, "modes");
    require(m <= k, "there are fewer modes than errors of the rig");
    std::size_t size = poses + k;
    EliminatedPoints result{Array<double, 3>({n, 3, 3}), Array<double, 3>({n, 3, k}), Array<double, 3>({points, 3, 3}),
                            Array<double, 3>({points, 3, size})};
    std::vector<double> information(v.data, v.data + 9 * points), cross(3 * size);
    std::vector<const double*> pull(points, nullptr);
    for (std::size_t i = 0; i < n; i++) {
        require(static_cast<std::uint64_t>(known.data[i]) < points, "the prior knows a point that is not of the window");
        auto at = static_cast<std::size_t>(known.data[i]);
        double *d_inverse = result.d_inverse[i], *out = result.pull[i];
        invert_positive<3>(cov[i], d_inverse);
        for (int x = 0; x < 9; x++) information[9 * at + static_cast<std::size_t>(x)] += d_inverse[x];
        for (std::size_t x = 0; x < 3; x++)
            for (std::size_t y = 0; y < 3; y++) add(d_inverse[3 * x + y], modes[i] + y * k, k, out + x * k);
        pull[at] = out;
    }
    for (std::size_t at = 0; at < points; at++) {
        double given[9], *std_given = result.std_given[at];
        invert_positive<3>(information.data() + 9 * at, given);
        require_definite(cholesky<3>(given, std_given), "the information about a point is not positive definite");
        for (std::size_t x = 0; x < 3; x++) {
            double* out = cross.data() + x * size;
            std::copy(w[at] + x * poses, w[at] + (x + 1) * poses, out);
            std::fill(out + poses, out + size, 0.0);
            if (pull[at]) add(-1.0, pull[at] + x * k, k, out + poses);
            add(1.0, by_rig[at] + x * m, m, out + size - m);
        }
        for (std::size_t x = 0; x < 3; x++)  // std_givenᵀ, an upper triangle
            for (std::size_t y = x; y < 3; y++) add(std_given[3 * y + x], cross.data() + y * size, size, result.reach[at] + x * size);
    }
    return result;
}

}  // namespace core
