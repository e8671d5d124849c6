// Images between their pixels; beyond the border the outermost pixels go on. No position, finite or not, reads outside.
#pragma once

#include <algorithm>

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

// A pixel's column or row that may be added to.
inline std::int64_t bounded(std::int64_t at) { return std::clamp<std::int64_t>(at, -1'000'000'000, 1'000'000'000); }

// Of a coordinate along `extent` pixels: the pixel before it, the step to the one after, and the share of that one.
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

// Whether what is between the pixels around (x, y) needs no pixel beyond the border; not for NaN.
template <class T>
inline bool is_inside(const ImageOf<T>& image, float x, float y) {
    return x > 0.01f && y > 0.01f && x < static_cast<float>(image.width - 1) - 0.01f &&
           y < static_cast<float>(image.height - 1) - 0.01f;
}

// Samples at (x, y)[first], and at each `step` after it, of `end`. `inside`: all are.
template <class T>
inline void sample_places(const ImageOf<T>& image, const float* x, const float* y, int first, int end, int step, bool inside,
                          float* out) {
    if (!inside) {
        for (int i = first; i < end; i += step) out[i] = sample(image, x[i], y[i]);
        return;
    }
    for (int i = first; i < end; i += step) {
        int column = static_cast<int>(x[i]), row = static_cast<int>(y[i]);
        float across = x[i] - static_cast<float>(column), down = y[i] - static_cast<float>(row);
        const T* a = image.data + row * static_cast<std::ptrdiff_t>(image.width) + column;
        const T* b = a + image.width;
        float above = as_float(a[0]) + across * (as_float(a[1]) - as_float(a[0])), below = as_float(b[0]) + across * (as_float(b[1]) - as_float(b[0]));
        out[i] = above + down * (below - above);
    }
}

// The k × k samples `spacing` apart around (x, y), row by row.
template <class T>
inline void sample_square(const ImageOf<T>& image, float x, float y, int radius, int spacing, int k, float* out) {
    float left = x - static_cast<float>(radius), top = y - static_cast<float>(radius);
    bool inside = left >= 0.0f && top >= 0.0f && x + static_cast<float>(radius) < static_cast<float>(image.width - 1) &&
                  y + static_cast<float>(radius) < static_cast<float>(image.height - 1);
    if (!inside) {
        for (int i = 0; i < k; i++)
            for (int j = 0; j < k; j++)
                out[i * k + j] = sample(image, left + static_cast<float>(j * spacing), top + static_cast<float>(i * spacing));
        return;
    }
    Between u(left, image.width), v(top, image.height);  // all samples lie alike between their pixels
    for (int i = 0; i < k; i++) {
        const T* upper = image.data + static_cast<std::size_t>(v.before + i * spacing) * image.width + u.before;
        const T* lower = upper + image.width;
        for (int j = 0; j < k; j++) {
            const T *a = upper + j * spacing, *b = lower + j * spacing;
            float above = as_float(a[0]) + u.share * (as_float(a[1]) - as_float(a[0]));
            float below = as_float(b[0]) + u.share * (as_float(b[1]) - as_float(b[0]));
            out[i * k + j] = above + v.share * (below - above);
        }
    }
}

}  // namespace core
