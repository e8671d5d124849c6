// Records that several families of stages take; `parts` of a record are what Python gives or is given, in this order.
#pragma once

#include "algebra.hpp"
#include "pinholes.hpp"

namespace core {

struct Field {
    Vector u, v;
    double length;
    Matrix root;
    auto parts() { return std::tie(u, v, length, root); }
};
struct RowModel {
    std::array<double, 2> size;
    Field field;
    Vector mean;
    Matrix cov;
    double scatter, max;
    auto parts() { return std::tie(size, field, mean, cov, scatter, max); }
};
struct RightSides {  // where they are sought, of points that move with a twist, with a turn of the right camera
    Pinholes pinholes;
    RowModel rows;
    Vector turn, twist;
    auto parts() { return std::tie(pinholes, rows, turn, twist); }
};
struct ExposedRows {  // polynomials over the rectified image: the rows of the cameras' own images
    std::array<double, 2> size;
    Matrices coefficients;
    auto parts() { return std::tie(size, coefficients); }
};
struct Timing {  // delay and readout, and how points moved in the frame before
    ExposedRows exposed;
    Vector mean;
    Matrix cov;
    Vector twist;
    auto parts() { return std::tie(exposed, mean, cov, twist); }
};
struct TemplateKind {
    int scale, radius, spacing;
    double farthest, max_error, shared_pixels, factor;
    auto parts() { return std::tie(scale, radius, spacing, farthest, max_error, shared_pixels, factor); }
};
struct TrackTable {
    Matrix points;  // at unit depth
    Vector var_rho;
    Matrices cov_left, anchor_from_start;
    Matrix anchor_velocity, slopes;
    Indices scale;
    auto parts() { return std::tie(points, var_rho, cov_left, anchor_from_start, anchor_velocity, slopes, scale); }
};
struct RigModel {
    Pinholes pinholes;
    std::array<double, 2> size;
    Matrix root;  // of the terms: units per amplitude
    Field field;
    auto parts() { return std::tie(pinholes, size, root, field); }
};
struct PointViews {
    Pinholes pinholes;
    Matrix points;
    Matrices cov_points;
    Matrix z;
    Matrices cov, shared;
    Vector gate;
    auto parts() { return std::tie(pinholes, points, cov_points, z, cov, shared, gate); }
};

}  // namespace core
