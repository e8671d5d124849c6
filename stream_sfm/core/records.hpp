// Records that several families of stages take. Python gives any object that has their fields.
#pragma once

#include "algebra.hpp"
#include "pinholes.hpp"

namespace core {

struct Field {
    Vector u_px, v_px;
    double length_px;
    Matrix root;
    FIELDS(u_px, v_px, length_px, root)
};
struct RowModel {
    Pinholes projection;
    Field field;
    Vector mean;
    Matrix cov;
    double scatter_px, max_px;
    FIELDS(projection, field, mean, cov, scatter_px, max_px)
};
struct RightSides {  // where they are sought, of points that move with a twist, with a turn of the right camera
    RowModel rows;
    Vector turn_rad, twist;
    FIELDS(rows, turn_rad, twist)
};
struct ExposedRows {  // polynomials over the rectified image: the rows of the cameras' own images
    std::array<double, 2> size_px;
    Matrices coefficients;
    FIELDS(size_px, coefficients)
};
struct Timing {  // delay and readout, and how points moved in the frame before, if that is known
    ExposedRows row_of;
    Vector mean;
    Matrix cov;
    std::optional<Vector> twist;
    FIELDS(row_of, mean, cov, twist)
};
struct TemplateConfig {
    int window_radius_px;
    double max_realignment_px, max_photometric_error;
    FIELDS(window_radius_px, max_realignment_px, max_photometric_error)
};
struct ViewNoise {
    double shared_pixels, factor;
    FIELDS(shared_pixels, factor)
};
struct TemplateKind {
    int scale, spacing_px;
    TemplateConfig config;
    ViewNoise noise;
    FIELDS(scale, spacing_px, config, noise)
};
struct TrackTable {
    Matrix points;  // at unit depth
    Vector var_rho;
    Matrices cov_left_px, anchor_from_start;
    Matrix anchor_velocity_px_s, slopes;
    Indices scale;
    FIELDS(points, var_rho, cov_left_px, anchor_from_start, anchor_velocity_px_s, slopes, scale)
};
struct PointViews {
    Pinholes projection;
    Matrix points;
    Matrices cov_points;
    Matrix z_px;
    Matrices cov_px, shared;
    Vector gate;
    FIELDS(projection, points, cov_points, z_px, cov_px, shared, gate)
};

}  // namespace core
