// The records of a rig's estimated errors that stages take.
#pragma once

#include "algebra.hpp"
#include "pinholes.hpp"

namespace core {

constexpr std::size_t AT_TIMING = 14;  // index in the terms of rig_model/terms.py: delay, then readout

struct Field {
    Vector u_px, v_px;
    double length_px;
    Matrix root;
    RECORD(Field, u_px, v_px, length_px, root)
};
struct RowGates {
    double gate_sigmas, least_gate_px;
    RECORD(RowGates, gate_sigmas, least_gate_px)
};
struct RowModel {
    Pinholes projection;
    Field field;
    Vector mean;
    Matrix cov;
    double scatter_px, unexplained_px, max_px;
    RowGates rules;
    RECORD(Rows, projection, field, mean, cov, scatter_px, unexplained_px, max_px, rules)
};
struct RightSides {  // predicts where they are sought: row differences, a turn of the right camera, the twist of points
    RowModel rows;
    Vector turn_rad, twist;
    RECORD(RightSides, rows, turn_rad, twist)
};
struct ExposedRows {  // polynomials over the rectified image: the rows of the cameras' own images
    std::array<double, 2> size_px;
    Matrices coefficients;
    RECORD(ExposedRows, size_px, coefficients)
};
struct Timing {  // delay and readout, and the twist of points in the previous frame, if it is known
    ExposedRows row_of;
    Vector mean;
    Matrix cov;
    std::optional<Vector> twist;
    RECORD(Timing, row_of, mean, cov, twist)
};

}  // namespace core
