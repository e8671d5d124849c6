// Removes the filters of the rows of a PNG image (PNG specification, third edition, section 9).
#include <cstdlib>

#include "images.hpp"

namespace core {
namespace {

using Byte = std::uint8_t;
constexpr Byte BY_LEFT = 1;  // the filter that OpenCV uses for all rows; they do not depend on each other
enum : std::size_t { TOGETHER = 4 };  // such rows at a time

Byte paeth(int left, int up, int corner) {
    int by_left = std::abs(up - corner), by_up = std::abs(left - corner), by_corner = std::abs(left + up - 2 * corner);
    return static_cast<Byte>(by_left <= by_up && by_left <= by_corner ? left : by_up <= by_corner ? up : corner);
}

// Restores a row of `width` bytes: each is `predict` of the bytes to the left, above, and above left, plus the filtered one.
template <std::size_t PIXEL, class Predict>
void unfilter(const Byte* in, const Byte* up, std::size_t width, Byte* row, Predict&& predict) {
    Byte left[PIXEL]{}, corner[PIXEL]{};
    for (std::size_t j = 0; j < width; j += PIXEL)
        for (std::size_t k = 0; k < PIXEL; k++) {
            row[j + k] = left[k] = static_cast<Byte>(in[j + k] + predict(left[k], up[j + k], corner[k]));
            corner[k] = up[j + k];
        }
}

template <std::size_t PIXEL>
void unfilter(Byte filter, const Byte* in, const Byte* up, std::size_t width, Byte* row) {
    auto by = [&](auto&& predict) { unfilter<PIXEL>(in, up, width, row, predict); };
    if (filter == 0) by([](int, int, int) { return 0; });
    if (filter == 1) by([](int left, int, int) { return left; });
    if (filter == 2) by([](int, int above, int) { return above; });
    if (filter == 3) by([](int left, int above, int) { return (left + above) / 2; });
    if (filter == 4) by(paeth);
}

// Does the same as `unfilter` for TOGETHER rows that are predicted by the bytes to the left.
template <std::size_t PIXEL>
void unfilter_by_left(const Byte* in, std::size_t width, Byte* rows) {
    Byte left[TOGETHER][PIXEL]{};
    for (std::size_t j = 0; j < width; j += PIXEL)
        for (std::size_t k = 0; k < PIXEL; k++)
            for (std::size_t i = 0; i < TOGETHER; i++)
                rows[i * width + j + k] = left[i][k] = static_cast<Byte>(left[i][k] + in[i * (width + 1) + j + k]);
}

}  // namespace

Array<Byte, 2> unfilter_png(View<Byte, 2> filtered, std::size_t pixel) {
    require(pixel == 1 || pixel == 2, "a pixel has neither one byte nor two");
    require(filtered.shape[1] % pixel == 1 % pixel && filtered.shape[1] > 0, "rows are not a filter and whole pixels");
    std::size_t height = filtered.shape[0], width = filtered.shape[1] - 1;
    Array<Byte, 2> rows({height, width}, Unset{});
    Array<Byte, 1> above(width);  // the first row: zeros
    const Byte* up = above.data.get();
    auto by_left = [&](std::size_t first) {
        for (std::size_t i = first; i < first + TOGETHER; i++)
            if (i >= height || filtered[i][0] != BY_LEFT) return false;
        return true;
    };
    for (std::size_t i = 0; i < height; i++) {
        Byte filter = filtered[i][0];
        require(filter <= 4, "a row has an unknown filter");
        if (by_left(i)) {
            (pixel == 1 ? unfilter_by_left<1> : unfilter_by_left<2>)(filtered[i] + 1, width, rows[i]);
            i += TOGETHER - 1;
        } else {
            (pixel == 1 ? unfilter<1> : unfilter<2>)(filter, filtered[i] + 1, up, width, rows[i]);
        }
        up = rows[i];
    }
    return rows;
}

}  // namespace core
