// Views of tracks in a new frame: their templates, warped as they should look, found in the left image and then in the right one.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "algebra.hpp"
#include "stages.hpp"

namespace core {
namespace {

template <class T>
class Alignment {
   public:
    Alignment(const View<T, 3>& stored, const View<bool, 2>& area, const TemplateKind& kind) : stored(stored), area(area), kind(kind) {
        require(kind.scale >= 1 && kind.scale <= 1000, "templates have a scale from 1 to 1000");
    }

    // Templates (n) of `slots`, by warps (n, 3, 2) of image pixels; their last row is per pixel.
    Patches warped(const Indices& slots, const View<double, 3>& warps) const {
        require_shape(warps, {slots.shape[0], 3, 2}, "warps");
        Array<double, 3> of_template(warps.shape);
        for (std::size_t i = 0; i < slots.shape[0]; i++)
            for (std::size_t k = 0; k < 6; k++) of_template[i][k] = k < 4 ? warps[i][k] : kind.scale * warps[i][k];
        return warp_patches(stored, slots, of_template.view(), kind.radius, kind.spacing);
    }

    // Positions in image pixels of patches, from such starts (n, 2), in an image of templates' pixels.
    AlignedPatches find(const ImageOf<T>& image, const Patches& patches, const View<double, 2>& starts) const {
        std::size_t n = starts.shape[0];
        require_shape(starts, {n, 2}, "starts_px");
        Array<double, 2> of_template({n, 2});
        for (std::size_t i = 0; i < 2 * n; i++) of_template.data[i] = starts.data[i] / kind.scale;
        AlignedPatches result = align_patches(image, of_template.view(), patches.inverse.view(), patches.information.view(),
                                              patches.level.view(), kind.radius, kind.spacing);
        for (std::size_t i = 0; i < 2 * n; i++) result.at.data[i] *= kind.scale;
        return result;
    }

    // As `find`, of what stays near its start, fits, and lies where a whole patch shows the scene.
    AlignedPatches find_left(const ImageOf<T>& image, const Patches& patches, const View<double, 2>& starts) const {
        AlignedPatches left = find(image, patches, starts);
        Array<bool, 1> inside = inside_area(area, left.at.view());
        for (std::size_t i = 0; i < starts.shape[0]; i++) {
            double du = left.at[i][0] - starts[i][0], dv = left.at[i][1] - starts[i][1];
            left.found.data[i] = left.found.data[i] && std::sqrt(du * du + dv * dv) < kind.scale * kind.farthest &&
                                 left.error.data[i] < kind.max_error && inside.data[i];
        }
        return left;
    }

    // Left sides as views whose right sides are missing; deviations (n,) of grey differences in both images.
    FoundViews views(AlignedPatches& left, const Array<double, 3>& gradients, const View<double, 1>& error_right) const {
        std::size_t n = left.found.shape[0];
        FoundViews result{std::move(left.found), Array<double, 2>({n, 4}), Array<double, 2>({n, 4}),
                          view_covariances(gradients.view(), left.error.view(), error_right, kind.shared_pixels, kind.scale, kind.factor)};
        double missing = std::numeric_limits<double>::quiet_NaN();
        for (std::size_t i = 0; i < n; i++)
            for (Array<double, 2>* z : {&result.z, &result.any_row})
                for (int c = 0; c < 4; c++) (*z)[i][c] = c < 2 ? left.at[i][c] : missing;
        return result;
    }

    // Patches as the right image shows them: those of slanted surfaces look different there.
    void turn_right(Patches& patches, const Sought& of) const {
        std::size_t samples = patches.inverse.row_size();
        std::vector<std::size_t> slanted;
        for (std::size_t i = 0; i < of.slots.shape[0]; i++)
            if (of.slopes[i][0] != 0 || of.slopes[i][1] != 0) slanted.push_back(i);
        Patches right = warped(rows_of(of.slots, slanted).view(), rows_of(of.right_warps, slanted).view());
        for (std::size_t k = 0; k < slanted.size(); k++) {
            std::copy_n(right.inverse[k], samples, patches.inverse[slanted[k]]);
            std::copy_n(right.information[k], 9, patches.information[slanted[k]]);
            patches.level.data[slanted[k]] = right.level.data[k];
        }
    }

   private:
    const View<T, 3>& stored;
    const View<bool, 2>& area;
    const TemplateKind& kind;
};

// Right positions (n, 2) with a turn (3,) of the right camera put in (sign 1) or taken out (-1).
void turn_by(const Pinholes& pinholes, const View<double, 1>& rad, double sign, Array<double, 2>& right) {
    if (rad.data[0] == 0 && rad.data[1] == 0 && rad.data[2] == 0) return;
    for (std::size_t i = 0; i < right.shape[0]; i++) {
        double effect[6];
        by_turn(pinholes, right[i][0], right[i][1], effect);
        for (int c = 0; c < 2; c++)
            right[i][c] += sign * (effect[3 * c] * rad.data[0] + effect[3 * c + 1] * rad.data[1] + effect[3 * c + 2] * rad.data[2]);
    }
}

void check(const Sought& of, const View<double, 1>& turn) {
    std::size_t n = of.slots.shape[0];
    require_shape(of.points, {n, 4}, "points");
    require_shape(of.slopes, {n, 2}, "slopes");
    require_shape(of.left, {n, 2}, "left_px");
    require_shape(of.right_u, {n}, "right_u_px");
    require_shape(of.right_warps, {n, 3, 2}, "right_warps");
    require_shape(of.twist, {6}, "twist");
    require_shape(turn, {3}, "turn");
}

}  // namespace

template <class T>
FoundViews align_left(const ImageOf<T>& image, const View<T, 3>& stored, const View<bool, 2>& area, const TemplateKind& kind,
                      const Indices& slots, const View<double, 3>& warps, const View<double, 2>& starts) {
    Alignment<T> alignment(stored, area, kind);
    Patches patches = alignment.warped(slots, warps);
    AlignedPatches left = alignment.find_left(image, patches, starts);
    std::vector<double> missing(slots.shape[0], std::numeric_limits<double>::quiet_NaN());
    return alignment.views(left, gradient_matrices(patches.information.view(), kind.spacing), {missing.data(), {missing.size()}});
}

template <class T>
FoundViews align_in_both(const ImageOf<T>& left_image, const ImageOf<T>& right_image, const View<T, 3>& stored, const View<bool, 2>& area,
                         const TemplateKind& kind, const Sought& of, const Pinholes& pinholes, const RowModel& rows,
                         const View<double, 1>& turn) {
    std::size_t n = of.slots.shape[0];
    check(of, turn);
    Alignment<T> alignment(stored, area, kind);
    Patches patches = alignment.warped(of.slots, of.left_warps);
    Array<double, 3> gradients = gradient_matrices(patches.information.view(), kind.spacing);
    AlignedPatches left = alignment.find_left(left_image, patches, of.left);
    Array<double, 2> velocity = velocities(pinholes, of.points, {of.twist.data, {1, 6}}), start({n, 2});
    Array<double, 1> speed({n});
    for (std::size_t i = 0; i < n; i++) speed.data[i] = velocity[i][3];
    Array<double, 1> vertical = row_offsets(rows, left.at.view(), speed.view());
    for (std::size_t i = 0; i < n; i++) {
        start[i][0] = of.right_u.data[i] + left.at[i][0] - of.left[i][0];
        start[i][1] = left.at[i][1] - vertical.data[i];
    }
    turn_by(pinholes, turn, 1, start);
    alignment.turn_right(patches, of);
    AlignedPatches right = alignment.find(right_image, patches, start.view());
    double margin = kind.scale * kind.radius, last = rows.size[0] - 1 - margin;
    for (std::size_t i = 0; i < n; i++)
        right.found.data[i] = right.found.data[i] && right.at[i][0] > margin && right.at[i][0] < last && right.error.data[i] < kind.max_error;
    turn_by(pinholes, turn, -1, right.at);
    for (std::size_t i = 0; i < n; i++) right.at[i][1] += vertical.data[i];
    Array<bool, 1> on_row = on_one_row(rows, left.at.view(), right.at.view(), speed.view(), kind.scale);
    FoundViews result = alignment.views(left, gradients, right.error.view());
    for (std::size_t i = 0; i < n; i++) {
        if (!right.found.data[i]) continue;
        std::copy_n(right.at[i], 2, result.any_row[i] + 2);
        if (on_row.data[i]) std::copy_n(right.at[i], 2, result.z[i] + 2);
    }
    return result;
}

template FoundViews align_left(const ImageOf<float>&, const View<float, 3>&, const View<bool, 2>&, const TemplateKind&, const Indices&,
                               const View<double, 3>&, const View<double, 2>&);
template FoundViews align_in_both(const ImageOf<float>&, const ImageOf<float>&, const View<float, 3>&, const View<bool, 2>&,
                                  const TemplateKind&, const Sought&, const Pinholes&, const RowModel&, const View<double, 1>&);
template FoundViews align_left(const ImageOf<std::uint8_t>&, const View<std::uint8_t, 3>&, const View<bool, 2>&, const TemplateKind&,
                               const Indices&, const View<double, 3>&, const View<double, 2>&);
template FoundViews align_in_both(const ImageOf<std::uint8_t>&, const ImageOf<std::uint8_t>&, const View<std::uint8_t, 3>&,
                                  const View<bool, 2>&, const TemplateKind&, const Sought&, const Pinholes&, const RowModel&,
                                  const View<double, 1>&);

}  // namespace core
