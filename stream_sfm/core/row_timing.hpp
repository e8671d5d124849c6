// What rows, delay and readout do to views: stages of the rig that tracks and window are built on.
#pragma once

#include "rig_records.hpp"

namespace core {

// row_errors.cpp
Array<double, 1> row_offsets(const RowModel& rows, Matrix at, Vector speed);
Array<bool, 1> on_one_row(const RowModel& rows, Matrix left, Matrix right, Vector speed, double scale);

// rig.cpp
void check(const ExposedRows& exposed);
void check(const Timing& timing);
Array<double, 2> velocities(const Pinholes& pinholes, Matrix points, Matrix twists);
Array<double, 1> row_speeds(const Pinholes& pinholes, Matrix points, Vector twist);
// ∂(row)/∂(u, v) on the left and on the right (4,) of a view.
void slopes_of_rows(const ExposedRows& of, const double* z, double* out);
// To a view at z of a homogeneous point with a motion (2, 6), per second of delay and of readout (4, 2), near a `timing` (2,).
void timing_of_view(const Pinholes& pinholes, const ExposedRows& exposed, const double* point, const double* motion,
                    const double* timing, const double* z, double* out);
Array<double, 2> shifts_by_timing(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Vector twist,
                                  Vector mean);

}  // namespace core
