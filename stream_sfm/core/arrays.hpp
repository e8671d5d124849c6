// Arrays that the stages of the core take and return, and the standard library that stages use. They depend neither on
// Python nor on its lock: bind_*.cpp bind the stages.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

// A stage that is compiled twice, once more for processors with AVX2: it does the same operations in the same order,
// without fused products, so the bytes are the same. GCC does so, and the linker of glibc chooses when the module is
// loaded, which is too early for the address sanitizer.
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__)
#define WIDER __attribute__((target_clones("avx2", "default"), flatten))
#else
#define WIDER
#endif

namespace core {

// Raised in Python as ValueError. It is not inline, because its texts would take a tenth of the compile time of all stages.
[[noreturn]] void refuse(const char* why);
[[noreturn]] void refuse_shape(const char* name, const std::size_t* shape, const std::size_t* wanted, std::size_t n);

template <std::size_t N>
std::size_t row_size(const std::array<std::size_t, N>& shape) {
    return std::accumulate(shape.begin() + 1, shape.end(), std::size_t{1}, std::multiplies<>());
}

// An array in C order, owned elsewhere. `a[i]` is its i-th row along the first axis.
template <class T, std::size_t N>
struct View {
    const T* data;
    std::array<std::size_t, N> shape;

    const T* operator[](std::size_t i) const { return data + i * row_size(shape); }
};
using Vector = View<double, 1>;
using Matrix = View<double, 2>;
using Matrices = View<double, 3>;
using Flags = View<bool, 1>;
using Indices = View<std::int64_t, 1>;
using Pixels = View<std::int64_t, 2>;  // (n, 2): column, row

// The fields of a record under the names that Python uses, and the record's own name in Python.
#define FIELDS(...)                                 \
    auto parts() { return std::tie(__VA_ARGS__); }  \
    static constexpr const char* names = #__VA_ARGS__;
#define RECORD(name, ...)                           \
    static constexpr char record[] = #name;         \
    FIELDS(__VA_ARGS__)

struct Unset {};

// An array that a stage creates, filled with zeros; `Unset` if all of it is written anyway.
template <class T, std::size_t N>
struct Array {
    std::array<std::size_t, N> shape;
    std::unique_ptr<T[]> data;

    template <class... Extents, std::enable_if_t<sizeof...(Extents) == N && (std::is_integral_v<Extents> && ...), int> = 0>
    Array(Extents... extents) : Array(std::array<std::size_t, N>{static_cast<std::size_t>(extents)...}) {}
    explicit Array(const std::array<std::size_t, N>& shape) : shape(shape), data(std::make_unique<T[]>(size())) {}
    Array(const std::array<std::size_t, N>& shape, Unset) : shape(shape), data(new T[size()]) {}
    std::size_t size() const { return shape[0] * row_size(shape); }
    T* operator[](std::size_t i) { return data.get() + i * row_size(shape); }
    const T* operator[](std::size_t i) const { return data.get() + i * row_size(shape); }
    operator View<T, N>() const { return {data.get(), shape}; }  // for as long as the array lives
};

// The rows of n that are `wanted`.
template <class Wanted>
std::vector<std::size_t> rows_where(std::size_t n, const Wanted& wanted) {
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < n; i++)
        if (wanted(i)) rows.push_back(i);
    return rows;
}

// Some rows of an array.
template <class T, std::size_t N>
Array<T, N> rows_of(const View<T, N>& array, const std::vector<std::size_t>& rows) {
    std::array<std::size_t, N> shape = array.shape;
    shape[0] = rows.size();
    Array<T, N> result(shape);
    for (std::size_t k = 0; k < rows.size(); k++) {
        if (rows[k] >= array.shape[0]) refuse("arrays of views have different lengths");
        std::copy_n(array[rows[k]], row_size(shape), result[k]);
    }
    return result;
}
template <class T, std::size_t N>
Array<T, N> rows_of(const Array<T, N>& array, const std::vector<std::size_t>& rows) {
    return rows_of(View<T, N>(array), rows);
}

// Row numbers in the type that Python receives.
inline Array<std::int64_t, 1> numbers(const std::vector<std::size_t>& rows) {
    Array<std::int64_t, 1> result(rows.size());
    std::copy(rows.begin(), rows.end(), result.data.get());
    return result;
}

// Two columns of a matrix, starting with `first`.
inline Array<double, 2> two_columns_of(Matrix array, std::size_t first) {
    Array<double, 2> result(array.shape[0], 2);
    for (std::size_t i = 0; i < array.shape[0]; i++) std::copy_n(array[i] + first, 2, result[i]);
    return result;
}

// An array of the results of `stage(row, out)` for each row of another.
template <class T, std::size_t N, std::size_t M, class Stage>
Array<double, M> each(const View<T, N>& rows, Array<double, M> result, const Stage& stage) {
    for (std::size_t i = 0; i < rows.shape[0]; i++) stage(rows[i], result[i]);
    return result;
}

constexpr std::size_t NONE = std::numeric_limits<std::size_t>::max();

// Finds rows of points by their ids, which ascend; fast if the requests ascend as well.
struct Lookup {
    Indices ids;
    std::size_t at = 0;
    std::int64_t before = std::numeric_limits<std::int64_t>::min();

    std::size_t row(std::int64_t id) {
        if (id < before) at = 0;
        before = id;
        while (at < ids.shape[0] && ids.data[at] < id) at++;
        return at < ids.shape[0] && ids.data[at] == id ? at : NONE;
    }
};

inline void require(bool holds, const char* otherwise) {
    if (!holds) refuse(otherwise);
}

// Raised in Python as NumPy's LinAlgError.
struct NotDefinite : std::runtime_error {
    using std::runtime_error::runtime_error;
};
inline void require_definite(bool holds, const char* otherwise) {
    if (!holds) throw NotDefinite(otherwise);
}

// Requires that the array `name` has the shape `extents`.
template <class T, std::size_t N>
void require_shape(const View<T, N>& array, const std::array<std::size_t, N>& extents, const char* name) {
    if (array.shape != extents) refuse_shape(name, array.shape.data(), extents.data(), N);
}

}  // namespace core
