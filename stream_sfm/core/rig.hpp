// Stages on the errors of a rig: what they do to views and rows, and how large they are.
#pragma once

#include "algebra.hpp"
#include "pinholes.hpp"

namespace core {

struct Field {
    Vector u_px, v_px;
    double length_px;
    Matrix root;
    RECORD(Field, u_px, v_px, length_px, root)
};
struct RowModel {
    Pinholes projection;
    Field field;
    Vector mean;
    Matrix cov;
    double scatter_px, max_px;
    RECORD(Rows, projection, field, mean, cov, scatter_px, max_px)
};
struct RightSides {  // where they are sought, of points that move with a twist, with a turn of the right camera
    RowModel rows;
    Vector turn_rad, twist;
    RECORD(RightSides, rows, turn_rad, twist)
};
struct ExposedRows {  // polynomials over the rectified image: the rows of the cameras' own images
    std::array<double, 2> size_px;
    Matrices coefficients;
    RECORD(ExposedRows, size_px, coefficients)
};
struct Timing {  // delay and readout, and how points moved in the frame before, if that is known
    ExposedRows row_of;
    Vector mean;
    Matrix cov;
    std::optional<Vector> twist;
    RECORD(Timing, row_of, mean, cov, twist)
};

// row_errors.cpp
Array<double, 2> row_terms(const Pinholes& pinholes, const Field& field, Matrix at, Vector speed);
Array<double, 1> row_offsets(const RowModel& rows, Matrix at, Vector speed);
Array<bool, 1> on_one_row(const RowModel& rows, Matrix left, Matrix right, Vector speed, double scale);
struct UnknownOfViews {
    Array<double, 3> errors;
    Array<double, 2> cov_turn;
    FIELDS(errors, cov_turn)
};
UnknownOfViews unknown_errors(const Timing& timing, const RowModel& rows, Matrix before, Matrix now, Matrix z, Vector twist,
                              Vector std_twist);

// rig.cpp
constexpr std::size_t TERMS = 20, AT_TIMING = 14;  // the order of rig_model/terms.py; delay and readout follow each other
void check(const ExposedRows& exposed);
void check(const Timing& timing);
struct RigEffects {
    Array<double, 3> terms;
    Array<double, 2> field;
    FIELDS(terms, field)
};
RigEffects rig_effects(const Pinholes& pinholes, Matrix root, const Field& field, Matrix z, Vector age);
Array<double, 3> disparity_effects(const Pinholes& pinholes, Matrix points, Matrix motion, Matrix z);
Array<double, 2> field_basis(const Field& field, Matrix at);
Array<double, 2> polynomial_rows(const ExposedRows& exposed, Matrix z);
Array<double, 2> velocities(const Pinholes& pinholes, Matrix points, Matrix twists);
Array<double, 1> row_speeds(const Pinholes& pinholes, Matrix points, Vector twist);
// ∂(row)/∂(u, v) on the left and on the right (4,) of a view.
void slopes_of_rows(const ExposedRows& of, const double* z, double* out);
// To a view at z of a homogeneous point with a motion (2, 6), per second of delay and of readout (4, 2), near a `timing` (2,).
void timing_of_view(const Pinholes& pinholes, const ExposedRows& exposed, const double* point, const double* motion,
                    const double* timing, const double* z, double* out);
Array<double, 3> timed_views(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Matrix motion,
                             Vector timing, std::optional<Matrix> z);
Array<double, 2> shifts_by_timing(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Vector twist,
                                  Vector mean);
Array<double, 3> timing_unknowns(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points_before,
                                 Vector twist_before, Matrix points, Vector twist, Vector mean, Matrix cov, Vector std_twist);
Array<double, 2> cov_of_timed_pose(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Vector size,
                                   Matrix cov_twist);
// Errors (n, k) as independent ones (n, j), of σ = 1 as they are, without those that do not matter beside a good view's noise.
Array<double, 2> principal_components(Matrix errors);
Array<double, 3> principal_errors(Matrices errors);  // of views (n, 4, k)

// mixture.cpp
struct Mixture {
    Array<double, 1> mean;
    Array<double, 2> cov;
    double p_wrong;
    RECORD(Mixture, mean, cov, p_wrong)
};
Array<double, 2> log_evidence(Vector information, Vector weighted, Vector variances);
Mixture rig_mixture(Vector mean, Matrix cov, Vector size, std::size_t lenses, View<bool, 2> is_zero, Vector log_prior,
                    double counts, bool known_wrong);

}  // namespace core
