// What is known of the rows of left and right: by how much they differ, and whether a match lies on its row, eq. (19).

#include <algorithm>
#include <cmath>

#include "algebra.hpp"
#include "stages.hpp"

namespace core {
namespace {

constexpr std::size_t POLYNOMIAL = 6;  // coefficients; then the delay, then the field
constexpr double GATE = 4.0;  // standard deviations that a match may be off: one good match in 16 000 is lost
// Three times the scatter of good matches; below, few matches that agree by chance set the gate.
constexpr double LEAST_GATE_PX = 0.3;

}  // namespace

Array<double, 2> row_terms(const std::array<double, 2>& size, const Field& field, const View<double, 2>& at,
                           const View<double, 1>& speed) {
    std::size_t n = at.shape[0];
    if (speed.shape[0] != 1) require_shape(speed, {n}, "row_speed_px_s");
    Array<double, 2> basis = field_basis(field, at);
    std::size_t k = basis.shape[1];
    double centre[2] = {(size[0] - 1) / 2, (size[1] - 1) / 2}, unit = std::max(centre[0], centre[1]);
    Array<double, 2> result({n, POLYNOMIAL + 1 + k});
    for (std::size_t i = 0; i < n; i++) {
        double x = (at[i][0] - centre[0]) / unit, y = (at[i][1] - centre[1]) / unit, *out = result[i];
        double own[POLYNOMIAL + 1] = {1, x, y, x * x, x * y, y * y, -speed.data[speed.shape[0] == 1 ? 0 : i]};
        std::copy(basis[i], basis[i] + k, std::copy(own, own + POLYNOMIAL + 1, out));
    }
    return result;
}

Array<double, 1> row_offsets(const RowModel& rows, const View<double, 2>& at, const View<double, 1>& speed) {
    Array<double, 2> terms = row_terms(rows.size, rows.field, at, speed);
    std::size_t n = terms.shape[0], k = terms.shape[1];
    require_shape(rows.mean, {k}, "mean");
    Array<double, 1> result({n});
    for (std::size_t i = 0; i < n; i++)
        for (std::size_t c = 0; c < k; c++) result.data[i] += terms[i][c] * rows.mean.data[c];
    return result;
}

Array<bool, 1> on_one_row(const RowModel& rows, const View<double, 2>& left, const View<double, 2>& right,
                          const View<double, 1>& speed, double scale) {
    std::size_t n = left.shape[0];
    require_shape(left, {n, 2}, "left_px");
    require_shape(right, {n, 2}, "right_px");
    if (speed.shape[0] != 1) require_shape(speed, {n}, "row_speed_px_s");
    Array<bool, 1> result({n});
    for (std::size_t i = 0; i < n; i++) {
        double late = std::abs(speed.data[speed.shape[0] == 1 ? 0 : i]) * rows.std_delay;
        double wide = std::max(GATE * std::hypot(rows.scatter, late), LEAST_GATE_PX);
        result.data[i] = std::abs(right[i][1] - left[i][1]) < scale * std::min(wide, rows.max + GATE * late);
    }
    return result;
}

}  // namespace core
