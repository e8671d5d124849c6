// Interpolation of images; beyond the border the outermost pixels repeat. No position, finite or not, reads outside.
#pragma once

#include <cstring>

#include "arrays.hpp"

namespace core {

template <class T>
struct ImageOf {
    const T* data;
    int height, width;
};
using Image = ImageOf<float>;

inline float as_float(float pixel) { return pixel; }
inline float as_float(std::uint8_t pixel) { return static_cast<float>(pixel); }

// A pixel's column or row, limited so that additions cannot overflow.
inline std::int64_t bounded(std::int64_t at) { return std::clamp<std::int64_t>(at, -1'000'000'000, 1'000'000'000); }

// A coordinate along `extent` pixels: the pixel before it, the step to the next one, and the weight of the next one.
struct Between {
    int before, step;
    float share;

    Between(float at, int extent) {
        float last = static_cast<float>(extent - 1);
        float inside = at > 0.0f ? std::min(at, last) : 0.0f;  // NaN: 0
        before = static_cast<int>(inside);
        step = before < extent - 1 ? 1 : 0;
        share = inside - static_cast<float>(before);
    }
};

template <class T>
inline float bilinear(const T* upper, const T* lower, const Between& u, float share_below) {
    const T *a = upper + u.before, *b = lower + u.before;
    float above = as_float(a[0]) + u.share * (as_float(a[u.step]) - as_float(a[0]));
    float below = as_float(b[0]) + u.share * (as_float(b[u.step]) - as_float(b[0]));
    return above + share_below * (below - above);
}

template <class T>
inline float sample(const ImageOf<T>& image, float x, float y) {
    Between u(x, image.width), v(y, image.height);
    const T* upper = image.data + static_cast<std::size_t>(v.before) * image.width;
    return bilinear(upper, upper + v.step * image.width, u, v.share);
}

// Whether interpolation at (x, y) needs no pixel beyond the border; false for NaN.
template <class T>
inline bool is_inside(const ImageOf<T>& image, float x, float y) {
    return x > 0.01f && y > 0.01f && x < static_cast<float>(image.width - 1) - 0.01f &&
           y < static_cast<float>(image.height - 1) - 0.01f;
}

// Samples between pixels, up to `most` in one call. Pixels are gathered first, in pairs of neighbours on a row, so that
// several places are interpolated at a time.
template <class T>
class Sampler {
   public:
    explicit Sampler(std::size_t most) : upper(2 * most), lower(2 * most), rows(most), columns(most), across(most), down(most) {}

    // Samples at n places (x, y). `inside`: whether all of them are inside.
    void at_places(const ImageOf<T>& image, const float* x, const float* y, std::size_t n, bool inside, float* out) {
        if (!inside) {
            for (std::size_t i = 0; i < n; i++) out[i] = sample(image, x[i], y[i]);
            return;
        }
        for (std::size_t i = 0; i < n; i++) {
            columns[i] = static_cast<int>(x[i]), rows[i] = static_cast<int>(y[i]);
            across[i] = x[i] - static_cast<float>(columns[i]), down[i] = y[i] - static_cast<float>(rows[i]);
        }
        for (std::size_t i = 0; i < n; i++) gather(image.data + rows[i] * static_cast<std::ptrdiff_t>(image.width) + columns[i], image.width, 1, i);
        const float *shares_across = across.data(), *shares_down = down.data();
        interpolate(n, [=](std::size_t i) { return shares_across[i]; }, [=](std::size_t i) { return shares_down[i]; }, out);
    }

    // The k × k samples `spacing` apart around (x, y), row by row.
    void square(const ImageOf<T>& image, float x, float y, int radius, int spacing, int k, float* out) {
        float left = x - static_cast<float>(radius), top = y - static_cast<float>(radius);
        bool inside = left >= 0.0f && top >= 0.0f && x + static_cast<float>(radius) < static_cast<float>(image.width - 1) &&
                      y + static_cast<float>(radius) < static_cast<float>(image.height - 1);
        if (!inside) {
            for (int i = 0; i < k; i++)
                for (int j = 0; j < k; j++)
                    out[i * k + j] = sample(image, left + static_cast<float>(j * spacing), top + static_cast<float>(i * spacing));
            return;
        }
        Between u(left, image.width), v(top, image.height);  // the same for all samples
        const T* first = image.data + static_cast<std::size_t>(v.before) * image.width + u.before;
        for (int i = 0; i < k; i++, first += spacing * static_cast<std::ptrdiff_t>(image.width)) {
            std::size_t at = static_cast<std::size_t>(i) * k;
            if (spacing == 2) gather(first, image.width, k, at);  // pairs are contiguous
            else for (int j = 0; j < k; j++) gather(first + j * spacing, image.width, 1, at + j);
        }
        float share_across = u.share, share_down = v.share;
        interpolate(static_cast<std::size_t>(k) * k, [=](std::size_t) { return share_across; }, [=](std::size_t) { return share_down; }, out);
    }

   private:
    // Gathers pairs of pixels from `first` on, and those below them.
    void gather(const T* first, int width, std::size_t pairs, std::size_t at) {
        copy(first, 2 * pairs * sizeof(T), &upper[2 * at]);
        copy(first + width, 2 * pairs * sizeof(T), &lower[2 * at]);
    }

    // Copies some tens of bytes, eight at a time: quicker than memcpy if the compiler does not know their number.
    static void copy(const void* from, std::size_t bytes, void* to) {
        if (bytes < 8) {
            std::memcpy(to, from, bytes);
            return;
        }
        const char* source = static_cast<const char*>(from);
        char* target = static_cast<char*>(to);
        for (std::size_t at = 0; at + 8 < bytes; at += 8) std::memcpy(target + at, source + at, 8);
        std::memcpy(target + bytes - 8, source + bytes - 8, 8);
    }

    template <class Across, class Down>
    void interpolate(std::size_t n, Across share_across, Down share_down, float* out) const {
        const T *a = upper.data(), *b = lower.data();
        for (std::size_t i = 0; i < n; i++) {
            float above = as_float(a[2 * i]) + share_across(i) * (as_float(a[2 * i + 1]) - as_float(a[2 * i]));
            float below = as_float(b[2 * i]) + share_across(i) * (as_float(b[2 * i + 1]) - as_float(b[2 * i]));
            out[i] = above + share_down(i) * (below - above);
        }
    }

    std::vector<T> upper, lower;
    std::vector<int> rows, columns;
    std::vector<float> across, down;
};

}  // namespace core
