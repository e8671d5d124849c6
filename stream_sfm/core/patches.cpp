// Anchored templates: warped to the current view and found in the current image; docs/mathematics.md, section 3.
//
// The search is inverse compositional Gauss-Newton (Baker and Matthews 2004) over a patch's position and the gain and
// offset of its grey values, because exposures differ between the cameras and from frame to frame. Pixels near the rim
// have less weight: there the warp is less accurate, and other surfaces may begin.

#include "images.hpp"

#include <numeric>

namespace core {
namespace {

enum { PARAMETERS = 4 };  // fitted to each patch: position, gain, offset

void require_size(int px, const char* otherwise) { require(px >= 1 && px <= 1000, otherwise); }

int samples_across(int radius, int spacing) {
    require_size(radius, "radius_px is not within 1 and 1000");
    require_size(spacing, "spacing_px is not within 1 and 1000");
    return 2 * radius / spacing + 1;
}

// Slopes along u and v and grey values (3, k²) of the square `grey` (side, side), whose pixels are one pixel apart. Each
// has a weighted mean of zero. Returns the mean grey value.
float columns_of(const float* grey, int side, int k, int spacing, const float* weights, float* columns) {
    int k2 = k * k;
    for (int i = 0; i < k; i++)
        for (int j = 0; j < k; j++) {
            const float* at = grey + (1 + spacing * i) * side + 1 + spacing * j;
            columns[i * k + j] = 0.5f * (at[1] - at[-1]);
            columns[k2 + i * k + j] = 0.5f * (at[side] - at[-side]);
            columns[2 * k2 + i * k + j] = at[0];
        }
    float mean = 0;
    for (int c = 0; c < 3; c++) {
        float* column = columns + c * k2;
        mean = static_cast<float>(dot(column, weights, k2) / k2);
        for (int i = 0; i < k2; i++) column[i] -= mean;
    }
    return mean;
}

// The pixels within `reach` of a patch's centre that slopes and values of samples `spacing` apart need: their offsets from
// the centre, and their places in the square (side, side).
struct Needed {
    std::vector<float> u, v;
    std::vector<int> at;

    Needed(int reach, int spacing) {
        for (int i = 0; i <= 2 * reach; i++) {
            bool of_samples = (i - 1) % spacing == 0;  // these rows need the neighbours as well
            for (int j = of_samples ? 0 : 1; j <= 2 * reach; j += of_samples ? 1 : spacing) {
                u.push_back(static_cast<float>(j - reach));
                v.push_back(static_cast<float>(i - reach));
                at.push_back(i * (2 * reach + 1) + j);
            }
        }
    }
};

// Samples the stored patch (side, side) at the places of the `needed` pixels of the current patch, whose warp is
// δ = W u / (1 + h·u), with W above h in `warp` (3, 2). `room` (3 n,): for places and samples.
template <class T>
void warp(Sampler<T>& sampler, const ImageOf<T>& stored, const double* warp, int reach, const Needed& needed, float* room, float* grey) {
    float w[6], middle = static_cast<float>(stored.width / 2);
    for (int i = 0; i < 6; i++) w[i] = static_cast<float>(warp[i]);
    std::size_t n = needed.at.size();
    float *x = room, *y = x + n, *samples = y + n;
    auto place = [&](float u, float v, float& x, float& y) {
        float nearer = 1.0f / (1.0f + w[4] * u + w[5] * v);
        x = middle + (w[0] * u + w[1] * v) * nearer;
        y = middle + (w[2] * u + w[3] * v) * nearer;
        return nearer > 0.0f && is_inside(stored, x, y);
    };
    bool inside = true;  // a square's image is convex
    for (int v : {-reach, reach})
        for (int u : {-reach, reach}) inside = place(static_cast<float>(u), static_cast<float>(v), x[0], y[0]) && inside;
    for (std::size_t i = 0; i < n; i++) place(needed.u[i], needed.v[i], x[i], y[i]);
    sampler.at_places(stored, x, y, n, inside, samples);
    for (std::size_t i = 0; i < n; i++) grey[needed.at[i]] = samples[i];
}

// Weights (k²,) of the samples, with mean 1.
Array<float, 1> sample_weights(int radius, int spacing, double width) {
    int k = samples_across(radius, spacing);
    std::vector<double> across(k);
    double mean = 0;
    for (int i = 0; i < k; i++) {
        double offset = (i * spacing - radius) / (width * radius);
        mean += across[i] = std::exp(-0.5 * offset * offset);
    }
    mean /= k;
    Array<float, 1> weights(static_cast<std::size_t>(k) * k);
    for (int i = 0; i < k; i++)
        for (int j = 0; j < k; j++) weights.data[i * k + j] = static_cast<float>(across[i] * across[j] / (mean * mean));
    return weights;
}

}  // namespace

template <class T>
void store_patches(T* stored, const std::array<std::size_t, 3>& shape, const ImageOf<T>& image, Pixels points,
                   Indices slots) {
    std::size_t n = slots.shape[0], side = shape[1];
    require(shape[2] == side && side % 2 == 1, "stored patches are not squares with a middle");
    require(points.shape[0] == n && points.shape[1] == 2, "points_px is not (n, 2) with a slot for each point");
    require(n == 0 || (image.height > 0 && image.width > 0), "the image is empty");
    for (std::size_t i = 0; i < n; i++)
        require(slots.data[i] >= 0 && static_cast<std::size_t>(slots.data[i]) < shape[0], "a slot is not one of the stored patches");
    std::int64_t half = static_cast<std::int64_t>(side) / 2;
    for (std::size_t i = 0; i < n; i++) {
        T* patch = stored + slots.data[i] * side * side;
        std::int64_t left = bounded(points[i][0]) - half, top = bounded(points[i][1]) - half;
        bool inside = left >= 0 && left + 2 * half < image.width;
        for (std::size_t row = 0; row < side; row++, patch += side) {
            std::int64_t v = std::clamp<std::int64_t>(top + static_cast<std::int64_t>(row), 0, image.height - 1);
            const T* pixels = image.data + v * image.width;
            if (inside) {
                std::copy(pixels + left, pixels + left + side, patch);
                continue;
            }
            for (std::size_t column = 0; column < side; column++)
                patch[column] = pixels[std::clamp<std::int64_t>(left + static_cast<std::int64_t>(column), 0, image.width - 1)];
        }
    }
}

template <class T>
WIDER Patches warp_patches(View<T, 3> stored, Indices slots, Matrices warps, int radius, int spacing, const TemplateRules& rules) {
    int k = samples_across(radius, spacing), k2 = k * k, reach = radius + 1, side = 2 * reach + 1;
    std::size_t n = slots.shape[0], samples = static_cast<std::size_t>(k2);
    require(stored.shape[1] == stored.shape[2] && stored.shape[1] % 2 == 1, "stored patches are not squares with a middle");
    require_shape(warps, {n, 3, 2}, "warps");
    for (std::size_t i = 0; i < n; i++)
        require(slots.data[i] >= 0 && static_cast<std::size_t>(slots.data[i]) < stored.shape[0], "a slot is not one of the stored patches");
    Array<float, 1> weights = sample_weights(radius, spacing, rules.weights_width);
    Patches result{{n, 3, samples}, {n, 3, 3}, {n}};
    Needed needed(reach, spacing);
    std::vector<float> grey(static_cast<std::size_t>(side) * side), room(3 * needed.at.size()), columns(3 * samples), weighted(3 * samples);
    Sampler<T> sampler(needed.at.size());
    int extent = static_cast<int>(stored.shape[1]);
    for (std::size_t i = 0; i < n; i++) {
        warp(sampler, ImageOf<T>{stored[slots.data[i]], extent, extent}, warps[i], reach, needed, room.data(), grey.data());
        result.level.data[i] = columns_of(grey.data(), side, k, spacing, weights.data.get(), columns.data());
        for (int c = 0; c < 3; c++)
            for (int j = 0; j < k2; j++) weighted[c * k2 + j] = columns[c * k2 + j] * weights.data[j];
        double *information = result.information[i], inverse[9];
        for (int a = 0; a < 3; a++)
            for (int b = a; b < 3; b++)
                information[3 * a + b] = information[3 * b + a] = dot(columns.data() + a * k2, weighted.data() + b * k2, k2);
        double ridge = 1e-6 * (information[0] + information[4] + information[8]) + 1e-3;  // grey²: invertible without texture
        for (int a = 0; a < 3; a++) information[4 * a] += ridge;
        invert3(information, inverse);
        float* rows = result.inverse[i];
        for (int a = 0; a < 3; a++) {
            float x = static_cast<float>(inverse[3 * a]), y = static_cast<float>(inverse[3 * a + 1]), z = static_cast<float>(inverse[3 * a + 2]);
            for (int j = 0; j < k2; j++) rows[a * k2 + j] = x * weighted[j] + y * weighted[k2 + j] + z * weighted[2 * k2 + j];
        }
    }
    return result;
}

// Information about position, gain and offset eliminated.
Array<double, 3> gradient_matrices(Matrices information, int spacing) {
    std::size_t n = information.shape[0];
    require_shape(information, {n, 3, 3}, "information");
    require_size(spacing, "spacing_px is not within 1 and 1000");
    Array<double, 3> result(n, 2, 2);
    for (std::size_t i = 0; i < n; i++)
        for (int a = 0; a < 2; a++)
            for (int b = 0; b < 2; b++) {
                const double* of = information[i];
                result[i][2 * a + b] = spacing * spacing * (of[3 * a + b] - of[3 * a + 2] * of[3 * b + 2] / of[8]);
            }
    return result;
}

// Gain and offset of an image relative to the previous one, from mean levels of patches `before` and `now`: the line through
// pairs of patches that are half of all apart in rank, eq. (15a). Levels are used because contrast also changes with the
// distance. They are exactly 1 and 0 if the difference is too small for a change of the exposure.
std::array<double, 2> change_of_exposure(const std::vector<double>& before, const std::vector<double>& now, const TemplateRules& rules) {
    const std::array<double, 2> none{1, 0};
    std::size_t half = before.size() / 2;
    if (half < rules.exposure_views) return none;
    std::vector<std::size_t> order(before.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return before[i] < before[j]; });
    std::vector<double> gains, offsets;
    for (std::size_t k = 0; k + half < order.size(); k++) {
        double apart = before[order[k + half]] - before[order[k]];
        if (apart > 0) gains.push_back((now[order[k + half]] - now[order[k]]) / apart);
    }
    if (gains.size() < rules.exposure_views) return none;
    double gain = median(std::move(gains));
    if (!(gain > 1 / rules.max_gain && gain < rules.max_gain)) return none;
    for (std::size_t i = 0; i < before.size(); i++) offsets.push_back(now[i] - gain * before[i]);
    double offset = median(std::move(offsets));
    for (std::size_t quarter : {half / 2, half + half / 2}) {
        double level = before[order[quarter]];
        if (std::fabs(gain * level + offset - level) >= rules.same_level * std::fabs(level)) return {gain, offset};
    }
    return none;
}

// The gains that patches have in common beside the exposures, most frequent ones first: light on a part of the scene and
// aged templates each have their own. With a single gain for all, tracks of the minority would end.
std::vector<double> gains_in_common(std::vector<double> gains, const TemplateRules& rules) {
    std::vector<double> common;
    do {
        common.push_back(median(gains));
        auto is_alike = [&](double gain) { return std::fabs(std::log(gain / common.back())) < rules.same_exposure; };
        gains.erase(std::remove_if(gains.begin(), gains.end(), is_alike), gains.end());
    } while (!gains.empty() && gains.size() >= rules.exposure_views && common.size() < rules.exposures);
    return common;
}

// The squared residual `rest` of each patch where it was found, its own gain, and the mean grey value there.
struct Fits {
    std::vector<double> rest, gain, mean;
};

// Residual deviations of the found patches, with the common gains and offsets beside the exposures, eq. (15). It is not
// compiled twice within each stage, because it takes little time.
[[gnu::noinline]] void judge(AlignedPatches& result, const Fits& fits, Matrices information, View<float, 1> level, Matrix before, int samples,
           const TemplateRules& rules) {
    const std::vector<std::size_t> found = rows_where(fits.gain.size(), [&](std::size_t i) { return result.found.data[i]; });
    std::vector<double> levels_before, levels_now, gains;
    for (std::size_t i : found) {
        levels_before.push_back(before[i][0] * level.data[i] + before[i][1]);
        levels_now.push_back(fits.mean[i]);
    }
    const auto [change, shift] = change_of_exposure(levels_before, levels_now, rules);
    for (std::size_t i = 0; i < fits.gain.size(); i++) {
        result.exposures[i][0] = change * before[i][0];
        result.exposures[i][1] = change * before[i][1] + shift;
        result.contrast.data[i] = fits.gain[i] * std::max<double>(level.data[i], 1) / std::max(fits.mean[i], 1.0);
    }
    if (found.empty()) return;
    for (std::size_t i : found) gains.push_back(fits.gain[i] / result.exposures[i][0]);
    const std::vector<double> common = gains_in_common(gains, rules);
    std::vector<std::vector<double>> offsets(common.size());
    std::vector<std::size_t> nearest(found.size());
    std::vector<double> offset(found.size());
    for (std::size_t k = 0; k < found.size(); k++) {
        std::size_t i = found[k];
        auto apart = [&](std::size_t of) { return std::fabs(std::log(gains[k] / common[of])); };
        for (std::size_t of = 1; of < common.size(); of++)
            if (apart(of) < apart(nearest[k])) nearest[k] = of;
        offset[k] = fits.mean[i] - common[nearest[k]] * result.exposures[i][0] * level.data[i] - result.exposures[i][1];
        offsets[nearest[k]].push_back(offset[k]);
    }
    std::vector<double> common_offset(common.size());
    for (std::size_t of = 0; of < common.size(); of++)
        if (!offsets[of].empty()) common_offset[of] = median(std::move(offsets[of]));
    for (std::size_t k = 0; k < found.size(); k++) {
        std::size_t i = found[k];
        double expected = common[nearest[k]] * result.exposures[i][0], own_gain = fits.gain[i] - expected;
        double own_offset = offset[k] - common_offset[nearest[k]];
        double squares = fits.rest[i] + own_gain * own_gain * information[i][8] + samples * own_offset * own_offset;
        result.error.data[i] = std::sqrt(squares / (samples - PARAMETERS)) / expected;
    }
}

// A position is found with the patch's own gain and offset. Its error is judged with those that patches have in common
// beside the exposures of the images that they were cut from, because light that changes on one patch alone is a
// reflection or a shadow.
template <class T>
WIDER AlignedPatches align_patches(const ImageOf<T>& image, Matrix starts, View<float, 3> inverse, Matrices information,
                             View<float, 1> level, Matrix before, int radius, int spacing, const TemplateRules& rules) {
    int k = samples_across(radius, spacing), k2 = k * k;
    std::size_t n = starts.shape[0];
    const double min_gain = 1 / rules.max_gain;
    require(k2 > PARAMETERS, "patches have too few samples");
    require(rules.max_gain >= 1, "max_gain is below 1");
    require_shape(starts, {n, 2}, "starts_px");
    require_shape(inverse, {n, 3, static_cast<std::size_t>(k2)}, "inverse");
    require_shape(information, {n, 3, 3}, "information");
    require_shape(level, {n}, "level");
    require_shape(before, {n, 2}, "exposures");
    for (std::size_t i = 0; i < n; i++)
        require(before[i][0] > 0 && std::isfinite(before[i][0]) && std::isfinite(before[i][1]), "exposures are not gains above 0 and offsets");
    require(n == 0 || (image.height > 0 && image.width > 0), "the image is empty");
    Array<float, 1> weights = sample_weights(radius, spacing, rules.weights_width);
    AlignedPatches result{{n, 2}, {n}, {n}, {n, 2}, {n}};
    std::vector<float> there(k2), weighted(k2);
    Sampler<T> sampler(k2);
    Fits fits{std::vector<double>(n), std::vector<double>(n), std::vector<double>(n)};
    for (std::size_t i = 0; i < n; i++) {
        float x = static_cast<float>(starts[i][0]), y = static_cast<float>(starts[i][1]);
        double fit[3] = {0, 0, 0}, mean = 0, total = 0, before = radius / rules.step_ratio;
        bool converged = false, going = std::isfinite(x) && std::isfinite(y);
        for (int step = 0; going && step < rules.steps; step++) {
            sampler.square(image, x, y, radius, spacing, k, there.data());
            mean = dot(there.data(), weights.data.get(), k2) / k2;
            for (int j = 0; j < k2; j++) {
                there[j] -= static_cast<float>(mean);
                weighted[j] = there[j] * weights.data[j];
            }
            total = dot(there.data(), weighted.data(), k2);
            for (int a = 0; a < 3; a++) fit[a] = dot(inverse[i] + a * k2, there.data(), k2);  // gain × step along u, v; gain
            double divisor = std::clamp(fit[2], min_gain, rules.max_gain), du = fit[0] / divisor, dv = fit[1] / divisor;
            x = static_cast<float>(x - du);
            y = static_cast<float>(y - dv);
            double size = std::max(std::fabs(du), std::fabs(dv));
            converged = size < rules.converged_px;
            going = size >= rules.converged_px && size < rules.step_ratio * before;
            before = size;
        }
        const double* of = information[i];
        double explained = 0;
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) explained += fit[a] * of[3 * a + b] * fit[b];
        fits.rest[i] = std::max(total - explained, 0.0);
        fits.gain[i] = fit[2];
        fits.mean[i] = mean;
        result.at[i][0] = x;
        result.at[i][1] = y;
        result.error.data[i] = std::numeric_limits<double>::infinity();
        result.found.data[i] = converged && fit[2] > min_gain && fit[2] < rules.max_gain &&
                               fits.rest[i] < (1 - rules.min_explained) * total;
    }
    judge(result, fits, information, level, before, k2, rules);
    return result;
}

template decltype(store_patches<float>) store_patches<float>;
template decltype(warp_patches<float>) warp_patches<float>;
template decltype(align_patches<float>) align_patches<float>;
template decltype(store_patches<std::uint8_t>) store_patches<std::uint8_t>;
template decltype(warp_patches<std::uint8_t>) warp_patches<std::uint8_t>;
template decltype(align_patches<std::uint8_t>) align_patches<std::uint8_t>;

}  // namespace core
