// The order in which corners are taken: even coverage before strength.

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>
#include <unordered_map>
#include <vector>

#include "stages.hpp"

namespace core {

Array<std::int64_t, 1> order_of_corners(const Pixels& found, const View<float, 1>& strength, const View<double, 2>& taken,
                                        double cell, double width) {
    std::size_t n = found.shape[0];
    require_shape(found, {n, 2}, "found_px");
    require_shape(strength, {n}, "strength");
    require_shape(taken, {taken.shape[0], 2}, "taken_px");
    require(cell >= 1 && width >= 0 && width < 1e9, "cells have no size");
    const double columns = std::floor(width / cell) + 1;
    auto cell_of = [&](double u, double v) { return std::floor(v / cell) * columns + std::floor(u / cell); };
    std::unordered_map<double, std::int64_t> ranks;  // of a cell: how many points are before the next one
    for (std::size_t i = 0; i < taken.shape[0]; i++) ranks[cell_of(std::max(taken[i][0], 0.0), std::max(taken[i][1], 0.0))]++;
    auto weaker = [&](std::int64_t i) {
        return std::make_tuple(strength.data[i] > 0 ? -strength.data[i] : 0.0f, found[i][1], found[i][0]);
    };
    std::vector<std::int64_t> order(n), rank(n);
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(), [&](std::int64_t a, std::int64_t b) { return weaker(a) < weaker(b); });
    for (std::int64_t i : order) rank[i] = ranks[cell_of(static_cast<double>(found[i][0]), static_cast<double>(found[i][1]))]++;
    std::stable_sort(order.begin(), order.end(), [&](std::int64_t a, std::int64_t b) { return rank[a] < rank[b]; });
    Array<std::int64_t, 1> result({n});
    std::copy(order.begin(), order.end(), result.data.get());
    return result;
}

}  // namespace core
