// The effects of row differences, delay and readout on views: stages of the rig that tracks and window use.
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
// ∂(row)/∂(u, v) of a view on the left and on the right, (4,).
void slopes_of_rows(const ExposedRows& of, const double* z, double* out);
// The effect (4, 2) per second of delay and of readout, near `timing` (2,), on a view at z of a point with a motion (2, 6).
void timing_of_view(const Pinholes& pinholes, const ExposedRows& exposed, const double* point, const double* motion,
                    const double* timing, const double* z, double* out);
Array<double, 2> shifts_by_timing(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Vector twist,
                                  Vector mean);

}  // namespace core
