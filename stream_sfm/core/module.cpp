// What Python sees of the core: arrays are checked here, and stages run without Python's lock.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <optional>
#include <tuple>
#include <type_traits>
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

// Whether a result has several parts.
template <class T, class = void>
struct has_parts : std::false_type {};
template <class T>
struct has_parts<T, std::void_t<decltype(std::declval<T&>().parts())>> : std::true_type {};

// What a stage returns, as Python sees it: an array, a number or None, or of several `parts` a tuple.
template <class T, std::size_t N>
nb::object given(Array<T, N>&& array) {
    return numpy(std::move(array));
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

template <class Stage>
nb::object result(Stage&& stage) {
    return given(unlocked(stage));
}

// How Python gives an argument of a stage: numbers as they are.
template <class T>
struct Argument {
    using Given = T;
    static T of(const T& number) { return number; }
};
template <class T, std::size_t N>
struct Argument<View<T, N>> {
    using Given = In<T, N>;
    static View<T, N> of(const Given& array) { return view(array); }
};
template <class T>
struct Argument<ImageOf<T>> {
    using Given = GreyOf<T>;
    static ImageOf<T> of(const Given& array) { return image(array); }
};
template <class T>
struct Argument<std::optional<T>> {
    using Given = std::optional<typename Argument<T>::Given>;
    static std::optional<T> of(const Given& given) { return given ? std::optional<T>(Argument<T>::of(*given)) : std::nullopt; }
};

// A record that Python gives as a tuple of its members.
template <class Record, class... Members>
struct RecordArgument {
    using Given = std::tuple<typename Argument<Members>::Given...>;
    static Record of(const Given& given) {
        return std::apply([](const auto&... members) { return Record{Argument<Members>::of(members)...}; }, given);
    }
};
template <>
struct Argument<Pinholes> : RecordArgument<Pinholes, double, double, double, double, double> {};
template <>
struct Argument<std::array<double, 2>> : RecordArgument<std::array<double, 2>, double, double> {};
template <>
struct Argument<Field> : RecordArgument<Field, View<double, 1>, View<double, 1>, double, View<double, 2>> {};
template <>
struct Argument<RowModel> : RecordArgument<RowModel, std::array<double, 2>, Field, View<double, 1>, View<double, 2>, double, double> {};
template <>
struct Argument<RightSides> : RecordArgument<RightSides, Pinholes, RowModel, View<double, 1>, View<double, 1>> {};
template <>
struct Argument<ExposedRows> : RecordArgument<ExposedRows, std::array<double, 2>, View<double, 3>> {};
template <>
struct Argument<Timing> : RecordArgument<Timing, ExposedRows, View<double, 1>, View<double, 2>, View<double, 1>> {};
template <>
struct Argument<PhysicalAxes> : RecordArgument<PhysicalAxes, View<double, 2>, double, double> {};
template <>
struct Argument<TemplateKind> : RecordArgument<TemplateKind, int, int, int, double, double, double, double> {};
template <>
struct Argument<PointViews> : RecordArgument<PointViews, Pinholes, View<double, 2>, View<double, 3>, View<double, 2>, View<double, 3>,
                                             View<double, 3>, View<double, 1>> {};
template <>
struct Argument<RigModel> : RecordArgument<RigModel, Pinholes, std::array<double, 2>, View<double, 2>, Field> {};
template <>
struct Argument<MovingPoints> : RecordArgument<MovingPoints, View<double, 2>, View<double, 1>> {};
template <>
struct Argument<ResectionRules> : RecordArgument<ResectionRules, std::array<double, 2>, double, double, std::size_t, double, bool, bool> {};
template <>
struct Argument<TrackTable> : RecordArgument<TrackTable, View<double, 2>, View<double, 1>, View<double, 3>, View<double, 3>,
                                             View<double, 2>, View<double, 2>, Indices> {};
template <class T>
struct Argument<Templates<T>>
    : RecordArgument<Templates<T>, ImageOf<T>, std::optional<ImageOf<T>>, View<T, 3>, View<bool, 2>, TemplateKind> {};
template <>
struct Argument<WindowState> : RecordArgument<WindowState, View<double, 3>, Indices, View<double, 3>, View<double, 2>, View<double, 1>> {};
template <>
struct Argument<WindowViews> : RecordArgument<WindowViews, Indices, Indices, View<bool, 1>, View<double, 2>, View<double, 2>,
                                              View<double, 3>, View<double, 3>, View<double, 3>, View<double, 2>, View<double, 2>> {};
template <>
struct Argument<BlockViews> : RecordArgument<BlockViews, View<double, 3>, View<double, 3>, View<double, 3>, View<double, 2>,
                                             View<double, 2>, View<double, 2>, View<double, 3>, View<double, 3>, View<double, 1>> {};
template <>
struct Argument<PriorViews> : RecordArgument<PriorViews, Indices, View<double, 2>, View<double, 3>, View<double, 3>, View<double, 2>,
                                             View<double, 1>> {};
template <>
struct Argument<NewPriorPoints> : RecordArgument<NewPriorPoints, Indices, View<double, 2>, View<double, 3>, View<double, 3>> {};
template <>
struct Argument<CovariancePart> : RecordArgument<CovariancePart, View<double, 3>, View<double, 3>, View<double, 3>, View<double, 2>> {};

template <auto Stage>
struct Bound;
template <class Result, class... Taken, Result (*Stage)(Taken...)>
struct Bound<Stage> {
    static nb::object call(const typename Argument<std::decay_t<Taken>>::Given&... arguments) {
        std::tuple<std::decay_t<Taken>...> taken{Argument<std::decay_t<Taken>>::of(arguments)...};
        return result([&] { return std::apply(Stage, taken); });
    }
};

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
          [](nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu> stored, const GreyOf<T>& grey,
             const In<std::int64_t, 2>& points_px, const In<std::int64_t, 1>& slots) {
              std::array<std::size_t, 3> shape{stored.shape(0), stored.shape(1), stored.shape(2)};
              unlocked([&] { store_patches(stored.data(), shape, image(grey), view(points_px), view(slots)); });
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
    m.def("rig_effects", &Bound<&rig_effects>::call);
    m.def("polynomial_rows", &Bound<&polynomial_rows>::call);
    m.def("expected_views", &Bound<&expected_views>::call);
    m.def("timing_of_views", &Bound<&timing_of_views>::call);
    m.def("linearise_views", &Bound<&linearise_views>::call);
    m.def("view_residuals", &Bound<&view_residuals>::call);
    m.def("fit_motion", &Bound<&fit_motion>::call);
    m.def("resect", &Bound<&resect>::call, nb::arg(), nb::arg(), nb::arg(), nb::arg(), nb::arg().none());
    m.def("motion_of_flow", &Bound<&motion_of_flow>::call);
    m.def("fit_turn", &Bound<&fit_turn>::call);
    m.def("views_within_gates", &Bound<&views_within_gates>::call);
    m.def("points_seen_again", &Bound<&points_seen_again>::call);
    m.def("drift_covariances", &Bound<&drift_covariances>::call);
    m.def("normal_blocks", &Bound<&normal_blocks>::call);
    m.def("seen_points", &Bound<&seen_points>::call);
    m.def("window_system", &Bound<&window_system>::call);
    m.def("points_alone", &Bound<&points_alone>::call);
    m.def("leaving_views", &Bound<&leaving_views>::call);
    m.def("absorbing_system", &Bound<&absorbing_system>::call);
    m.def("absorbed_points", &Bound<&absorbed_points>::call);
    m.def("point_marginals", &Bound<&point_marginals>::call);
    m.def("new_corners", &Bound<&new_corners>::call);
    m.def("project_points", &Bound<&project_points>::call);
    m.def("points_of_views", &Bound<&points_of_views>::call);
    m.def("row_terms", &Bound<&row_terms>::call);
    m.def("row_offsets", &Bound<&row_offsets>::call);
    m.def("on_one_row", &Bound<&on_one_row>::call);
    m.def("gradient_matrices", &Bound<&gradient_matrices>::call);
    m.def("effects_of_turn", &Bound<&effects_of_turn>::call);
    m.def("point_motions", &Bound<&point_motions>::call);
    m.def("scaled_by_diagonal", &Bound<&scaled_by_diagonal>::call);
    m.def("among", &Bound<&among>::call);
    m.def("times_among", &Bound<&times_among>::call);
    m.def("union_of", &Bound<&union_of>::call);
    m.def("row_errors_of_tracks", &Bound<&row_errors_of_tracks>::call);
    m.def("view_inflation", &Bound<&view_inflation>::call);
    m.def("place_new_points", &Bound<&place_new_points>::call);
    m.def("align_tracks", &Bound<&align_tracks>::call);
    m.def("predict_tracks", &Bound<&predict_tracks>::call);
    m.def("update_depths", &Bound<&update_depths>::call);
    m.def("templates_fit", &Bound<&templates_fit>::call);
    m.def("inside_area", &Bound<&inside_area>::call);
    m.def("view_covariances", &Bound<&view_covariances>::call);
    m.def("template_drift", &Bound<&template_drift>::call);
    m.def("unfilter_png", &Bound<&unfilter_png>::call);
    m.def("field_basis", &Bound<&field_basis>::call);
    m.def("rig_mixture", &Bound<&rig_mixture>::call);
    m.def("velocities", &Bound<&velocities>::call);
    m.def("timed_views", &Bound<&timed_views>::call, nb::arg(), nb::arg(), nb::arg(), nb::arg(), nb::arg(), nb::arg().none());
    m.def("timing_unknowns", &Bound<&timing_unknowns>::call);
    m.def("unknown_errors", &Bound<&unknown_errors>::call);
    m.def("shifts_by_timing", &Bound<&shifts_by_timing>::call);
    m.def("cov_of_timed_pose", &Bound<&cov_of_timed_pose>::call);
    m.def("reported_motions", &Bound<&reported_motions>::call);
    m.def("reported_points", &Bound<&reported_points>::call);
    m.def("track_covariances", &Bound<&track_covariances>::call);
    m.def("whitening_of_views", &Bound<&whitening_of_views>::call);
    m.def("whiten_blocks", &Bound<&whiten_blocks>::call);
    m.def("gates_of_views", &Bound<&gates_of_views>::call);
    m.def("log_evidence", &Bound<&log_evidence>::call);
    m.def("pose_exp", &Bound<&pose_exp>::call);
    m.def("pose_log", &Bound<&pose_log>::call);
    m.def("pose_inverse", &Bound<&pose_inverse>::call);
    m.def("pose_adjoint", &Bound<&pose_adjoint>::call);
    m.def("rotation_vectors", &Bound<&rotation_vectors>::call);
    m.def("quaternions", &Bound<&quaternions>::call);
    m.def("orthonormalise", &Bound<&orthonormalise>::call);
    m.def("invert_triangle", &Bound<&invert_triangle>::call);
    m.def("q_by_reference", &Bound<&q_by_reference>::call);
    m.def("eliminate_points", &Bound<&eliminate_points>::call);
}
