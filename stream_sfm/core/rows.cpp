// Left-right search along the row: normalised correlation for each corner, with a uniqueness test.

#include "images.hpp"

namespace core {
namespace {

// The window's samples around (u, v) without their mean, and their norm.
template <class T>
float cut(const ImageOf<T>& image, int u, int v, int half, int spacing, float* patch) {
    int side = 2 * half / spacing + 1;
    float mean = 0, squares = 0;
    for (int i = 0; i < side; i++)
        for (int j = 0; j < side; j++) {
            std::size_t row = static_cast<std::size_t>(v - half + spacing * i);
            mean += patch[side * i + j] = static_cast<float>(image.data[row * image.width + u - half + spacing * j]);
        }
    mean /= static_cast<float>(side * side);
    for (int i = 0; i < side * side; i++) {
        patch[i] -= mean;
        squares += patch[i] * patch[i];
    }
    return std::sqrt(squares);
}

// The correlation at d, or where it is a peak, that at the top of the parabola through it and its neighbours. A match between two
// pixels correlates less at both, and its repetition at a whole pixel would seem to lead.
float height_at(const std::vector<float>& y, int d) {
    if (d < 1 || d + 1 >= static_cast<int>(y.size())) return y[d];
    float before = y[d] - y[d - 1], after = y[d] - y[d + 1];
    if (before < 0 || after < 0 || before + after <= 0 || y[d - 1] <= -1 || y[d + 1] <= -1) return y[d];
    return y[d] + (before - after) * (before - after) / (8 * (before + after));
}

}  // namespace

template <class T>
WIDER RowMatches match_along_rows(const ImageOf<T>& left, const ImageOf<T>& right, Pixels points, std::int64_t first,
                            std::int64_t last, const PointRules& rules) {
    const int half = rules.match_radius_px, spacing = rules.match_spacing_px;
    require(half >= 1 && half <= 100 && spacing >= 1 && spacing <= 100, "match_radius_px or match_spacing_px is not within 1 and 100");
    const int side = 2 * half / spacing + 1;
    const float least = static_cast<float>(rules.match_correlation), lead = static_cast<float>(rules.match_lead);
    require(left.height == right.height && left.width == right.width, "left and right image have different sizes");
    require(points.shape[1] == 2, "points_px is not (n, 2)");
    std::size_t n = points.shape[0];
    RowMatches result{{n}, {n}};
    int width = left.width, height = left.height;
    first = std::max<std::int64_t>(first, -width);  // larger ones are outside every row
    last = std::min<std::int64_t>(last, width);
    if (last < first) return result;
    int candidates = static_cast<int>(last - first) + 1, length = candidates + 2 * half;
    std::vector<float> patch(static_cast<std::size_t>(side) * side), strip(length), dot(candidates), sums(length), squares(length);
    for (std::size_t n_th = 0; n_th < n; n_th++) {
        std::int64_t u = points[n_th][0], v = points[n_th][1];
        if (u < half || u >= width - half || v < half || v >= height - half) continue;
        float norm = cut(left, static_cast<int>(u), static_cast<int>(v), half, spacing, patch.data());
        int start = static_cast<int>(u - last);  // centre column of the first candidate in the right image, ascending
        std::fill(dot.begin(), dot.end(), 0.0f);
        std::fill(sums.begin(), sums.end(), 0.0f);
        std::fill(squares.begin(), squares.end(), 0.0f);
        for (int i = 0; i < side; i++) {
            const T* row = right.data + static_cast<std::size_t>(v - half + spacing * i) * width;
            int offset = start - half, inside = std::clamp(-offset, 0, length), end = std::clamp(width - offset, inside, length);
            for (int c = inside; c < end; c++) strip[c] = static_cast<float>(row[offset + c]);
            std::fill(strip.begin(), strip.begin() + inside, static_cast<float>(row[0]));
            std::fill(strip.begin() + end, strip.end(), static_cast<float>(row[width - 1]));
            for (int c = 0; c < length; c++) {
                sums[c] += strip[c];
                squares[c] += strip[c] * strip[c];
            }
            for (int j = 0; j < side; j++) {
                float weight = patch[side * i + j];
                const float* shifted = strip.data() + spacing * j;
                for (int d = 0; d < candidates; d++) dot[d] += weight * shifted[d];
            }
        }
        float top = -2, elsewhere = -1;
        int best = 0;
        for (int d = 0; d < candidates; d++) {
            float sum = 0, square = 0;
            for (int j = 0; j < side; j++) {
                sum += sums[d + spacing * j];
                square += squares[d + spacing * j];
            }
            float variance = std::max(square - sum * sum / static_cast<float>(side * side), 1e-3f);  // a uniform window has a finite correlation
            bool inside = start + d >= half && start + d < width - half;
            dot[d] = inside ? dot[d] / (norm * std::sqrt(variance) + 1e-6f) : -1.0f;
            if (dot[d] > top) {
                top = dot[d];
                best = d;
            }
        }
        for (int d = 0; d < candidates; d++)
            if (std::abs(d - best) > rules.match_neighbours_px) elsewhere = std::max(elsewhere, height_at(dot, d));
        result.disparity.data[n_th] = static_cast<double>(last - best);
        result.unique.data[n_th] = top > least && height_at(dot, best) - elsewhere > lead;
    }
    return result;
}

template decltype(match_along_rows<float>) match_along_rows<float>;
template decltype(match_along_rows<std::uint8_t>) match_along_rows<std::uint8_t>;

}  // namespace core
