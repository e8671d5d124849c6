// Products of large matrices.
#pragma once

#include "algebra.hpp"

namespace core {

// Vectors of one number for each term of a sum: that of `column` in `term` is data[term * by_term + column * by_column].
struct Terms {
    const double* data;
    std::size_t by_term, by_column;
};
inline Terms down(Rows rows) { return {rows.data, rows.stride, 1}; }    // terms are the rows of a matrix
inline Terms along(Rows rows) { return {rows.data, 1, rows.stride}; }  // terms are its columns

// What of a product is needed: all, or its lower triangle.
enum class Needed { ALL, LOWER };

// C (p, q) += `by` Aᵀ B of n terms each, `stride` numbers between rows of C. Above the diagonal, some of what is not needed
// may be added, too.
void add_large_product(double by, Terms a, std::size_t p, Terms b, std::size_t q, std::size_t n, Needed needed, double* c,
                       std::size_t stride);

// For tests of their law: A B of A (p, n) and B (n, q), and the lower triangle of Aᵀ A.
Array<double, 2> large_product(Matrix a, Matrix b);
Array<double, 2> large_gram(Matrix a);

// Σ a b over n numbers, in four independent sums.
inline double sum_of_products(const double* a, const double* b, std::size_t n) {
    double sums[4] = {};
    std::size_t whole = n - n % 4;
    for (std::size_t i = 0; i < whole; i += 4)
        for (std::size_t lane = 0; lane < 4; lane++) sums[lane] += a[i + lane] * b[i + lane];
    return std::inner_product(a + whole, a + n, b + whole, sums[0] + sums[1] + (sums[2] + sums[3]));
}

}  // namespace core
