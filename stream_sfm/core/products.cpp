// Products of large matrices: copied in blocks that the caches hold, so that the sums of a tile of C stay in registers.
//
// Terms that are zero in a panel are left out: a point has coupling only to the frames that see it, and roots are triangles.

#include <cstring>

#include "products.hpp"

namespace core {
namespace {

constexpr std::size_t TALL = 4, WIDE = 8;  // a tile of C
constexpr std::size_t TERMS = 128;         // of a block: two of its panels are in the first cache, all of B is in the second

// A panel of WIDE columns: their numbers for each term, and the terms that are not zero.
struct Panel {
    const double* numbers;
    const std::uint32_t* used;
    std::size_t count;
};

// Copies of the columns of an operand by panels, with zeros after the last column.
struct Panels {
    std::vector<double> numbers;
    std::vector<std::uint32_t> used;
    std::vector<std::size_t> count;

    explicit Panels(std::size_t columns)
        : numbers((columns + WIDE - 1) / WIDE * WIDE * TERMS), used((columns + WIDE - 1) / WIDE * TERMS), count((columns + WIDE - 1) / WIDE) {}
    Panel at(std::size_t panel) const { return {numbers.data() + panel * WIDE * TERMS, used.data() + panel * TERMS, count[panel]}; }
    void copy(Terms of, std::size_t columns, std::size_t terms) {
        for (std::size_t j = 0, panel = 0; j < columns; j += WIDE, panel++) {
            const double* from = of.data + j * of.by_column;
            double* out = numbers.data() + panel * WIDE * TERMS;
            std::size_t n = std::min<std::size_t>(WIDE, columns - j);
            if (n < WIDE) std::fill(out, out + WIDE * terms, 0.0);
            if (n == WIDE && of.by_column == 1)
                for (std::size_t k = 0; k < terms; k++) std::copy_n(from + k * of.by_term, WIDE, out + WIDE * k);
            else
                for (std::size_t x = 0; x < n; x++)
                    for (std::size_t k = 0; k < terms; k++) out[WIDE * k + x] = from[k * of.by_term + x * of.by_column];
            std::size_t some = 0;
            for (std::size_t k = 0; k < terms; k++) {
                std::uint64_t bits[WIDE], any = 0;
                std::memcpy(bits, out + WIDE * k, sizeof bits);
                for (std::uint64_t each : bits) any |= each;
                used[panel * TERMS + some] = static_cast<std::uint32_t>(k);
                some += any != 0;
            }
            count[panel] = some;
        }
    }
};

// C (TALL, WIDE) += `by` times the products of the `used` terms. Sums stay in registers: one array per vector, or compilers
// spill them.
inline void add_tile(double by, const double* a, const double* b, const std::uint32_t* used, std::size_t n, double* c, std::size_t stride) {
    using At = Four::At;
    Four::Sum s0[TALL] = {}, s1[TALL] = {};
    for (std::size_t k = 0; k < n; k++) {
        const double* left = a + WIDE * used[k];
        const At* right = reinterpret_cast<const At*>(b + WIDE * used[k]);
        for (std::size_t i = 0; i < TALL; i++) {
            s0[i] += left[i] * right[0];
            s1[i] += left[i] * right[1];
        }
    }
    for (std::size_t i = 0; i < TALL; i++, c += stride) {
        At* out = reinterpret_cast<At*>(c);
        out[0] += by * s0[i];
        out[1] += by * s1[i];
    }
}

}  // namespace

WIDER void add_large_product(double by, Terms a, std::size_t p, Terms b, std::size_t q, std::size_t n, Needed needed, double* c,
                             std::size_t stride) {
    const bool is_gram = a.data == b.data && a.by_term == b.by_term && a.by_column == b.by_column;
    Panels right(is_gram ? std::max(p, q) : q), left(WIDE);
    double tile[TALL * WIDE];
    for (std::size_t k = 0; k < n; k += TERMS) {
        std::size_t terms = std::min(TERMS, n - k);
        right.copy({b.data + k * b.by_term, b.by_term, b.by_column}, is_gram ? std::max(p, q) : q, terms);
        for (std::size_t first = 0; first < p; first += WIDE) {
            if (!is_gram) left.copy({a.data + k * a.by_term + first * a.by_column, a.by_term, a.by_column}, std::min(WIDE, p - first), terms);
            Panel of_a = is_gram ? right.at(first / WIDE) : left.at(0);
            for (std::size_t j = 0; j < (needed == Needed::LOWER ? std::min(q, first + WIDE) : q); j += WIDE) {
                Panel of_b = right.at(j / WIDE), least = of_a.count < of_b.count ? of_a : of_b;
                if (least.count == 0) continue;
                for (std::size_t i = first; i < std::min(p, first + WIDE); i += TALL) {
                    double* to = c + i * stride + j;
                    if (i + TALL <= p && j + WIDE <= q) {
                        add_tile(by, of_a.numbers + (i - first), of_b.numbers, least.used, least.count, to, stride);
                        continue;
                    }
                    std::fill(tile, tile + TALL * WIDE, 0.0);  // it reaches beyond C
                    add_tile(by, of_a.numbers + (i - first), of_b.numbers, least.used, least.count, tile, WIDE);
                    for (std::size_t x = 0; x < std::min(p - i, TALL); x++)
                        for (std::size_t y = 0; y < std::min(q - j, WIDE); y++) to[x * stride + y] += tile[WIDE * x + y];
                }
            }
        }
    }
}

Array<double, 2> large_product(Matrix a, Matrix b) {
    std::size_t p = a.shape[0], n = a.shape[1], q = b.shape[1];
    require_shape(b, {n, q}, "b");
    Array<double, 2> result(p, q);
    add_large_product(1.0, along({a.data, n}), p, down({b.data, q}), q, n, Needed::ALL, result.data.get(), q);
    return result;
}

Array<double, 2> large_gram(Matrix a) {
    std::size_t n = a.shape[1];
    Array<double, 2> result(n, n);
    add_large_product(1.0, down({a.data, n}), n, down({a.data, n}), n, a.shape[0], Needed::LOWER, result.data.get(), n);
    for (std::size_t i = 0; i < n; i++) std::fill(result[i] + i + 1, result[i] + n, 0.0);
    return result;
}

}  // namespace core
