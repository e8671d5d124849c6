// What is drawn over both images, in some of their lines: see frontend/still_check.py.

#include "images.hpp"

namespace core {
namespace {

constexpr std::ptrdiff_t FAR_PX = 2;  // from a pixel to those whose difference to it is an edge

int step(const std::int16_t* at, std::ptrdiff_t to) { return at[0] - at[to]; }
int sign(int number) { return (number > 0) - (number < 0); }

}  // namespace

DrawnEdges drawn_edges(View<std::int16_t, 2> left, View<std::int16_t, 2> last, View<std::int16_t, 2> earlier,
                       View<std::int16_t, 2> right, std::int64_t edge_grey, std::int64_t same_grey, std::int64_t same_step_grey) {
    const std::pair<const View<std::int16_t, 2>*, const char*> others[] = {{&last, "last"}, {&earlier, "earlier"}, {&right, "right"}};
    for (auto [other, name] : others) require_shape(*other, left.shape, name);
    // Whether another line has an edge, too: there it is about as bright, and its step as large or, on a thin line, of
    // the same sign on both sides.
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
    for (std::size_t i = 0; i < left.shape[0]; i++)
        for (std::ptrdiff_t j = FAR_PX; j + FAR_PX < width; j++) {
            const std::int16_t* line = left[i] + j;
            bool steep = std::abs(step(line, -FAR_PX)) >= edge_grey || std::abs(step(line, FAR_PX)) >= edge_grey;
            if (!steep || line[0] < 0) continue;
            found.edges++;
            if (std::abs(line[0] - last[i][j]) >= edge_grey) found.moved++;
            if (has(line, last[i] + j) && has(line, earlier[i] + j) && has(line, right[i] + j)) found.drawn++;
        }
    return found;
}

}  // namespace core
