// The strength of corners at each pixel, and new corners where points are missing: even coverage ranks above strength.

#include <cstring>
#include <unordered_map>

#include "images.hpp"

namespace core {
namespace {

enum : int { BLOCK = 5, BESIDE = BLOCK / 2 };  // side of the window of a gradient matrix, a common small size
enum : int { SOBEL_GAIN = 4, WHITE = 255 };    // the strength is that of slopes in units of white

// A row or column beyond the border is mirrored to the one as far inside.
int reflected(int at, int extent) {
    while (at < 0 || at >= extent) at = extent == 1 ? 0 : at < 0 ? -at : 2 * (extent - 1) - at;
    return at;
}

// The latest rows of xx, xy and yy of Sobel slopes, as many as a block has.
template <class T>
class SlopeProducts {
public:
    explicit SlopeProducts(const ImageOf<T>& image)
        : image(image), width(image.width), rows(3 * BLOCK * width), smooth(width + 2), across(width + 2) {}

    void add(int v) {
        const T *above = row(v - 1), *own = row(v), *below = row(v + 1);
        for (std::size_t u = 0; u < width; u++) {
            float a = as_float(above[u]), b = as_float(below[u]);
            smooth[u + 1] = a + 2 * as_float(own[u]) + b;
            across[u + 1] = b - a;
        }
        for (std::vector<float>* of : {&smooth, &across}) {
            (*of)[0] = (*of)[1 + reflected(-1, image.width)];
            (*of)[width + 1] = (*of)[1 + reflected(image.width, image.width)];
        }
        float *xx = product(0, v), *xy = product(1, v), *yy = product(2, v);
        for (std::size_t u = 0; u < width; u++) {
            float x = smooth[u + 2] - smooth[u], y = across[u] + 2 * across[u + 1] + across[u + 2];
            xx[u] = x * x, xy[u] = x * y, yy[u] = y * y;
        }
    }

    // Sums of product `which` over the block's rows around v, which have been added; columns beyond the row are mirrored.
    void sum(int which, int v, float* out) {
        const float* of[BLOCK];
        for (int i = 0; i < BLOCK; i++) of[i] = product(which, reflected(v + i - BESIDE, image.height));
        for (std::size_t u = 0; u < width; u++) out[u] = of[0][u] + of[1][u] + of[2][u] + of[3][u] + of[4][u];
        for (int i = 1; i <= BESIDE; i++) {
            out[-i] = out[reflected(-i, image.width)];
            out[image.width + i - 1] = out[reflected(image.width + i - 1, image.width)];
        }
    }

private:
    const T* row(int v) const { return image.data + static_cast<std::size_t>(reflected(v, image.height)) * width; }
    float* product(int which, int v) { return rows.data() + static_cast<std::size_t>(which * BLOCK + v % BLOCK) * width; }

    const ImageOf<T>& image;
    std::size_t width;
    std::vector<float> rows, smooth, across;
};

// The occupied pixels around a point: a disc, row by row.
class Discs {
public:
    Discs(View<bool, 2> allowed, int radius)
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
    std::vector<int> reach;  // half widths of the disc's rows, from the centre down
};

struct Corner {
    std::int64_t u, v, rank;
    float strength;
};

// Free pixels whose strength is the largest within `reach` and above `least`, row by row.
std::vector<Corner> peaks(const Image& strength, const std::vector<char>& free, int reach, float least) {
    int height = strength.height, width = strength.width, beside = std::min(reach, 1);
    auto row_of = [&](int v) { return strength.data + static_cast<std::size_t>(v) * width; };
    auto is_largest = [&](int u, int v) {
        int first = std::max(u - reach, 0), end = std::min(u + reach, width - 1) + 1;
        for (int row = std::max(v - reach, 0); row <= std::min(v + reach, height - 1); row++)
            if (*std::max_element(row_of(row) + first, row_of(row) + end) > row_of(v)[u]) return false;
        return true;
    };
    std::vector<char> is_peak(width);
    std::vector<Corner> found;
    for (int v = 0; v < height; v++) {
        const float *own = row_of(v), *above = row_of(std::max(v - beside, 0)), *below = row_of(std::min(v + beside, height - 1));
        const char* is_free = free.data() + static_cast<std::size_t>(v) * width;
        for (int u = 0; u < width; u++)
            is_peak[u] = static_cast<char>((own[u] >= above[u]) & (own[u] >= below[u]) & (own[u] > least) & (is_free[u] != 0));
        for (int u = beside; u < width - beside; u++)  // peaks among four neighbours are few enough to be checked one by one
            is_peak[u] &= static_cast<char>((own[u] >= own[u - beside]) & (own[u] >= own[u + beside]));
        const char *at = is_peak.data(), *end = at + width;
        for (; (at = static_cast<const char*>(std::memchr(at, 1, static_cast<std::size_t>(end - at)))); at++)
            if (int u = static_cast<int>(at - is_peak.data()); is_largest(u, v)) found.push_back({u, v, 0, own[u]});
    }
    return found;
}

// Sorts corners into the order in which they are selected. The image is divided into cells. A cell's corners are ranked by
// strength, after the points (m, 2) that are there already; all first ranks come before all second ranks.
void order(std::vector<Corner>& corners, Matrix taken, double cell, double width) {
    const double columns = std::floor(width / cell) + 1;
    auto cell_of = [&](double u, double v) { return std::floor(v / cell) * columns + std::floor(u / cell); };
    std::unordered_map<double, std::int64_t> ranks;  // per cell: the rank of the next point
    for (std::size_t i = 0; i < taken.shape[0]; i++) ranks[cell_of(std::max(taken[i][0], 0.0), std::max(taken[i][1], 0.0))]++;
    std::sort(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) {
        return std::make_tuple(-a.strength, a.v, a.u) < std::make_tuple(-b.strength, b.v, b.u);
    });
    for (Corner& corner : corners) corner.rank = ranks[cell_of(static_cast<double>(corner.u), static_cast<double>(corner.v))]++;
    std::stable_sort(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) { return a.rank < b.rank; });
}

}  // namespace

// The smaller eigenvalue of the gradient matrix (Shi and Tomasi 1994).
template <class T>
WIDER Array<float, 2> corner_strength(const ImageOf<T>& image) {
    require(image.height > 0 && image.width > 0, "the image is empty");
    std::size_t width = static_cast<std::size_t>(image.width);
    Array<float, 2> result({static_cast<std::size_t>(image.height), width}, Unset{});
    SlopeProducts<T> products(image);
    std::vector<float> sums(3 * (width + 2 * BESIDE));
    float* of[3];
    for (std::size_t i = 0; i < 3; i++) of[i] = sums.data() + i * (width + 2 * BESIDE) + BESIDE;
    const float *xx = of[0], *xy = of[1], *yy = of[2];
    const float scale = static_cast<float>(1 / std::pow(SOBEL_GAIN * BLOCK * WHITE, 2));
    for (int v = 0; v < std::min<int>(BESIDE, image.height); v++) products.add(v);
    for (int v = 0; v < image.height; v++) {
        if (v + BESIDE < image.height) products.add(v + BESIDE);
        for (int i = 0; i < 3; i++) products.sum(i, v, of[i]);
        float* out = result[static_cast<std::size_t>(v)];
        for (std::ptrdiff_t u = 0; u < image.width; u++) {
            float a = xx[u - 2] + xx[u - 1] + xx[u] + xx[u + 1] + xx[u + 2], b = xy[u - 2] + xy[u - 1] + xy[u] + xy[u + 1] + xy[u + 2];
            float c = yy[u - 2] + yy[u - 1] + yy[u] + yy[u + 1] + yy[u + 2], half = 0.5f * (a - c);
            out[u] = scale * (0.5f * (a + c) - std::sqrt(half * half + b * b));
        }
    }
    return result;
}
template decltype(corner_strength<float>) corner_strength<float>;
template decltype(corner_strength<std::uint8_t>) corner_strength<std::uint8_t>;

WIDER Array<std::int64_t, 2> new_corners(const Image& strength, View<bool, 2> allowed, Matrix taken, std::int64_t wanted,
                                   double distance, double min_strength, const PointRules& rules) {
    std::size_t width = static_cast<std::size_t>(strength.width), pixels = width * static_cast<std::size_t>(strength.height);
    require(pixels > 0, "the image is empty");
    require_shape(allowed, {pixels / width, width}, "allowed");
    require_shape(taken, {taken.shape[0], 2}, "taken_px");
    require(rules.peak_part >= 1, "peak_part is below 1");
    require(distance > 0 && distance < 1e6, "distance_px is not within 0 and 10⁶");
    std::size_t most = static_cast<std::size_t>(std::clamp<std::int64_t>(wanted, 0, static_cast<std::int64_t>(pixels)));
    if (most == 0) return Array<std::int64_t, 2>(0, 2);
    int radius = static_cast<int>(std::nearbyint(distance));
    Discs discs(allowed, radius);
    auto whole = [](double at) { return static_cast<std::int64_t>(std::clamp(std::nearbyint(at), -1e9, 1e9)); };
    for (std::size_t i = 0; i < taken.shape[0]; i++)
        if (std::isfinite(taken[i][0]) && std::isfinite(taken[i][1])) discs.take(whole(taken[i][0]), whole(taken[i][1]));
    // in a dark image the contrast is low, and so is every response
    std::vector<float> strongest(strength.data, strength.data + width);  // per column, so that the compiler handles four at a time
    for (const float* row = strength.data; row < strength.data + pixels; row += width)
        for (std::size_t u = 0; u < width; u++) strongest[u] = std::max(strongest[u], row[u]);
    double limit = rules.dim_fraction * *std::max_element(strongest.begin(), strongest.end());
    float least = static_cast<float>(std::min(min_strength, limit));
    std::vector<Corner> corners = peaks(strength, discs.free, radius / rules.peak_part, std::max(least, 0.0f));
    double points = static_cast<double>(most + taken.shape[0]);
    double cell = std::max({1.0, rules.cell_distances * distance, std::sqrt(static_cast<double>(pixels) / points)});
    order(corners, taken, cell, static_cast<double>(width));
    std::vector<std::int64_t> chosen;
    for (std::size_t i = 0; i < std::min(corners.size(), rules.candidates * most) && chosen.size() < 2 * most; i++) {
        const Corner& corner = corners[i];
        if (!discs.free[static_cast<std::size_t>(corner.v) * width + static_cast<std::size_t>(corner.u)]) continue;
        chosen.insert(chosen.end(), {corner.u, corner.v});
        discs.take(corner.u, corner.v);
    }
    Array<std::int64_t, 2> result(chosen.size() / 2, 2);
    std::copy(chosen.begin(), chosen.end(), result.data.get());
    return result;
}

}  // namespace core
