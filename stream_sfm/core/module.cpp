// The module that Python imports: all families of stages, and the errors that they raise.

#include "algebra.hpp"
#include "binding.hpp"
#include "pinholes.hpp"

NB_MODULE(_core, m) {
    m.attr("CAUCHY_WIDTH") = core::CAUCHY_WIDTH;
    m.attr("MIN_DEPTH") = core::MIN_DEPTH;
    m.attr("MIN_VIEWS") = core::MIN_VIEWS;
    m.attr("__sources__") = SOURCES;  // the mark that checkout.py searches for in the file
    nanobind::register_exception_translator([](const std::exception_ptr& pointer, void*) {
        try {
            std::rethrow_exception(pointer);
        } catch (const core::NotDefinite& error) {
            PyErr_SetString(nanobind::module_::import_("numpy.linalg").attr("LinAlgError").ptr(), error.what());
        }
    });
    using namespace binding;
    for (auto bind : {bind_images, bind_poses, bind_rig, bind_tracks, bind_views, bind_resection, bind_window,
                      bind_inertial, bind_messages})
        bind(m);
}
