// What Python sees of the core: arrays are checked here, and stages run without Python's lock.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <optional>
#include <utility>

#include "stages.hpp"

namespace nb = nanobind;
using namespace core;

namespace {

template <class T, std::size_t N>
using In = nb::ndarray<const T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
template <class T>
using GreyOf = In<T, 2>;
using Grey = GreyOf<float>;
constexpr std::size_t MAX_SIDE = 1 << 24;  // of an image: floats count its pixels exactly

template <class T, nb::ssize_t... Extents>
View<T, sizeof...(Extents)> view(const nb::ndarray<const T, nb::shape<Extents...>, nb::c_contig, nb::device::cpu>& array) {
    View<T, sizeof...(Extents)> result{array.data(), {}};
    for (std::size_t i = 0; i < sizeof...(Extents); i++) result.shape[i] = array.shape(i);
    return result;
}

template <class T>
ImageOf<T> image(const nb::ndarray<const T, nb::ndim<2>, nb::c_contig, nb::device::cpu>& array) {
    require(array.shape(0) < MAX_SIDE && array.shape(1) < MAX_SIDE, "the image is too large");
    return {array.data(), static_cast<int>(array.shape(0)), static_cast<int>(array.shape(1))};
}

template <class T, std::size_t N>
nb::object numpy(Array<T, N> array) {
    T* data = array.data.release();
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(data, N, array.shape.data(), owner));
}

template <class Stage>
auto unlocked(Stage&& stage) {
    nb::gil_scoped_release release;
    return stage();
}

template <class T>
nb::tuple match_along_rows_of(const GreyOf<T>& left, const GreyOf<T>& right, const In<std::int64_t, 2>& points_px,
                              std::int64_t first, std::int64_t last) {
    auto r = unlocked([&] { return match_along_rows(image(left), image(right), view(points_px), first, last); });
    return nb::make_tuple(numpy(std::move(r.disparity)), numpy(std::move(r.unique)));
}

// As NumPy says it.
void require_definite(bool definite, const char* otherwise) {
    if (definite) return;
    PyErr_SetString(nb::module_::import_("numpy.linalg").attr("LinAlgError").ptr(), otherwise);
    throw nb::python_error();
}

Pinholes pinholes(const nb::tuple& numbers) {
    require(numbers.size() == 5, "pinholes are not five numbers");
    auto number = [&](int i) { return nb::cast<double>(numbers[i]); };
    return {number(0), number(1), number(2), number(3), number(4)};
}

using Floats = In<double, 2>;
using Blocks = In<double, 3>;
using Numbers = In<double, 1>;
using Rows = In<std::int64_t, 1>;
constexpr const char* NOT_DEFINITE = "a view's covariance is not positive definite";

// A stage that takes points with their views first; no covariances of points: they are exact.
template <class... More, class Stage>
void def_of_views(nb::module_& m, const char* name, Stage stage) {
    m.def(name, [stage](const nb::tuple& camera, const Floats& points, const Blocks& cov_points, const Floats& z, const Blocks& cov,
                        const Blocks& shared, const Numbers& gate, const More&... more) {
        View<double, 3> noise = view(cov_points);
        PointViews views{pinholes(camera), view(points), noise.shape[0] ? &noise : nullptr, view(z), view(cov), view(shared), view(gate)};
        return stage(views, more...);
    });
}

WindowState window_state(const Blocks& cams_from_ref, const Blocks& ref_from_anchor, const Floats& q, const In<double, 1>& rig_error) {
    return {view(cams_from_ref), view(ref_from_anchor), view(q), view(rig_error)};
}

WindowViews window_views(const Rows& frame, const Rows& point, const Floats& z, const Blocks& root, const Blocks& terms,
                         const Floats& field, const Floats& moves) {
    return {view(frame), view(point), view(z), view(root), view(terms), view(field), view(moves)};
}

}  // namespace

NB_MODULE(_core, m) {
    m.def("match_along_rows", &match_along_rows_of<std::uint8_t>, nb::arg().noconvert(), nb::arg().noconvert(), nb::arg(),
          nb::arg(), nb::arg());
    m.def("match_along_rows", &match_along_rows_of<float>);
    m.def("among", [](const Rows& ids, const Rows& known) { return numpy(among(view(ids), view(known))); });
    m.def("sample_weights", [](int radius, int spacing) { return numpy(sample_weights(radius, spacing)); });
    m.def("store_patches",
          [](nb::ndarray<float, nb::ndim<3>, nb::c_contig, nb::device::cpu> stored, const Grey& grey,
             const In<std::int64_t, 2>& points_px, const In<std::int64_t, 1>& slots) {
              std::array<std::size_t, 3> shape{stored.shape(0), stored.shape(1), stored.shape(2)};
              unlocked([&] { store_patches(stored.data(), shape, image(grey), view(points_px), view(slots)); });
          },
          nb::arg().noconvert(), nb::arg(), nb::arg(), nb::arg());
    m.def("warp_patches",
          [](const In<float, 3>& stored, const In<std::int64_t, 1>& slots, const In<double, 3>& warps, int radius, int spacing) {
              auto r = unlocked([&] { return warp_patches(view(stored), view(slots), view(warps), radius, spacing); });
              return nb::make_tuple(numpy(std::move(r.inverse)), numpy(std::move(r.information)), numpy(std::move(r.level)));
          });
    m.def("align_patches", [](const Grey& grey, const In<double, 2>& starts, const In<float, 3>& inverse,
                              const In<double, 3>& information, const In<float, 1>& level, int radius, int spacing) {
        auto r = unlocked([&] {
            return align_patches(image(grey), view(starts), view(inverse), view(information), view(level), radius, spacing);
        });
        return nb::make_tuple(numpy(std::move(r.at)), numpy(std::move(r.found)), numpy(std::move(r.error)));
    });
    m.def("unfilter_png", [](const GreyOf<std::uint8_t>& filtered, std::size_t pixel) {
        return numpy(unlocked([&] { return unfilter_png(view(filtered), pixel); }));
    });
    m.def("disparity_slopes", [](const Grey& left, const Grey& right, const In<std::int64_t, 2>& points_px,
                                 const In<double, 2>& right_px, int radius, double std_grey) {
        return numpy(unlocked([&] {
            return disparity_slopes(image(left), image(right), view(points_px), view(right_px), radius, std_grey);
        }));
    });
    def_of_views<Floats>(m, "linearise_views", [](const PointViews& views, const Floats& cam_from_ref) {
        auto r = unlocked([&] { return linearise_views(views, view(cam_from_ref)); });
        require_definite(r.definite, NOT_DEFINITE);
        return nb::make_tuple(numpy(std::move(r.root)), numpy(std::move(r.jacobian)));
    });
    def_of_views<Blocks, Numbers, Blocks>(
        m, "view_residuals", [](const PointViews& views, const Blocks& root, const Numbers& amplitudes, const Blocks& cams_from_ref) {
            auto r = unlocked([&] { return view_residuals(views, view(root), view(amplitudes), view(cams_from_ref)); });
            return nb::make_tuple(numpy(std::move(r.residuals)), numpy(std::move(r.squares)));
        });
    def_of_views<Floats, Numbers, bool>(
        m, "fit_motion", [](const PointViews& views, const Floats& start, const Numbers& amplitudes, bool anneal) {
            auto r = unlocked([&] { return fit_motion(views, view(start), view(amplitudes), anneal); });
            require_definite(r.definite, NOT_DEFINITE);
            return nb::make_tuple(numpy(std::move(r.cam_from_ref)), numpy(std::move(r.amplitudes)), numpy(std::move(r.cov)),
                                  numpy(std::move(r.accepted)), numpy(std::move(r.squares)), r.spread, r.determined);
        });
    def_of_views<Floats, Numbers, In<bool, 1>, double>(
        m, "motions_of_halves", [](const PointViews& views, const Floats& motion, const Numbers& amplitudes,
                                   const In<bool, 1>& accepted, double shared_noise) {
            auto r = unlocked([&] {
                return motions_of_halves(views, view(motion), view(amplitudes), view(accepted), shared_noise);
            });
            require_definite(r.definite, NOT_DEFINITE);
            return nb::make_tuple(r.apart, numpy(std::move(r.motions)));
        });
    def_of_views<Floats, int>(m, "fit_turn", [](const PointViews& views, const Floats& motion, int steps) {
        auto r = unlocked([&] { return fit_turn(views, view(motion), steps); });
        require_definite(r.definite, "the views do not determine a turn");
        return nb::make_tuple(numpy(std::move(r.rad)), numpy(std::move(r.cov)), numpy(std::move(r.agree)));
    });
    m.def("rig_columns",
          [](const nb::tuple& camera, double width, double height, const Floats& z, std::optional<Floats> velocity,
             std::optional<Floats> row, const In<double, 1>& age) {
              Pinholes of = pinholes(camera);
              View<double, 2> velocities{}, rows{};
              if (velocity) velocities = view(*velocity);
              if (row) rows = view(*row);
              return numpy(unlocked([&] {
                  return rig_columns(of, {width, height}, view(z), velocity ? &velocities : nullptr, row ? &rows : nullptr,
                                     view(age));
              }));
          },
          nb::arg(), nb::arg(), nb::arg(), nb::arg(), nb::arg().none(), nb::arg().none(), nb::arg());
    m.def("field_basis", [](const Floats& at, const In<double, 1>& u, const In<double, 1>& v, double length, const Floats& root) {
        return numpy(unlocked([&] { return field_basis(view(at), view(u), view(v), length, view(root)); }));
    });
    m.def("rig_mixture", [](const In<double, 1>& mean, const Floats& cov, const In<double, 1>& size, std::size_t lenses,
                            const In<bool, 2>& is_zero, const In<double, 1>& log_prior, double counts, bool known_wrong) {
        auto r = unlocked([&] {
            return rig_mixture(view(mean), view(cov), view(size), lenses, view(is_zero), view(log_prior), counts, known_wrong);
        });
        require_definite(r.finite, "the errors of the rig are not determined");
        return nb::make_tuple(numpy(std::move(r.mean)), numpy(std::move(r.cov)), r.p_wrong);
    });
    m.def("velocities_by_twist", [](const nb::tuple& camera, const Floats& points) {
        Pinholes of = pinholes(camera);
        return numpy(unlocked([&] { return velocities_by_twist(of, view(points)); }));
    });
    m.def("moving_views", [](const nb::tuple& camera, const Floats& points, const Floats& twists) {
        Pinholes of = pinholes(camera);
        auto r = unlocked([&] { return moving_views(of, view(points), view(twists)); });
        return nb::make_tuple(numpy(std::move(r.z)), numpy(std::move(r.velocity)));
    });
    m.def("principal_errors", [](const Blocks& errors, double least) {
        return numpy(unlocked([&] { return principal_errors(view(errors), least); }));
    });
    m.def("pose_exp", [](const Floats& xi) { return numpy(unlocked([&] { return pose_exp(view(xi)); })); });
    m.def("pose_log", [](const Blocks& poses) { return numpy(unlocked([&] { return pose_log(view(poses)); })); });
    m.def("pose_inverse", [](const Blocks& poses) { return numpy(unlocked([&] { return pose_inverse(view(poses)); })); });
    m.def("pose_adjoint", [](const Blocks& poses) { return numpy(unlocked([&] { return pose_adjoint(view(poses)); })); });
    m.def("rotation_vectors", [](const Blocks& r) { return numpy(unlocked([&] { return rotation_vectors(view(r)); })); });
    m.def("quaternions", [](const Blocks& r) { return numpy(unlocked([&] { return quaternions(view(r)); })); });
    m.def("orthonormalise", [](const Blocks& poses) { return numpy(unlocked([&] { return orthonormalise(view(poses)); })); });
    m.def("polynomial_rows", [](double width, double height, const Floats& z, const Blocks& coefficients) {
        return numpy(unlocked([&] { return polynomial_rows({width, height}, view(z), view(coefficients)); }));
    });
    m.def("multiply_blocks", [](const Blocks& a, const Blocks& b) {
        return numpy(unlocked([&] { return multiply_blocks(view(a), view(b)); }));
    });
    m.def("invert_triangle", [](const Floats& lower) { return numpy(unlocked([&] { return invert_triangle(view(lower)); })); });
    m.def("window_points", [](const Blocks& cams, const Blocks& anchors, const Floats& q, const Rows& frame, const Rows& point) {
        return numpy(unlocked([&] { return window_points(view(cams), view(anchors), view(q), view(frame), view(point)); }));
    });
    m.def("window_residuals", [](const nb::tuple& camera, const Blocks& cams, const Blocks& anchors, const Floats& q,
                                 const In<double, 1>& rig_error, const Rows& frame, const Rows& point, const Floats& z,
                                 const Blocks& root, const Blocks& terms, const Floats& field, const Floats& moves) {
        Pinholes of = pinholes(camera);
        return numpy(unlocked([&] {
            return window_residuals(of, window_state(cams, anchors, q, rig_error),
                                    window_views(frame, point, z, root, terms, field, moves));
        }));
    });
    m.def("normal_blocks", [](const nb::tuple& camera, const Blocks& cams, const Blocks& anchors, const Floats& q,
                              const In<double, 1>& rig_error, const Rows& frame, const Rows& point, const Floats& z,
                              const Blocks& root, const Blocks& terms, const Floats& field, const Floats& moves) {
        Pinholes of = pinholes(camera);
        auto r = unlocked([&] {
            return normal_blocks(of, window_state(cams, anchors, q, rig_error),
                                 window_views(frame, point, z, root, terms, field, moves));
        });
        return nb::make_tuple(numpy(std::move(r.u)), numpy(std::move(r.v)), numpy(std::move(r.w)), numpy(std::move(r.g_pose)),
                              numpy(std::move(r.g_point)), numpy(std::move(r.rig)), numpy(std::move(r.rig_pose)),
                              numpy(std::move(r.rig_point)), numpy(std::move(r.g_rig)));
    });
    m.def("eliminate_points", [](const Blocks& v, const Blocks& w, const Blocks& by_rig, const Rows& known, const Blocks& cov,
                                 const Blocks& modes) {
        auto r = unlocked([&] { return eliminate_points(view(v), view(w), view(by_rig), view(known), view(cov), view(modes)); });
        require_definite(r.definite, "the information about a point is not positive definite");
        return nb::make_tuple(numpy(std::move(r.d_inverse)), numpy(std::move(r.pull)), numpy(std::move(r.std_given)),
                              numpy(std::move(r.reach)));
    });
    m.def("point_marginals", [](const Blocks& anchors, const Floats& q, const In<bool, 1>& finite, const Blocks& qq, const Blocks& qx,
                                const Blocks& qw, const Floats& xx, const Floats& ww, const Blocks& q_by_rig, const Floats& x_by_rig,
                                const Floats& world_from_ref, const Floats& cam_from_ref) {
        auto r = unlocked([&] {
            return point_marginals({view(anchors), view(q), view(finite)},
                                   {view(qq), view(qx), view(qw), view(q_by_rig), view(xx), view(ww), view(x_by_rig)},
                                   view(world_from_ref), view(cam_from_ref));
        });
        return nb::make_tuple(numpy(std::move(r.q_in_cam)), numpy(std::move(r.cov_q_in_cam)), numpy(std::move(r.points_in_cam)),
                              numpy(std::move(r.cov_points)), numpy(std::move(r.points_in_world)),
                              numpy(std::move(r.cov_points_in_world)));
    });
}
