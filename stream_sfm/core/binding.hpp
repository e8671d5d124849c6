// Calls of stages from Python: arrays are checked here, stages run without Python's lock, and the signature in Python and
// the types in the stub follow from that of the stage.
#pragma once

#include <cstring>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include "arrays.hpp"
#include "image.hpp"

namespace binding {

namespace nb = nanobind;
using namespace core;
using namespace nb::literals;

template <class T, std::size_t N>
using In = nb::ndarray<const T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
constexpr std::size_t MAX_SIDE = 1 << 24;  // of an image: floats represent pixel numbers up to it exactly

// Whether a type is a record with FIELDS.
template <class T, class = void>
struct has_fields : std::false_type {};
template <class T>
struct has_fields<T, std::void_t<decltype(T::names)>> : std::true_type {};
template <class Record>
using PartsOf = decltype(std::declval<Record&>().parts());

// Whether it has a name in Python.
template <class T, class = void>
struct is_named : std::false_type {};
template <class T>
struct is_named<T, std::void_t<decltype(T::record)>> : std::true_type {};

// A stack of patches that a stage writes into.
template <class T>
struct Writable {
    T* data;
    std::array<std::size_t, 3> shape;
};

// The type of an argument or a result in the stub; arrays use the aliases at the top of the stub.
template <class T, class = void>
struct Typed;
template <class T>
constexpr auto typed = Typed<std::decay_t<T>>::text;
template <class T>
constexpr auto array_of() {
    using nb::detail::const_name;
    if constexpr (std::is_same_v<T, double>) return const_name("Array");
    else if constexpr (std::is_same_v<T, bool>) return const_name("Mask");
    else if constexpr (std::is_same_v<T, std::int64_t>) return const_name("Ids");
    else if constexpr (std::is_same_v<T, float>) return const_name("Grey");
    else return const_name("Bytes");
}
template <class T>
constexpr auto number() {
    using nb::detail::const_name;
    if constexpr (std::is_same_v<T, bool>) return const_name("bool");
    else if constexpr (std::is_floating_point_v<T>) return const_name("float");
    else return const_name("int");
}
template <class T>
constexpr auto array_given() {  // indices may have any integer type, and pixels may be bytes or floats
    using nb::detail::const_name;
    if constexpr (std::is_same_v<T, std::int64_t>) return const_name("Pixels");
    else if constexpr (std::is_same_v<T, float> || std::is_same_v<T, std::uint8_t>) return const_name("Image");
    else return array_of<T>();
}
template <class T>
struct Typed<T, std::enable_if_t<std::is_arithmetic_v<T>>> {
    static constexpr auto text = number<T>();
};
template <class T, std::size_t N>
struct Typed<Array<T, N>> {
    static constexpr auto text = array_of<T>();
};
template <class T, std::size_t N>
struct Typed<View<T, N>> {
    static constexpr auto text = array_given<T>();
};
template <class T>
struct Typed<ImageOf<T>> {
    static constexpr auto text = nb::detail::const_name("Image");
};
template <class T>
struct Typed<Writable<T>> {
    static constexpr auto text = nb::detail::const_name("Image");
};
template <>
struct Typed<void> {
    static constexpr auto text = nb::detail::const_name("None");
};
template <class T>
struct Typed<std::optional<T>> {
    static constexpr auto text = typed<T> + nb::detail::const_name(" | None");
};
template <>
struct Typed<std::array<double, 2>> {
    static constexpr auto text = nb::detail::const_name("tuple[float, float]");
};
template <class Parts>
struct TypedParts;
template <class... Parts>
struct TypedParts<std::tuple<Parts&...>> {
    static constexpr auto text =
        nb::detail::const_name("tuple[") + nb::detail::concat(typed<Parts>...) + nb::detail::const_name("]");
    static std::vector<const char*> each() { return {typed<Parts>.text...}; }
};
template <class T>
struct Typed<T, std::enable_if_t<has_fields<T>::value && !is_named<T>::value>> : TypedParts<PartsOf<T>> {};
template <class T>
struct Typed<T, std::enable_if_t<is_named<T>::value>> {
    static constexpr auto text = nb::detail::const_name(T::record);
};

// The names of a record's fields; they live as long as the process.
template <class Record>
struct FieldNames {
    static constexpr std::size_t N = std::tuple_size_v<PartsOf<Record>>;
    std::array<std::string, N> text;
    std::array<PyObject*, N> interned;

    static const FieldNames& get() {
        static const FieldNames names;
        return names;
    }

   private:
    FieldNames() {
        const char* at = Record::names;
        for (std::size_t i = 0; i < N; i++) {
            std::size_t length = std::strcspn(at, ",");
            text[i].assign(at, length);
            interned[i] = PyUnicode_InternFromString(text[i].c_str());
            at += length + std::strspn(at + length, ", ");
        }
    }
};

// The class of a record that is returned.
template <class Record>
PyTypeObject*& returned_class() {
    static PyTypeObject* made = nullptr;
    return made;
}

// The result of a stage in Python: an array, a number or None, or a tuple of several parts, whose members have names if
// the record is named.
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
    using Record = std::decay_t<T>;
    if constexpr (is_named<Record>::value) {
        nb::object result = nb::steal(PyStructSequence_New(returned_class<Record>()));
        if (!result.is_valid()) throw nb::python_error();
        Py_ssize_t at = 0;
        auto put = [&](auto& part) { PyStructSequence_SetItem(result.ptr(), at++, given(std::move(part)).release().ptr()); };
        std::apply([&](auto&... parts) { (put(parts), ...); }, number.parts());
        return result;
    } else if constexpr (has_fields<Record>::value) {
        return std::apply([](auto&... parts) { return nb::make_tuple(given(std::move(parts))...); }, number.parts());
    } else {
        return nb::cast(number);
    }
}
template <class T>
nb::object given(std::optional<T>&& perhaps) {
    return perhaps ? given(std::move(*perhaps)) : nb::none();
}

// An argument of a stage as Python passes it; numbers are passed unchanged.
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
struct Argument<Writable<T>> {
    using Given = nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
    static Writable<T> of(const Given& array) {
        return {array.data(), {array.shape(0), array.shape(1), array.shape(2)}};
    }
};
template <class T>
struct Argument<std::optional<T>> {
    using Given = std::optional<typename Argument<T>::Given>;
    static std::optional<T> of(Given& given) { return given ? std::optional<T>(Argument<T>::of(*given)) : std::nullopt; }
};
template <>
struct Argument<std::array<double, 2>> {
    using Given = std::tuple<double, double>;
    static std::array<double, 2> of(const Given& given) { return {std::get<0>(given), std::get<1>(given)}; }
};

// A description of an object for errors: its class, and the shape and type of an array.
inline std::string said(nb::handle value) {
    std::string text = nb::type_name(value.type()).c_str();
    for (const char* name : {"shape", "dtype"})
        if (nb::hasattr(value, name)) text += std::string(" ") + nb::str(nb::handle(nb::object(value.attr(name)))).c_str();
    return text;
}
// A description of the required field.
template <class T>
struct Axes {
    static std::string text() { return ""; }
};
template <class T, std::size_t N>
struct Axes<View<T, N>> {
    static std::string text() { return " of " + std::to_string(N) + (N == 1 ? " axis" : " axes"); }
};

// A record is any Python object that has its fields. These are kept alive while the stage runs.
template <class Record, class Parts>
struct RecordGiven;
template <class Record, class... Parts>
struct RecordGiven<Record, std::tuple<Parts&...>> {
    nb::object source;
    std::tuple<typename Argument<Parts>::Given...> parts;
};
template <class Part>
void read_field(nb::handle source, const char* record, const std::string& field, PyObject* name,
                typename Argument<Part>::Given& given, Part& part) {
    auto fails = [&](const std::string& why) { return std::string(record) + "." + field + why; };
    nb::object value = nb::steal(PyObject_GetAttr(source.ptr(), name));
    if (!value.is_valid()) {
        if (!PyErr_ExceptionMatches(PyExc_AttributeError)) throw nb::python_error();
        PyErr_Clear();
        throw nb::type_error(fails(std::string(" is missing in ") + nb::type_name(source.type()).c_str()).c_str());
    }
    if (!nb::try_cast(value, given))
        throw nb::type_error(fails(" is " + said(value) + " in place of " + typed<Part>.text + Axes<Part>::text()).c_str());
    part = Argument<Part>::of(given);
}
template <class Record>
struct Argument<Record, std::enable_if_t<has_fields<Record>::value>> {
    using Given = RecordGiven<Record, PartsOf<Record>>;
    static Record of(Given& given) { return read(given, std::make_index_sequence<FieldNames<Record>::N>{}); }

   private:
    template <std::size_t... I>
    static Record read(Given& given, std::index_sequence<I...>) {
        const auto& names = FieldNames<Record>::get();
        Record record{};
        auto parts = record.parts();
        (read_field(given.source, Record::record, names.text[I], names.interned[I], std::get<I>(given.parts), std::get<I>(parts)), ...);
        return record;
    }
};

// Arguments and results of a stage in transit, with the types that the signature shows.
template <class T>
struct Taken {
    typename Argument<T>::Given given;
};
template <class T>
struct Returned {
    nb::object object;
};

template <auto Stage>
struct Bound;
template <class Result, class... Arguments, Result (*Stage)(Arguments...)>
struct Bound<Stage> {
    static Returned<Result> call(Taken<std::decay_t<Arguments>>&... arguments) {
        std::tuple<std::decay_t<Arguments>...> taken{Argument<std::decay_t<Arguments>>::of(arguments.given)...};
        auto unlocked = [&] {
            nb::gil_scoped_release release;
            return std::apply(Stage, taken);
        };
        if constexpr (std::is_void_v<Result>) {
            unlocked();
            return {nb::none()};
        } else {
            return {given(unlocked())};
        }
    }
};

// The argument name of an image with one type of pixels; floats are never converted to bytes.
template <class T>
auto pixels(const char* name) {
    if constexpr (std::is_same_v<T, float>) return nb::arg(name);
    else return nb::arg(name).noconvert();
}

// Bind a stage under its name, with its help text and the names of its arguments.
template <auto Stage, class... Names>
void def(nb::module_& m, const char* name, const char* help, const Names&... names) {
    m.def(name, &Bound<Stage>::call, help, names...);
}

// Describe a record for the stub and for `help`.
template <class Record>
void describe(nb::module_& m, bool is_returned, const char* help) {
    if (!nb::hasattr(m, "RECORDS")) m.attr("RECORDS") = nb::dict();
    nb::list fields;
    auto types = TypedParts<PartsOf<Record>>::each();
    for (std::size_t i = 0; i < types.size(); i++) fields.append(nb::make_tuple(FieldNames<Record>::get().text[i].c_str(), types[i]));
    m.attr("RECORDS")[Record::record] = nb::make_tuple(is_returned, help, fields);
}
// A record that stages take: any object with these fields. Without `help` it is what Python's record of that name says.
template <class Record>
void describe_taken(nb::module_& m, const char* help = "") {
    describe<Record>(m, false, help);
}
// A record that stages return: a named tuple.
template <class Record>
void describe_returned(nb::module_& m, const char* help) {
    describe<Record>(m, true, help);
    static const std::string name = std::string("stream_sfm.core._core.") + Record::record;
    static std::array<PyStructSequence_Field, FieldNames<Record>::N + 1> fields{};
    for (std::size_t i = 0; i < FieldNames<Record>::N; i++) fields[i].name = FieldNames<Record>::get().text[i].c_str();
    static PyStructSequence_Desc description{name.c_str(), help, fields.data(), FieldNames<Record>::N};
    returned_class<Record>() = PyStructSequence_NewType(&description);
    m.attr(Record::record) = nb::handle(reinterpret_cast<PyObject*>(returned_class<Record>()));
}

void bind_images(nb::module_& m);
void bind_poses(nb::module_& m);
void bind_rig(nb::module_& m);
void bind_tracks(nb::module_& m);
void bind_views(nb::module_& m);
void bind_resection(nb::module_& m);
void bind_window(nb::module_& m);
void bind_inertial(nb::module_& m);
void bind_messages(nb::module_& m);

}  // namespace binding

namespace nanobind::detail {
template <class Record, class Parts>
struct type_caster<binding::RecordGiven<Record, Parts>> {
    using Given = binding::RecordGiven<Record, Parts>;
    NB_TYPE_CASTER(Given, const_name(""))
    bool from_python(handle source, uint8_t, cleanup_list*) noexcept {
        value.source = borrow(source);
        return !source.is_none();
    }
};
template <class T>
struct type_caster<binding::Taken<T>> {
    using Inner = make_caster<typename binding::Argument<T>::Given>;
    NB_TYPE_CASTER(binding::Taken<T>, binding::typed<T>)
    bool from_python(handle source, uint8_t flags, cleanup_list* cleanup) noexcept {
        Inner inner;
        if (!inner.from_python(source, flags, cleanup)) return false;
        value.given = inner.operator cast_t<typename binding::Argument<T>::Given>();
        return true;
    }
};
template <class T>
struct type_caster<binding::Returned<T>> {
    NB_TYPE_CASTER(binding::Returned<T>, binding::typed<T>)
    static handle from_cpp(const binding::Returned<T>& result, rv_policy, cleanup_list*) noexcept {
        return result.object.inc_ref();
    }
};
}  // namespace nanobind::detail
