// The share of the last image in the current one, from patches of the same points (pictures/ghosts.py).

#include "images.hpp"

namespace core {
namespace {

constexpr int RADIUS_PX = PATCH_RADIUS_PX;
constexpr int SIDE = 2 * RADIUS_PX + 1, WIDE = SIDE + 2, K = SIDE * SIDE;
constexpr int CHANGES = 11;  // of a patch between two frames
constexpr int VIEWS = 5;             // of each point

void centre(float* samples, int n) {
    double sum = 0;
    for (int i = 0; i < n; i++) sum += samples[i];
    float mean = static_cast<float>(sum / n);
    for (int i = 0; i < n; i++) samples[i] -= mean;
}

// The possible changes of a patch between two frames, (CHANGES, K): light; the patch; its slopes, and these times x and y;
// its second derivatives. They follow from the samples of the patch and those around it, which are centred here.
void put_changes(float* wide, float* changes) {
    centre(wide, WIDE * WIDE);
    for (int i = 0, at = 0; i < SIDE; i++)
        for (int j = 0; j < SIDE; j++, at++) {
            const float *above = wide + i * WIDE + j + 1, *own = above + WIDE, *below = own + WIDE;
            float x = static_cast<float>(j - RADIUS_PX), y = static_cast<float>(i - RADIUS_PX);
            float dx = own[1] - own[-1], dy = below[0] - above[0];
            float all[CHANGES] = {1.0f, own[0], dx, dy, dx * x, dx * y, dy * x, dy * y,
                                  own[-1] + own[1] - 2 * own[0], above[0] + below[0] - 2 * own[0],
                                  below[1] + above[-1] - below[-1] - above[1]};
            for (int n = 0; n < CHANGES; n++) changes[n * K + at] = all[n];
        }
}

// Subtracts from views of a patch what its possible changes explain.
struct Explained {
    float changes[CHANGES][K];
    double gram[CHANGES * CHANGES], scale[CHANGES];

    Explained(float* wide, double least_square) {
        put_changes(wide, changes[0]);
        for (int n = 0; n < CHANGES; n++)
            for (int m = 0; m <= n; m++) gram[n * CHANGES + m] = dot(changes[n], changes[m], K);
        for (int n = 0; n < CHANGES; n++) scale[n] = 1 / std::sqrt(std::max(gram[n * CHANGES + n], least_square));
        for (int n = 0; n < CHANGES; n++)  // changes may be linearly dependent, as in a patch with one straight edge
            for (int m = 0; m <= n; m++) gram[n * CHANGES + m] = gram[n * CHANGES + m] * scale[n] * scale[m] + (n == m ? 1e-6 : 0.0);
        require(factor_positive(gram, CHANGES), "a patch is not finite");
    }

    // The products of each change with a view.
    void put_parts(const float* view, double* parts) const {
        for (int n = 0; n < CHANGES; n++) parts[n] = scale[n] * dot(changes[n], view, K);
    }

    void take_out(float* view) const {
        double parts[CHANGES];
        put_parts(view, parts);
        solve_factored(gram, parts, CHANGES);
        for (int n = 0; n < CHANGES; n++) {
            float part = static_cast<float>(scale[n] * parts[n]);
            for (int i = 0; i < K; i++) view[i] -= part * changes[n][i];
        }
    }
};

}  // namespace

WIDER Array<double, 2> ghost_sums(const ImageOf<std::uint8_t>& now, const ImageOf<std::uint8_t>& last, const ImageOf<std::uint8_t>& earlier,
                            Matrix now_px, Matrix last_px, Matrix earlier_px, double noise_grey, double least_square) {
    std::size_t n = now_px.shape[0];
    for (const Matrix& at : {now_px, last_px, earlier_px}) require_shape(at, {n, 2}, "positions");
    for (const auto* image : {&now, &last, &earlier}) require(n == 0 || (image->height > 0 && image->width > 0), "an image is empty");
    Array<double, 2> sums(2, 5);
    Sampler<std::uint8_t> sampler(WIDE * WIDE);
    float wide[WIDE * WIDE], left[VIEWS][K];
    for (std::size_t i = 0; i < n; i++) {
        const double *here = now_px[i], *there = last_px[i];
        const double opposite[2] = {2 * there[0] - here[0], 2 * there[1] - here[1]};
        const std::pair<const ImageOf<std::uint8_t>*, const double*> views[VIEWS] = {
            {&now, here}, {&now, there}, {&last, here}, {&last, opposite}, {&last, there}};
        auto cut = [&](const ImageOf<std::uint8_t>& image, const double* at, int radius, float* out) {
            sampler.square(image, static_cast<float>(at[0]), static_cast<float>(at[1]), radius, 1, 2 * radius + 1, out);
        };
        cut(earlier, earlier_px[i], RADIUS_PX + 1, wide);
        Explained explained(wide, least_square);
        for (int v = 0; v < VIEWS; v++) {
            cut(*views[v].first, views[v].second, RADIUS_PX, left[v]);
            centre(left[v], K);
            explained.take_out(left[v]);
        }
        const float *seen = left[0], *later = left[1], *past = left[2];
        double weight = 1 / (dot(seen, seen, K) / K + noise_grey * noise_grey), both = dot(seen, past, K);
        double s = weight * dot(past, past, K);
        double shares[2] = {weight * (both - dot(seen, left[3], K)), weight * (both - dot(left[4], later, K))};
        for (int control = 0; control < 2; control++) {
            double p = shares[control], of_patch[5] = {p, s, p * p, p * s, s * s};
            for (int j = 0; j < 5; j++) sums[control][j] += of_patch[j];
        }
    }
    return sums;
}

}  // namespace core
