// Arrays that the stages of the core take and give. Stages know neither Python nor its lock: module.cpp binds them.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

namespace core {

// An array of another owner, C order. `a[i]` is its i-th row along the first axis.
template <class T, std::size_t N>
struct View {
    const T* data;
    std::array<std::size_t, N> shape;

    std::size_t row_size() const {
        std::size_t size = 1;
        for (std::size_t i = 1; i < N; i++) size *= shape[i];
        return size;
    }
    const T* operator[](std::size_t i) const { return data + i * row_size(); }
};

struct Unset {};

// An array that a stage has made, of zeros; `Unset` where all of it is written anyway.
template <class T, std::size_t N>
struct Array {
    std::array<std::size_t, N> shape;
    std::unique_ptr<T[]> data;

    explicit Array(const std::array<std::size_t, N>& shape) : shape(shape), data(std::make_unique<T[]>(size())) {}
    Array(const std::array<std::size_t, N>& shape, Unset) : shape(shape), data(new T[size()]) {}
    std::size_t size() const { return std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>()); }
    std::size_t row_size() const {
        std::size_t size = 1;
        for (std::size_t i = 1; i < N; i++) size *= shape[i];
        return size;
    }
    T* operator[](std::size_t i) { return data.get() + i * row_size(); }
    View<T, N> view() const { return {data.get(), shape}; }
};

// Some rows of an array.
template <class T, std::size_t N>
Array<T, N> rows_of(const View<T, N>& array, const std::vector<std::size_t>& rows) {
    std::array<std::size_t, N> shape = array.shape;
    shape[0] = rows.size();
    Array<T, N> result(shape);
    for (std::size_t k = 0; k < rows.size(); k++) {
        if (rows[k] >= array.shape[0]) throw std::invalid_argument("arrays of views have different lengths");
        std::copy_n(array[rows[k]], array.row_size(), result[k]);
    }
    return result;
}

// Columns of a matrix: one, or two from one on.
inline Array<double, 1> column_of(const View<double, 2>& array, std::size_t column) {
    Array<double, 1> result({array.shape[0]});
    for (std::size_t i = 0; i < array.shape[0]; i++) result.data[i] = array[i][column];
    return result;
}
inline Array<double, 2> two_columns_of(const View<double, 2>& array, std::size_t first) {
    Array<double, 2> result({array.shape[0], 2});
    for (std::size_t i = 0; i < array.shape[0]; i++) std::copy_n(array[i] + first, 2, result[i]);
    return result;
}

constexpr std::size_t NONE = std::numeric_limits<std::size_t>::max();

// Rows of points by their ids, both ascending; fast where they are asked for in that order.
struct Lookup {
    const View<std::int64_t, 1>& ids;
    std::size_t at = 0;
    std::int64_t before = std::numeric_limits<std::int64_t>::min();

    std::size_t row(std::int64_t id) {
        if (id < before) at = 0;
        before = id;
        while (at < ids.shape[0] && ids.data[at] < id) at++;
        return at < ids.shape[0] && ids.data[at] == id ? at : NONE;
    }
};

// What Python sees as a ValueError.
inline void require(bool holds, const char* otherwise) {
    if (!holds) throw std::invalid_argument(otherwise);
}

// What Python sees as NumPy's LinAlgError.
struct NotDefinite : std::runtime_error {
    using std::runtime_error::runtime_error;
};
inline void require_definite(bool holds, const char* otherwise) {
    if (!holds) throw NotDefinite(otherwise);
}

// Shapes that must agree: `name` has `extents`.
template <class T, std::size_t N>
void require_shape(const View<T, N>& array, const std::array<std::size_t, N>& extents, const char* name) {
    if (array.shape == extents) return;
    std::string text = std::string(name) + " has shape (";
    for (std::size_t i = 0; i < N; i++) text += (i ? ", " : "") + std::to_string(array.shape[i]);
    text += ") in place of (";
    for (std::size_t i = 0; i < N; i++) text += (i ? ", " : "") + std::to_string(extents[i]);
    throw std::invalid_argument(text + ")");
}

}  // namespace core
