// Python's view of views.hpp.

#include "binding.hpp"
#include "views.hpp"

namespace binding {

void bind_views(nb::module_& m) {
    describe_taken<Pinholes>(m, R"(A rectified pair, with the size of its images, px.)");
    describe_taken<PointViews>(m, R"(Points with their views: homogeneous `points` (n, 4) with `cov_points` (n, 4, 4), or (0, 4, 4) if they are exact,
views `z_px` (n, 4), NaN for a missing side, with `cov_px` (n, 4, 4), errors that all views share (n, 4, j), and
gates (n,) of squared residuals.)");
    def<&seen_points>(m, "seen_points", R"(Return points (n, 4) = (X/Z, Y/Z, 1, 1/Z) from the left rays and disparities of views (n, 4).)",
        "pinholes"_a, "z_px"_a);
    def<&project_points>(m, "project_points", R"(Return the views (n, 4) of homogeneous points (n, 4), eq. (8).)",
        "pinholes"_a, "points"_a);
    def<&linearise_views>(m, "linearise_views", R"(Return roots (n, 4, 4) that whiten the views of points, and the whitened Jacobian (n, 4, 6 + j).

The motion is (4, 4). The Jacobian is for a left perturbation and for the amplitudes of shared errors. If the motion
predicts no view, root and Jacobian are zero. Raises LinAlgError if a covariance is not definite.)",
        "views"_a, "cam_from_ref"_a);
    def<&view_residuals>(m, "view_residuals", R"(Return whitened residuals (m, n, 4) under motions (m, 4, 4), and their squared norms (m, n).

`amplitudes` (j,) are those of shared errors. Squares are inf for points behind the camera, and for those without a
predicted view at the linearisation of `root`.)",
        "views"_a, "root"_a, "amplitudes"_a, "cams_from_ref"_a);
    def<&whitening_of_views>(m, "whitening_of_views", R"(Return R (n, 4, 4) with RᵀR the information of views (n, 4) with covariances (n, 4, 4), eq. (11).

It is zero for a side that is not finite. Raises LinAlgError for a covariance that is not definite.)",
        "z_px"_a, "cov_px"_a);
    def<&gates_of_views>(m, "gates_of_views", R"(Return the gate (n,) of each view (n, 4).)",
        "z_px"_a, "of_one_side"_a, "of_both"_a);
}

}  // namespace binding
