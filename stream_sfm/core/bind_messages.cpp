// Messages of ROS 2 as bytes: CDR, little-endian. The one place of the core that walks objects of Python, as a message
// has a hundred fields, and a path thousands of poses.

#include <nanobind/stl/string.h>

#include "binding.hpp"

namespace binding {
namespace {

class Message {
   public:
    Message(nb::handle fields, nb::handle message) { put(fields, message); }
    nb::bytes done() const { return nb::bytes(bytes.data(), bytes.size()); }

   private:
    static constexpr std::size_t HEADER = 4;  // alignments begin after it
    std::string bytes{0, 1, 0, 0};            // the second one says that numbers are little-endian

    void append(const void* data, std::size_t size, std::size_t aligned) {
        bytes.resize(bytes.size() + (aligned - (bytes.size() - HEADER) % aligned) % aligned, 0);
        bytes.append(static_cast<const char*>(data), size);
    }

    template <class T>
    void number(T value) {
        append(&value, sizeof(T), sizeof(T));
    }

    template <class T>
    void whole(nb::handle of) {
        T value;
        nb::object index = nb::steal(PyNumber_Index(of.ptr()));
        if (!index.is_valid()) throw nb::python_error();
        if (!nb::try_cast(index, value)) throw std::invalid_argument("a number is beyond the range of its field");
        number(value);
    }

    void text(nb::handle of) {
        Py_ssize_t size;
        const char* utf8 = PyUnicode_AsUTF8AndSize(of.ptr(), &size);
        if (!utf8) throw nb::python_error();
        number(static_cast<std::uint32_t>(size + 1));
        bytes.append(utf8, size + 1);
    }

    void one(nb::handle kind, nb::handle of) {
        if (nb::isinstance<nb::tuple>(kind)) return put(kind, of);
        switch (std::string letter; nb::try_cast(kind, letter) ? letter[0] : 0) {
            case 's': return text(of);
            case 'b': return whole<std::int8_t>(of);
            case 'B': return whole<std::uint8_t>(of);
            case 'i': return whole<std::int32_t>(of);
            case 'I': return whole<std::uint32_t>(of);
            case 'q': return whole<std::int64_t>(of);
            case '?': {
                int value = PyObject_IsTrue(of.ptr());
                if (value < 0) throw nb::python_error();
                return number(static_cast<std::uint8_t>(value));
            }
            case 'd': {
                double value = PyFloat_AsDouble(of.ptr());
                if (PyErr_Occurred()) throw nb::python_error();
                return number(value);
            }
        }
        throw std::invalid_argument("a field of an unknown kind");
    }

    // An array of numbers, as it is in memory; `count`: −1 if the message says how many there are.
    void numbers(nb::handle of, std::size_t size, Py_ssize_t count) {
        Py_buffer view;
        if (PyObject_GetBuffer(of.ptr(), &view, PyBUF_C_CONTIGUOUS)) throw nb::python_error();
        auto length = static_cast<std::size_t>(view.len);
        bool fits = view.itemsize == static_cast<Py_ssize_t>(size) && (count < 0 || view.len == count * view.itemsize);
        if (fits && count < 0) number(static_cast<std::uint32_t>(length / size));
        if (fits && length) append(view.buf, length, size);
        PyBuffer_Release(&view);
        if (!fits) throw std::invalid_argument("an array of a message has another type or size");
    }

    void put(nb::handle fields, nb::handle message) {
        for (nb::handle field : fields) {
            nb::object of = nb::getattr(message, field[0]), kind = field[1], count = field[2];
            if (count.is_none()) one(kind, of);
            else if (auto size = nb::cast<std::size_t>(field[3])) numbers(of, size, nb::cast<Py_ssize_t>(count));
            else {
                number(static_cast<std::uint32_t>(nb::len(of)));
                for (nb::handle each : of) one(kind, each);
            }
        }
    }
};

nb::list encoded(nb::list fields, nb::list messages) {
    nb::list result;
    for (std::size_t k = 0; k < messages.size(); k++) result.append(Message(fields[k], messages[k]).done());
    return result;
}

}  // namespace

void bind_messages(nb::module_& m) {
    m.def("encoded", &encoded, "fields"_a, "messages"_a,
          nb::sig("def encoded(fields: list[tuple[Any, ...]], messages: list[Any]) -> list[bytes]"),
          R"(Return the bytes of messages of ROS 2, in little-endian CDR.

`fields`: for each message a tuple of (name, kind, count, size). A kind is a letter of the module `struct`, `s` for text, or
such a tuple. The count is None for a single value, that of an array of numbers, or −1 for a sequence, whose length is
written; the size is that of a number in bytes, or 0 for a sequence of text or messages.)");
}

}  // namespace binding
