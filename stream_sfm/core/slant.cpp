// The slant of a new point's surface, from the shear between its left and right patch.
//
// On a plane the inverse depth is affine in the image, and so is the disparity: d + a·δu + b·δv around a corner. Each
// corner is aligned by inverse compositional Gauss-Newton on (d, a, b, row) (Baker and Matthews 2004), with a Gaussian
// prior on the slopes, so that a patch without enough texture keeps facing the camera. A wrong slant biases the disparity
// for as long as the point is followed: the walls of a corridor shift by a third of a pixel.

#include "images.hpp"

namespace core {
namespace {

// A left patch of k × k samples: grey values of mean zero, and their derivatives (4, k²) by disparity, slopes and row.
template <class T>
void cut(const ImageOf<T>& image, std::int64_t u, std::int64_t v, int radius, int spacing, int k, float* grey, float* by_parameter) {
    int k2 = k * k;
    auto pixel = [&](std::int64_t column, std::int64_t row) {
        std::int64_t x = std::clamp<std::int64_t>(column, 0, image.width - 1), y = std::clamp<std::int64_t>(row, 0, image.height - 1);
        return as_float(image.data[y * image.width + x]);
    };
    double mean = 0;
    for (int i = 0; i < k; i++)
        for (int j = 0; j < k; j++) {
            int du = spacing * j - radius, dv = spacing * i - radius, at = i * k + j;
            std::int64_t x = u + du, y = v + dv;
            mean += grey[at] = pixel(x, y);
            float by_u = 0.5f * (pixel(x + 1, y) - pixel(x - 1, y)), by_v = 0.5f * (pixel(x, y + 1) - pixel(x, y - 1));
            by_parameter[at] = -by_u;
            by_parameter[k2 + at] = -by_u * static_cast<float>(du);
            by_parameter[2 * k2 + at] = -by_u * static_cast<float>(dv);
            by_parameter[3 * k2 + at] = by_v;
        }
    mean /= k2;
    for (int at = 0; at < k2; at++) grey[at] -= static_cast<float>(mean);
}

}  // namespace

std::vector<std::size_t> slanted_rows(Matrix slopes) {
    return rows_where(slopes.shape[0], [&](std::size_t i) { return slopes[i][0] != 0 || slopes[i][1] != 0; });
}

template <class T>
Array<double, 2> disparity_slopes(const ImageOf<T>& left, const ImageOf<T>& right, Pixels points, Matrix right_px,
                                  int radius, int spacing, double std_grey, const PointRules& rules) {
    std::size_t n = points.shape[0];
    require(points.shape[1] == 2, "points_px is not (n, 2)");
    require_shape(right_px, {n, 2}, "right_px");
    require(radius >= 1 && radius <= 1000, "radius_px is not within 1 and 1000");
    require(n == 0 || (left.height > 0 && left.width > 0 && right.height > 0 && right.width > 0), "an image is empty");
    Array<double, 2> slopes(n, 2);
    int k = 2 * radius / spacing + 1, k2 = k * k;
    const double variance = std_grey * std_grey, of_slope = variance / (rules.std_slope * rules.std_slope);
    // Disparity and row have no prior; 1e-6/px² keeps the matrix regular.
    const double prior[4] = {variance * 1e-6, of_slope, of_slope, variance * 1e-6};
    std::vector<float> grey(k2), by_parameter(4 * k2), there(k2), at_u(k2), at_v(k2);
    Sampler<T> sampler(k2);
    for (std::size_t i = 0; i < n; i++) {
        std::int64_t u = bounded(points[i][0]), v = bounded(points[i][1]);
        cut(left, u, v, radius, spacing, k, grey.data(), by_parameter.data());
        double h[16], cov[16];
        for (int a = 0; a < 4; a++)
            for (int b = a; b < 4; b++) {
                double sum = dot(by_parameter.data() + a * k2, by_parameter.data() + b * k2, k2);
                h[4 * a + b] = h[4 * b + a] = sum + (a == b ? prior[a] : 0.0);
            }
        double ridge = DAMPING * (h[0] + h[5] + h[10] + h[15]);
        for (int a = 0; a < 4; a++) h[5 * a] += ridge;
        invert_positive<4>(h, cov);
        double x = static_cast<double>(u), y = static_cast<double>(v);
        double p[4] = {x - right_px[i][0], 0, 0, right_px[i][1] - y};
        for (int step = 0; step < rules.slant_steps; step++) {
            double mean = 0, g[4];
            bool inside = true;
            auto place = [&](int row, int column, int at) {
                double du = spacing * column - radius, dv = spacing * row - radius;
                at_u[at] = static_cast<float>(x + du - (p[0] + p[1] * du + p[2] * dv));
                at_v[at] = static_cast<float>(y + dv + p[3]);
                return is_inside(right, at_u[at], at_v[at]);
            };
            for (int row : {0, k - 1})
                for (int column : {0, k - 1}) inside = place(row, column, 0) && inside;
            for (int row = 0; row < k; row++)
                for (int column = 0; column < k; column++) place(row, column, row * k + column);
            sampler.at_places(right, at_u.data(), at_v.data(), k2, inside, there.data());
            for (int at = 0; at < k2; at++) mean += there[at];
            mean /= k2;
            for (int at = 0; at < k2; at++) there[at] -= static_cast<float>(mean);
            // of the left exposure over the right one
            double gain = dot(grey.data(), there.data(), k2) / (dot(there.data(), there.data(), k2) + 1.0);  // grey²: finite if uniform
            for (int at = 0; at < k2; at++) there[at] = grey[at] - static_cast<float>(gain) * there[at];
            for (int a = 0; a < 4; a++) g[a] = dot(by_parameter.data() + a * k2, there.data(), k2);
            g[1] -= prior[1] * p[1];
            g[2] -= prior[2] * p[2];
            for (int a = 0; a < 4; a++)
                for (int b = 0; b < 4; b++) p[a] += cov[4 * a + b] * g[b];
        }
        double determinant = cov[5] * cov[10] - cov[6] * cov[9];
        double chi2 = (p[1] * p[1] * cov[10] - 2 * p[1] * p[2] * cov[6] + p[2] * p[2] * cov[5]) / (determinant * variance);
        bool sane = std::max(std::fabs(p[1]), std::fabs(p[2])) < rules.max_slope &&
                    std::fabs(x - p[0] - right_px[i][0]) < rules.max_slant_shift_px;
        if (sane && chi2 > rules.significant_slope) {
            slopes[i][0] = p[1];
            slopes[i][1] = p[2];
        }
    }
    return slopes;
}

template decltype(disparity_slopes<float>) disparity_slopes<float>;
template decltype(disparity_slopes<std::uint8_t>) disparity_slopes<std::uint8_t>;

}  // namespace core
