// Stages that project, whiten and linearise views of points.
#pragma once

#include "algebra.hpp"
#include "pinholes.hpp"

namespace core {

struct PointViews {
    Pinholes projection;
    Matrix points;
    Matrices cov_points;
    Matrix z_px;
    Matrices cov_px, shared;
    Vector gate;
    RECORD(Views, projection, points, cov_points, z_px, cov_px, shared, gate)
};

// views.cpp
struct LinearisedViews {
    Array<double, 3> root, jacobian;
    FIELDS(root, jacobian)
};
struct ViewResiduals {
    Array<double, 3> residuals;
    Array<double, 2> squares;
    FIELDS(residuals, squares)
};
// Some views, in arrays of their own.
struct SelectedViews {
    Pinholes pinholes;
    Array<double, 2> points, z;
    Array<double, 3> cov_points, cov, shared;
    Array<double, 1> gate;

    SelectedViews(const PointViews& of, const std::vector<std::size_t>& rows);
    PointViews views() const { return {pinholes, points, cov_points, z, cov, shared, gate}; }
};
Array<double, 2> project_points(const Pinholes& pinholes, Matrix points);
Array<double, 2> seen_points(const Pinholes& pinholes, Matrix z);
Array<double, 3> whitening_of_views(Matrix z, Matrices cov);
Array<double, 1> gates_of_views(Matrix z, double of_one, double of_both);
LinearisedViews linearise_views(const PointViews& views, Matrix cam_from_ref);
ViewResiduals view_residuals(const PointViews& views, Matrices root, Vector amplitudes, Matrices cams_from_ref);

}  // namespace core
