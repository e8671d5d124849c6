// New corners where points are missing: even coverage before strength.

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>
#include <unordered_map>
#include <vector>

#include "stages.hpp"

namespace core {
namespace {

// Share of the strongest response in the image above which a pixel always counts as a corner, chosen by hand. An exposure
// cut to a quarter leaves none above a fixed limit.
constexpr double DIM_FRACTION = 0.02;
constexpr int PEAK_FRACTION = 3;      // one of so many of the distance: a corner is the strongest within it
constexpr double MIN_CELL = 2.0;      // distances: a cell has room for one corner at least
constexpr std::size_t CANDIDATES = 12;  // candidates per corner wanted: further ones are weaker and cost time

// Pixels that are taken around a point: a disc, row by row.
class Discs {
public:
    Discs(const View<bool, 2>& allowed, int radius)
        : free(allowed.data, allowed.data + allowed.shape[0] * allowed.shape[1]),
          height(static_cast<std::int64_t>(allowed.shape[0])),
          width(static_cast<std::int64_t>(allowed.shape[1])),
          reach(radius + 1) {
        for (int across = radius, down = 0, error = 0; across >= down; down++) {  // the midpoint circle
            reach[down] = std::max(reach[down], across);
            reach[across] = std::max(reach[across], down);
            error += 2 * down + 1;
            if (error > 0) error -= 2 * across-- - 1;
        }
    }

    void take(std::int64_t u, std::int64_t v) {
        std::int64_t radius = static_cast<std::int64_t>(reach.size()) - 1;
        for (std::int64_t row = std::max<std::int64_t>(v - radius, 0); row <= std::min(v + radius, height - 1); row++) {
            std::int64_t half = reach[static_cast<std::size_t>(std::abs(row - v))];
            std::int64_t first = std::max<std::int64_t>(u - half, 0), last = std::min(u + half, width - 1);
            if (first <= last) std::fill(free.begin() + row * width + first, free.begin() + row * width + last + 1, false);
        }
    }

    std::vector<char> free;

private:
    std::int64_t height, width;
    std::vector<int> reach;  // half widths of the disc's rows, from the middle down
};

struct Corner {
    std::int64_t u, v, rank;
    float strength;
};

// Free pixels whose strength is the largest within `reach` and above `least`, row by row.
std::vector<Corner> peaks(const Image& strength, const std::vector<char>& free, int reach, float least) {
    int height = strength.height, width = strength.width;
    auto row_of = [&](int v) { return strength.data + static_cast<std::size_t>(v) * width; };
    std::vector<float> largest(width);
    std::vector<Corner> found;
    for (int v = 0; v < height; v++) {
        std::copy(row_of(v), row_of(v) + width, largest.begin());
        for (int row = std::max(v - reach, 0); row <= std::min(v + reach, height - 1); row++) {
            const float* other = row_of(row);
            for (int u = 0; u < width; u++) largest[u] = std::max(largest[u], other[u]);
        }
        for (int u = 0; u < width; u++) {
            float own = row_of(v)[u];
            if (!(own > least && own >= largest[u] && free[static_cast<std::size_t>(v) * width + u])) continue;
            auto first = largest.begin() + std::max(u - reach, 0), last = largest.begin() + std::min(u + reach, width - 1) + 1;
            if (own >= *std::max_element(first, last)) found.push_back({u, v, 0, own});
        }
    }
    return found;
}

// The order in which corners are taken. The image is cut into cells. A cell's corners are ranked by strength, after the
// points (m, 2) that are there already; all first ranks come before all second ranks.
void order(std::vector<Corner>& corners, const View<double, 2>& taken, double cell, double width) {
    const double columns = std::floor(width / cell) + 1;
    auto cell_of = [&](double u, double v) { return std::floor(v / cell) * columns + std::floor(u / cell); };
    std::unordered_map<double, std::int64_t> ranks;  // of a cell: how many points are before the next one
    for (std::size_t i = 0; i < taken.shape[0]; i++) ranks[cell_of(std::max(taken[i][0], 0.0), std::max(taken[i][1], 0.0))]++;
    std::sort(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) {
        return std::make_tuple(-a.strength, a.v, a.u) < std::make_tuple(-b.strength, b.v, b.u);
    });
    for (Corner& corner : corners) corner.rank = ranks[cell_of(static_cast<double>(corner.u), static_cast<double>(corner.v))]++;
    std::stable_sort(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) { return a.rank < b.rank; });
}

}  // namespace

Array<std::int64_t, 2> new_corners(const Image& strength, const View<bool, 2>& allowed, const View<double, 2>& taken,
                                   std::int64_t wanted, double distance, double min_strength) {
    std::size_t width = static_cast<std::size_t>(strength.width), pixels = width * static_cast<std::size_t>(strength.height);
    require(pixels > 0, "the image is empty");
    require_shape(allowed, {pixels / width, width}, "allowed");
    require_shape(taken, {taken.shape[0], 2}, "taken_px");
    require(distance > 0 && distance < 1e6, "distance_px is not within 0 and 10⁶");
    std::size_t most = static_cast<std::size_t>(std::clamp<std::int64_t>(wanted, 0, static_cast<std::int64_t>(pixels)));
    if (most == 0) return Array<std::int64_t, 2>({0, 2});
    int radius = static_cast<int>(std::nearbyint(distance));
    Discs discs(allowed, radius);
    auto whole = [](double at) { return static_cast<std::int64_t>(std::clamp(std::nearbyint(at), -1e9, 1e9)); };
    for (std::size_t i = 0; i < taken.shape[0]; i++)
        if (std::isfinite(taken[i][0]) && std::isfinite(taken[i][1])) discs.take(whole(taken[i][0]), whole(taken[i][1]));
    // in a dark image all contrast, and with it every response, is scaled down
    double strongest = *std::max_element(strength.data, strength.data + pixels);
    float least = static_cast<float>(std::min(min_strength, DIM_FRACTION * strongest));
    std::vector<Corner> corners = peaks(strength, discs.free, radius / PEAK_FRACTION, std::max(least, 0.0f));
    double points = static_cast<double>(most + taken.shape[0]);
    double cell = std::max({1.0, MIN_CELL * distance, std::sqrt(static_cast<double>(pixels) / points)});
    order(corners, taken, cell, static_cast<double>(width));
    std::vector<std::int64_t> chosen;
    for (std::size_t i = 0; i < std::min(corners.size(), CANDIDATES * most) && chosen.size() < 2 * most; i++) {
        const Corner& corner = corners[i];
        if (!discs.free[static_cast<std::size_t>(corner.v) * width + static_cast<std::size_t>(corner.u)]) continue;
        chosen.insert(chosen.end(), {corner.u, corner.v});
        discs.take(corner.u, corner.v);
    }
    Array<std::int64_t, 2> result({chosen.size() / 2, 2});
    std::copy(chosen.begin(), chosen.end(), result.data.get());
    return result;
}

}  // namespace core
