// The points of a window: by its reference camera, again in the next frame, their drift, and which are determined.

#include "poses.hpp"
#include "window.hpp"

namespace core {

Array<double, 3> q_by_reference(Matrices ref_from_anchor, Matrix q) {
    std::size_t n = q.shape[0];
    require_shape(q, {n, 3}, "q");
    require_shape(ref_from_anchor, {n, 4, 4}, "ref_from_anchor");
    Array<double, 3> anchor_from_ref = pose_inverse(ref_from_anchor), result(n, 3, 6);
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

SeenAgain points_seen_again(Indices ids, Matrix var_drift, Indices known, Matrix q, Matrices cov_q) {
    std::size_t n = ids.shape[0], points = known.shape[0];
    require_shape(var_drift, {n, 3}, "var_drift");
    require_shape(q, {points, 3}, "q");
    require_shape(cov_q, {points, 3, 3}, "cov_q");
    std::vector<std::size_t> views, at;
    Lookup before{known};
    for (std::size_t i = 0; i < n; i++)
        if (std::size_t row = before.row(ids.data[i]); row != NONE) views.push_back(i), at.push_back(row);
    SeenAgain result{numbers(views), {views.size(), 4}, {views.size(), 4, 4}};
    for (std::size_t i = 0; i < views.size(); i++) {
        result.points[i][2] = 1.0;
        for (std::size_t row = 0; row < 3; row++) {
            result.points[i][Q_COLUMNS[row]] = q[at[i]][row];
            for (std::size_t c = 0; c < 3; c++)
                result.cov[i][4 * Q_COLUMNS[row] + Q_COLUMNS[c]] = cov_q[at[i]][3 * row + c] + (row == c ? var_drift[views[i]][row] : 0.0);
        }
    }
    return result;
}

Array<double, 3> drift_covariances(Indices ids, Matrices ref_from_anchor, Matrix q, Indices seen, Matrix var_drift) {
    std::size_t n = ids.shape[0];
    require_shape(ref_from_anchor, {n, 4, 4}, "ref_from_anchor");
    require_shape(q, {n, 3}, "q");
    require_shape(var_drift, {seen.shape[0], 3}, "var_drift");
    Array<double, 3> result(n, 3, 3);
    Lookup views{seen};
    for (std::size_t i = 0; i < n; i++) {
        std::size_t view = views.row(ids.data[i]);
        if (view == NONE) continue;
        double in_anchor[4] = {q[i][0], q[i][1], 1.0, q[i][2]}, here[4], here_by_anchor[9], anchor_by_here[9];
        move(ref_from_anchor[i], in_anchor, here);
        for (std::size_t row = 0; row < 3; row++)  // ∂q/∂P has the rows (e − q e₃)/Z
            for (std::size_t c = 0; c < 3; c++) {
                const double *of = ref_from_anchor[i] + Q_COLUMNS[c], at = here[Q_COLUMNS[row]] / here[2];
                here_by_anchor[3 * row + c] = (of[4 * Q_COLUMNS[row]] - at * of[8]) / here[2];
            }
        invert3(here_by_anchor, anchor_by_here);
        for (std::size_t row = 0; row < 3; row++)
            for (std::size_t c = 0; c < 3; c++)
                for (std::size_t k = 0; k < 3; k++)
                    result[i][3 * row + c] += anchor_by_here[3 * row + k] * var_drift[view][k] * anchor_by_here[3 * c + k];
    }
    return result;
}

Array<bool, 1> determined_points(Indices ids, Indices known, Indices seen, Flags used, Flags stereo, int newest) {
    std::size_t n = seen.shape[0], first = static_cast<std::size_t>(newest);
    require_shape(used, {n}, "used");
    require_shape(stereo, {n}, "stereo");
    require(newest >= 0 && first <= n, "the newest views begin where there are none");
    Array<bool, 1> counts(n), result = among(ids, known), lives = among(ids, {seen.data + first, {n - first}});
    for (std::size_t i = 0; i < n; i++) counts.data[i] = used.data[i] && stereo.data[i];
    Array<std::int64_t, 1> times = times_among(ids, seen, used), in_stereo = times_among(ids, seen, counts);
    for (std::size_t i = 0; i < ids.shape[0]; i++)
        result.data[i] = result.data[i] || (in_stereo.data[i] > 0 && (times.data[i] > 1 || lives.data[i]));
    return result;
}

}  // namespace core
