// Left-right search along the row: normalised correlation of each corner, with a uniqueness test.

#include "images.hpp"

namespace core {
namespace {

// Half width of the correlation window, px: half of the default patch, as large where the images are of half the size.
constexpr int HALF = 5;
// Between its samples; smoothing leaves neighbours the same noise. As many matches as with all, in a third of the time.
constexpr int SPACING_PX = 2;
constexpr int SIDE = 2 * HALF / SPACING_PX + 1;
// Of the correlation, chosen by hand: higher values refuse blurred or slanted patches, lower ones let wrong matches in,
// most of which alignment and the check of halves refuse.
constexpr float MIN_CORRELATION = 0.75f;
constexpr float MIN_LEAD = 0.06f;       // over the best rival elsewhere on the row
constexpr int NEIGHBOURS_PX = 2;        // of the best match, which are no rivals
constexpr float MIN_VARIANCE = 1e-3f;   // grey², keeps the correlation with a patch of one grey finite

// The window's samples around (u, v) without their mean, and their norm.
template <class T>
float cut(const ImageOf<T>& image, int u, int v, float* patch) {
    float mean = 0, squares = 0;
    for (int i = 0; i < SIDE; i++)
        for (int j = 0; j < SIDE; j++) {
            std::size_t row = static_cast<std::size_t>(v - HALF + SPACING_PX * i);
            mean += patch[SIDE * i + j] = static_cast<float>(image.data[row * image.width + u - HALF + SPACING_PX * j]);
        }
    mean /= SIDE * SIDE;
    for (int i = 0; i < SIDE * SIDE; i++) {
        patch[i] -= mean;
        squares += patch[i] * patch[i];
    }
    return std::sqrt(squares);
}

}  // namespace

template <class T>
RowMatches match_along_rows(const ImageOf<T>& left, const ImageOf<T>& right, Pixels points, std::int64_t first,
                            std::int64_t last) {
    require(left.height == right.height && left.width == right.width, "left and right image have different sizes");
    require(points.shape[1] == 2, "points_px is not (n, 2)");
    std::size_t n = points.shape[0];
    RowMatches result{{n}, {n}};
    int width = left.width, height = left.height;
    first = std::max<std::int64_t>(first, -width);  // farther ones lie outside of every row
    last = std::min<std::int64_t>(last, width);
    if (last < first) return result;
    int candidates = static_cast<int>(last - first) + 1, length = candidates + 2 * HALF;
    std::vector<float> strip(length), dot(candidates), sums(length), squares(length);
    for (std::size_t n_th = 0; n_th < n; n_th++) {
        std::int64_t u = points[n_th][0], v = points[n_th][1];
        if (u < HALF || u >= width - HALF || v < HALF || v >= height - HALF) continue;
        float patch[SIDE * SIDE];
        float norm = cut(left, static_cast<int>(u), static_cast<int>(v), patch);
        int start = static_cast<int>(u - last);  // centre column of the first candidate in the right image, ascending
        std::fill(dot.begin(), dot.end(), 0.0f);
        std::fill(sums.begin(), sums.end(), 0.0f);
        std::fill(squares.begin(), squares.end(), 0.0f);
        for (int i = 0; i < SIDE; i++) {
            const T* row = right.data + static_cast<std::size_t>(v - HALF + SPACING_PX * i) * width;
            int offset = start - HALF, inside = std::clamp(-offset, 0, length), end = std::clamp(width - offset, inside, length);
            for (int c = inside; c < end; c++) strip[c] = static_cast<float>(row[offset + c]);
            std::fill(strip.begin(), strip.begin() + inside, static_cast<float>(row[0]));
            std::fill(strip.begin() + end, strip.end(), static_cast<float>(row[width - 1]));
            for (int c = 0; c < length; c++) {
                sums[c] += strip[c];
                squares[c] += strip[c] * strip[c];
            }
            for (int j = 0; j < SIDE; j++) {
                float weight = patch[SIDE * i + j];
                const float* shifted = strip.data() + SPACING_PX * j;
                for (int d = 0; d < candidates; d++) dot[d] += weight * shifted[d];
            }
        }
        float top = -2, rival = -1;
        int best = 0;
        for (int d = 0; d < candidates; d++) {
            float sum = 0, square = 0;
            for (int j = 0; j < SIDE; j++) {
                sum += sums[d + SPACING_PX * j];
                square += squares[d + SPACING_PX * j];
            }
            float variance = std::max(square - sum * sum / (SIDE * SIDE), MIN_VARIANCE);
            bool inside = start + d >= HALF && start + d < width - HALF;
            dot[d] = inside ? dot[d] / (norm * std::sqrt(variance) + 1e-6f) : -1.0f;
            if (dot[d] > top) {
                top = dot[d];
                best = d;
            }
        }
        for (int d = 0; d < candidates; d++)
            if (std::abs(d - best) > NEIGHBOURS_PX) rival = std::max(rival, dot[d]);
        result.disparity.data[n_th] = static_cast<double>(last - best);
        result.unique.data[n_th] = top > MIN_CORRELATION && top - rival > MIN_LEAD;
    }
    return result;
}

template decltype(match_along_rows<float>) match_along_rows<float>;
template decltype(match_along_rows<std::uint8_t>) match_along_rows<std::uint8_t>;

}  // namespace core
