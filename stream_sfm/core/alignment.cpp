// Views of tracks in a new frame: their warped templates are found in the left image and then in the right one.

#include "tracks.hpp"
#include "images.hpp"
#include "resection.hpp"
#include "row_timing.hpp"

namespace core {
namespace {

// Tracks whose patches should be in a new frame: their rows, the starts of alignment, and warps in pixels of templates.
struct Sought {
    std::vector<std::size_t> rows;
    Array<std::int64_t, 1> slots;
    Array<double, 2> points, slopes, exposures, left;
    Array<double, 1> right_u;
    Array<double, 3> left_warps, right_warps;
};

// Views of these tracks: which were found, at least on the left; `any_row` includes right sides that are off their row.
struct FoundViews {
    Array<bool, 1> found;
    Array<double, 2> z, any_row;
    Array<double, 3> cov;
    Array<double, 2> exposures;  // of the left image over their templates
    Array<double, 1> contrast;
};

template <class T>
class Alignment {
   public:
    explicit Alignment(const Templates<T>& of) : of(of), kind(of.kind) {
        require(kind.scale >= 1 && kind.scale <= 1000, "templates have a scale from 1 to 1000");
    }

    // The tracks with templates of this size that can be warped as predicted and start where a whole patch shows the scene.
    Sought visible(const TrackTable& tracks, Indices slots, const PredictedTracks& now) const {
        Array<double, 3> left_warps = in_template_pixels(now.left_warps), right_warps = in_template_pixels(now.right_warps);
        double half = (static_cast<double>(of.stored.shape[1]) - 1) / 2;
        Array<bool, 1> left_fits = templates_fit(left_warps, kind.config.window_radius_px, half, kind.rules.least_area);
        Array<bool, 1> right_fits = templates_fit(right_warps, kind.config.window_radius_px, half, kind.rules.least_area);
        Array<bool, 1> inside = inside_area(of.area, now.left);
        std::vector<std::size_t> rows = rows_where(slots.shape[0], [&](std::size_t i) {
            return tracks.scale.data[i] == kind.scale && left_fits.data[i] && right_fits.data[i] && inside.data[i];
        });
        return {rows, rows_of(slots, rows), rows_of(now.points, rows), rows_of(tracks.slopes, rows),
                rows_of(tracks.exposures, rows), rows_of(now.left, rows), rows_of(now.right_u, rows), rows_of(left_warps, rows),
                rows_of(right_warps, rows)};
    }

    FoundViews find(const Sought& sought, const RightSides& right_sides) const {
        Patches patches = warp_patches(of.stored, sought.slots, sought.left_warps, kind.config.window_radius_px, kind.spacing_px, kind.rules);
        Array<double, 3> gradients = gradient_matrices(patches.information, kind.spacing_px);
        AlignedPatches left = find_left(patches, sought);
        if (of.right) return find_right(sought, patches, gradients, left, right_sides);
        std::vector<double> missing(sought.rows.size(), std::numeric_limits<double>::quiet_NaN());
        return views(left, gradients, {missing.data(), {missing.size()}});
    }

   private:
    // Warps (n, 3, 2) of image pixels, converted to template pixels; their last row is per pixel.
    Array<double, 3> in_template_pixels(const Array<double, 3>& warps) const {
        Array<double, 3> result(warps.shape);
        for (std::size_t i = 0; i < 6 * warps.shape[0]; i++) result.data[i] = i % 6 < 4 ? warps.data[i] : kind.scale * warps.data[i];
        return result;
    }

    // Positions of patches in an image of template pixels; they and the starts (n, 2) are in image pixels.
    AlignedPatches aligned(const ImageOf<T>& image, const Patches& patches, Matrix starts, Matrix exposures) const {
        std::size_t n = starts.shape[0];
        Array<double, 2> of_template(n, 2);
        for (std::size_t i = 0; i < 2 * n; i++) of_template.data[i] = starts.data[i] / kind.scale;
        AlignedPatches result = align_patches(image, of_template, patches.inverse, patches.information, patches.level, exposures,
                                              kind.config.window_radius_px, kind.spacing_px, kind.rules);
        for (std::size_t i = 0; i < 2 * n; i++) result.at.data[i] *= kind.scale;
        return result;
    }

    // Left positions; they count as found if near their start, with a good fit, where a whole patch shows the scene.
    AlignedPatches find_left(const Patches& patches, const Sought& sought) const {
        Matrix starts = sought.left;
        AlignedPatches left = aligned(of.left, patches, starts, sought.exposures);
        Array<bool, 1> inside = inside_area(of.area, left.at);
        for (std::size_t i = 0; i < starts.shape[0]; i++) {
            double du = left.at[i][0] - starts[i][0], dv = left.at[i][1] - starts[i][1];
            left.found.data[i] = left.found.data[i] && std::sqrt(du * du + dv * dv) < kind.scale * kind.config.max_realignment_px &&
                                 left.error.data[i] < kind.config.max_photometric_error && inside.data[i];
        }
        return left;
    }

    // Views whose left sides were found, with right sides found on their rows.
    FoundViews find_right(const Sought& sought, Patches& patches, const Array<double, 3>& gradients,
                          AlignedPatches& left, const RightSides& by) const {
        std::size_t n = sought.rows.size();
        Array<double, 2> start(n, 2);
        Array<double, 1> speed = row_speeds(by.rows.projection, sought.points, by.twist);
        Array<double, 1> vertical = row_offsets(by.rows, left.at, speed);
        for (std::size_t i = 0; i < n; i++) {
            start[i][0] = sought.right_u.data[i] + left.at[i][0] - sought.left[i][0];
            start[i][1] = left.at[i][1] - vertical.data[i];
        }
        turn_by(by.rows.projection, by.turn_rad, 1, start);
        turn_right(patches, sought);
        AlignedPatches right = aligned(*of.right, patches, start, sought.exposures);
        double margin = kind.scale * kind.config.window_radius_px, last = by.rows.projection.width - 1.0 - margin;
        for (std::size_t i = 0; i < n; i++)
            right.found.data[i] =
                right.found.data[i] && right.at[i][0] > margin && right.at[i][0] < last && right.error.data[i] < kind.config.max_photometric_error;
        turn_by(by.rows.projection, by.turn_rad, -1, right.at);
        for (std::size_t i = 0; i < n; i++) right.at[i][1] += vertical.data[i];
        Array<bool, 1> on_row = on_one_row(by.rows, left.at, right.at, speed, kind.scale);
        FoundViews result = views(left, gradients, right.error);
        for (std::size_t i = 0; i < n; i++) {
            if (!right.found.data[i]) continue;
            std::copy_n(right.at[i], 2, result.any_row[i] + 2);
            if (on_row.data[i]) std::copy_n(right.at[i], 2, result.z[i] + 2);
        }
        return result;
    }

    // Views of left sides with missing right sides; `error_right` (n,): deviations of grey differences in the right image.
    FoundViews views(AlignedPatches& left, const Array<double, 3>& gradients, Vector error_right) const {
        std::size_t n = left.found.shape[0];
        FoundViews result{std::move(left.found), {n, 4}, {n, 4},
                          view_covariances(gradients, left.error, error_right, kind.noise.shared_pixels, kind.scale, kind.noise.factor, kind.rules),
                          std::move(left.exposures), std::move(left.contrast)};
        double missing = std::numeric_limits<double>::quiet_NaN();
        for (std::size_t i = 0; i < n; i++)
            for (Array<double, 2>* z : {&result.z, &result.any_row})
                for (int c = 0; c < 4; c++) (*z)[i][c] = c < 2 ? left.at[i][c] : missing;
        return result;
    }

    // Replaces patches of slanted surfaces by their warps to the right image, where they look different.
    void turn_right(Patches& patches, const Sought& sought) const {
        std::size_t samples = row_size(patches.inverse.shape);
        std::vector<std::size_t> slanted = slanted_rows(sought.slopes);
        Patches right = warp_patches(of.stored, rows_of(sought.slots, slanted), rows_of(sought.right_warps, slanted),
                                     kind.config.window_radius_px, kind.spacing_px, kind.rules);
        for (std::size_t k = 0; k < slanted.size(); k++) {
            std::copy_n(right.inverse[k], samples, patches.inverse[slanted[k]]);
            std::copy_n(right.information[k], 9, patches.information[slanted[k]]);
            patches.level.data[slanted[k]] = right.level.data[k];
        }
    }

    const Templates<T>& of;
    const TemplateKind& kind;
};

}  // namespace

AlignedTracks align_tracks(const RightSides& right_sides, const Timing& timing, const TrackTable& tracks, Indices slots,
                           Matrix cam_from_previous, Matrix cam_from_start, Matrix left, Flags agree,
                           const Templates<std::uint8_t>& ordinary, const std::optional<Templates<float>>& wide) {
    std::size_t n = tracks.points.shape[0];
    require_shape(slots, {n}, "slots");
    require_shape(right_sides.turn_rad, {3}, "turn");
    PredictedTracks now = predict_tracks(right_sides.rows.projection, timing, right_sides.twist, tracks, cam_from_previous,
                                         cam_from_start, left, agree);
    Array<bool, 1> expected(n);
    FoundViews all{{n}, {n, 4}, {n, 4}, {n, 4, 4}, {n, 2}, {n}};
    auto align = [&](const auto& templates) {
        Alignment alignment(templates);
        Sought sought = alignment.visible(tracks, slots, now);
        FoundViews views = alignment.find(sought, right_sides);
        for (std::size_t k = 0; k < sought.rows.size(); k++) {
            std::size_t i = sought.rows[k];
            expected.data[i] = true;
            all.found.data[i] = views.found.data[k];
            std::copy_n(views.z[k], 4, all.z[i]);
            std::copy_n(views.any_row[k], 4, all.any_row[i]);
            std::copy_n(views.cov[k], 16, all.cov[i]);
            std::copy_n(views.exposures[k], 2, all.exposures[i]);
            all.contrast.data[i] = views.contrast.data[k];
        }
    };
    align(ordinary);
    if (wide) align(*wide);
    std::vector<std::size_t> kept = rows_where(n, [&](std::size_t i) { return all.found.data[i]; });
    Array<double, 2> points = rows_of(now.points, kept);
    Array<double, 2> taken = shifts_by_timing(right_sides.rows.projection, timing.row_of, points, right_sides.twist, timing.mean);
    AlignedTracks result{std::move(expected), numbers(kept), std::move(points), rows_of(all.z, kept),
                         rows_of(all.cov, kept), rows_of(all.any_row, kept), std::move(taken), rows_of(all.exposures, kept), rows_of(all.contrast, kept)};
    for (Array<double, 2>* z : {&result.z, &result.any_row})
        for (std::size_t i = 0; i < 4 * kept.size(); i++) z->data[i] -= result.taken.data[i];
    return result;
}

}  // namespace core
