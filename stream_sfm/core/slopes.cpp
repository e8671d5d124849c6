// Slopes that show whether both images are the same one (pictures/one_image.py).

#include "images.hpp"

namespace core {

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
