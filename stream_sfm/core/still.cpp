// Edges that are drawn over both images (frontend/still_check.py), and slopes that show whether both images are the same
// one (frontend/image_checks.py).

#include "images.hpp"

namespace core {
namespace {

constexpr std::ptrdiff_t FAR_PX = 2;  // from a pixel to those that it is compared with for an edge

int step(const std::int16_t* at, std::ptrdiff_t to) { return at[0] - at[to]; }
int sign(int number) { return (number > 0) - (number < 0); }

}  // namespace

WIDER DrawnEdges drawn_edges(View<std::int16_t, 2> left, View<std::int16_t, 2> last, View<std::int16_t, 2> earlier,
                       View<std::int16_t, 2> right, std::int64_t edge_grey, std::int64_t same_grey, std::int64_t same_step_grey) {
    const std::pair<const View<std::int16_t, 2>*, const char*> others[] = {{&last, "last"}, {&earlier, "earlier"}, {&right, "right"}};
    for (auto [other, name] : others) require_shape(*other, left.shape, name);
    // Whether another line has the same edge: about as bright there, with a step as large or, on a thin line, of the same
    // sign on both sides.
    auto has = [&](const std::int16_t* line, const std::int16_t* other) {
        if (std::abs(line[0] - other[0]) > same_grey) return false;
        int before = step(line, -FAR_PX), after = step(line, FAR_PX);
        int other_before = step(other, -FAR_PX), other_after = step(other, FAR_PX);
        auto as_large = [&](int a, int b) { return std::abs(a) >= edge_grey && std::abs(a - b) <= same_step_grey; };
        auto alike = [&](int a, int b) { return std::abs(a) >= edge_grey && std::abs(b) >= edge_grey && sign(a) == sign(b); };
        return as_large(before, other_before) || as_large(after, other_after) ||
               (alike(before, other_before) && alike(after, other_after) && sign(before) == sign(after));
    };
    DrawnEdges found{0, 0, 0};
    std::ptrdiff_t width = static_cast<std::ptrdiff_t>(left.shape[1]);
    std::vector<std::int16_t> is_edge(left.shape[1]);
    std::int16_t least = static_cast<std::int16_t>(std::min<std::int64_t>(edge_grey, 256));  // no edge is larger
    auto is_steep = [=](std::int16_t step) { return (step >= least) | (step <= -least); };
    for (std::size_t i = 0; i < left.shape[0]; i++) {
        const std::int16_t* line = left[i];
        for (std::ptrdiff_t j = FAR_PX; j + FAR_PX < width; j++) {  // eight at a time
            std::int16_t before = line[j] - line[j - FAR_PX], after = line[j + FAR_PX] - line[j];
            is_edge[j] = (line[j] >= 0) & (is_steep(before) | is_steep(after));
        }
        for (std::ptrdiff_t j = FAR_PX; j + FAR_PX < width; j++) {
            if (!is_edge[j]) continue;
            found.edges++;
            found.moved += std::abs(line[j] - last[i][j]) >= edge_grey;
            // the rarest condition first
            found.drawn += has(line + j, right[i] + j) && has(line + j, earlier[i] + j) && has(line + j, last[i] + j);
        }
    }
    return found;
}

WIDER SameSlopes same_slopes(const ImageOf<std::uint8_t>& left, const ImageOf<std::uint8_t>& right, std::int64_t every,
                             std::int64_t slope_grey, std::int64_t same_grey) {
    require(left.height == right.height && left.width == right.width, "left and right image have different sizes");
    require(every >= 1, "spacing_px is below 1");
    const int slope = static_cast<int>(std::clamp<std::int64_t>(slope_grey, 0, 256)), most = static_cast<int>(std::clamp<std::int64_t>(same_grey, -1, 256));
    SameSlopes found{0, 0};
    for (std::int64_t v = every / 2; v < left.height; v += every) {
        const std::uint8_t *one = left.data + v * left.width, *other = right.data + v * left.width;
        int slopes = 0, same = 0;
        for (int u = 1; u + 1 < left.width; u++) {
            int is_slope = std::abs(one[u + 1] - one[u - 1]) >= slope;
            slopes += is_slope;
            same += is_slope & (std::abs(one[u] - other[u]) <= most);
        }
        found.slopes += slopes, found.same += same;
    }
    return found;
}

}  // namespace core
