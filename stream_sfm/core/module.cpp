// What Python sees of the core: arrays are checked here, and stages run without Python's lock.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include "stages.hpp"

namespace nb = nanobind;
using namespace core;

namespace {

template <class T, std::size_t N>
using In = nb::ndarray<const T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
constexpr std::size_t MAX_SIDE = 1 << 24;  // of an image: floats count its pixels exactly

template <class Stage>
auto unlocked(Stage&& stage) {
    nb::gil_scoped_release release;
    return stage();
}

// Whether a record has several parts.
template <class T, class = void>
struct has_parts : std::false_type {};
template <class T>
struct has_parts<T, std::void_t<decltype(std::declval<T&>().parts())>> : std::true_type {};

// What a stage returns, as Python sees it: an array, a number or None, or of several `parts` a tuple.
template <class T, std::size_t N>
nb::object given(Array<T, N>&& array) {
    T* data = array.data.release();
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(data, N, array.shape.data(), owner));
}
template <class T>
nb::object given(std::optional<T>&& perhaps);
template <class T>
nb::object given(T&& number) {
    if constexpr (has_parts<std::decay_t<T>>::value)
        return std::apply([](auto&... parts) { return nb::make_tuple(given(std::move(parts))...); }, number.parts());
    else
        return nb::cast(number);
}
template <class T>
nb::object given(std::optional<T>&& perhaps) {
    return perhaps ? given(std::move(*perhaps)) : nb::none();
}

// How Python gives an argument of a stage: numbers as they are.
template <class T, class = void>
struct Argument {
    using Given = T;
    static T of(const T& number) { return number; }
};
template <class T, std::size_t N>
struct Argument<View<T, N>> {
    using Given = In<T, N>;
    static View<T, N> of(const Given& array) {
        View<T, N> result{array.data(), {}};
        for (std::size_t i = 0; i < N; i++) result.shape[i] = array.shape(i);
        return result;
    }
};
template <class T>
struct Argument<ImageOf<T>> {
    using Given = In<T, 2>;
    static ImageOf<T> of(const Given& array) {
        require(array.shape(0) < MAX_SIDE && array.shape(1) < MAX_SIDE, "the image is too large");
        return {array.data(), static_cast<int>(array.shape(0)), static_cast<int>(array.shape(1))};
    }
};
template <class T>
struct Argument<std::optional<T>> {
    using Given = std::optional<typename Argument<T>::Given>;
    static std::optional<T> of(const Given& given) { return given ? std::optional<T>(Argument<T>::of(*given)) : std::nullopt; }
};

template <>
struct Argument<std::array<double, 2>> {
    using Given = std::tuple<double, double>;
    static std::array<double, 2> of(const Given& given) { return {std::get<0>(given), std::get<1>(given)}; }
};

// A record that Python gives as a tuple of its parts.
template <class Record, class Parts>
struct RecordArgument;
template <class Record, class... Parts>
struct RecordArgument<Record, std::tuple<Parts&...>> {
    using Given = std::tuple<typename Argument<Parts>::Given...>;
    static Record of(const Given& given) {
        return std::apply([](const auto&... parts) { return Record{Argument<Parts>::of(parts)...}; }, given);
    }
};
template <class Record>
struct Argument<Record, std::enable_if_t<has_parts<Record>::value>>
    : RecordArgument<Record, decltype(std::declval<Record&>().parts())> {};

template <auto Stage>
struct Bound;
template <class Result, class... Taken, Result (*Stage)(Taken...)>
struct Bound<Stage> {
    static nb::object call(const typename Argument<std::decay_t<Taken>>::Given&... arguments) {
        std::tuple<std::decay_t<Taken>...> taken{Argument<std::decay_t<Taken>>::of(arguments)...};
        return given(unlocked([&] { return std::apply(Stage, taken); }));
    }
};

// Stages as Python calls them, by the names that they have here.
#define STAGE(name) std::make_pair(#name, &Bound<&name>::call)
template <class... Stages>
void def_stages(nb::module_& m, const Stages&... stages) {
    (m.def(stages.first, stages.second), ...);
}

// Stages that take images of one type of pixels.
template <class T, class OfImage>
void def_of_images(nb::module_& m, const OfImage& of_image) {
    nb::arg any;
    m.def("match_along_rows", &Bound<&match_along_rows<T>>::call, of_image, of_image, any, any, any);
    m.def("corner_strength", &Bound<&corner_strength<T>>::call, of_image);
    m.def("warp_patches", &Bound<&warp_patches<T>>::call, of_image, any, any, any, any);
    m.def("align_patches", &Bound<&align_patches<T>>::call, of_image, any, any, any, any, any, any);
    m.def("match_new_points", &Bound<&match_new_points<T>>::call, of_image, of_image, of_image, any, any, any, any, any, any, any, any);
    m.def("store_patches",
          [](nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu> stored, const In<T, 2>& grey,
             const In<std::int64_t, 2>& points_px, const In<std::int64_t, 1>& slots) {
              std::array<std::size_t, 3> shape{stored.shape(0), stored.shape(1), stored.shape(2)};
              auto image = Argument<ImageOf<T>>::of(grey);
              Pixels points = Argument<Pixels>::of(points_px);
              Indices at = Argument<Indices>::of(slots);
              unlocked([&] { store_patches(stored.data(), shape, image, points, at); });
          },
          nb::arg().noconvert(), of_image, any, any);
}

}  // namespace

NB_MODULE(_core, m) {
    nb::register_exception_translator([](const std::exception_ptr& pointer, void*) {
        try {
            std::rethrow_exception(pointer);
        } catch (const NotDefinite& error) {
            PyErr_SetString(nb::module_::import_("numpy.linalg").attr("LinAlgError").ptr(), error.what());
        }
    });
    def_of_images<std::uint8_t>(m, nb::arg().noconvert());  // before it would be converted to floats
    def_of_images<float>(m, nb::arg());
    def_stages(m, STAGE(rig_effects), STAGE(polynomial_rows), STAGE(expected_views), STAGE(timing_of_views),
               STAGE(linearise_views), STAGE(view_residuals), STAGE(fit_motion), STAGE(resect), STAGE(motion_of_flow),
               STAGE(fit_turn), STAGE(views_within_gates), STAGE(points_seen_again), STAGE(drift_covariances),
               STAGE(normal_blocks), STAGE(seen_points), STAGE(window_system), STAGE(points_alone),
               STAGE(leaving_views), STAGE(absorbing_system), STAGE(absorbed_points), STAGE(point_marginals),
               STAGE(new_corners), STAGE(project_points), STAGE(points_of_views), STAGE(row_terms), STAGE(row_offsets),
               STAGE(on_one_row), STAGE(gradient_matrices), STAGE(effects_of_turn), STAGE(point_motions),
               STAGE(scaled_by_diagonal), STAGE(among), STAGE(times_among), STAGE(union_of),
               STAGE(row_errors_of_tracks), STAGE(view_inflation), STAGE(place_new_points), STAGE(align_tracks),
               STAGE(predict_tracks), STAGE(update_depths), STAGE(templates_fit), STAGE(inside_area),
               STAGE(view_covariances), STAGE(template_drift), STAGE(unfilter_png), STAGE(field_basis),
               STAGE(rig_mixture), STAGE(velocities), STAGE(timed_views), STAGE(timing_unknowns), STAGE(unknown_errors),
               STAGE(shifts_by_timing), STAGE(cov_of_timed_pose), STAGE(reported_motions), STAGE(reported_points),
               STAGE(track_covariances), STAGE(whitening_of_views), STAGE(whiten_blocks), STAGE(gates_of_views),
               STAGE(log_evidence), STAGE(pose_exp), STAGE(pose_log), STAGE(pose_inverse), STAGE(pose_adjoint),
               STAGE(rotation_vectors), STAGE(quaternions), STAGE(orthonormalise), STAGE(invert_triangle),
               STAGE(q_by_reference), STAGE(eliminate_points), STAGE(preintegrate), STAGE(inertial_rows),
               STAGE(inertial_motion));
}
