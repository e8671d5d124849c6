// Stages on the errors of a rig that only Python calls: their effects on views and rows, and their sizes.
#pragma once

#include "row_timing.hpp"

namespace core {

// row_errors.cpp
Array<double, 2> row_terms(const Pinholes& pinholes, const Field& field, Matrix at, Vector speed);
struct UnknownOfViews {
    Array<double, 3> errors;
    Array<double, 2> cov_turn;
    FIELDS(errors, cov_turn)
};
UnknownOfViews unknown_errors(const Timing& timing, const RowModel& rows, Matrix before, Matrix now, Matrix z, Vector twist,
                              Vector std_twist);

struct FittedRows {
    Array<double, 2> information;
    Array<double, 1> weighted, mean, left_over, unexplained;
    FIELDS(information, weighted, mean, left_over, unexplained)
};
FittedRows fit_rows(const RowModel& rows, Matrix at, Vector difference, Vector speed, Matrix own, double step_px, double half_weight,
                    int reweightings);

// rig.cpp
struct RigEffects {
    Array<double, 3> terms;
    Array<double, 2> field;
    FIELDS(terms, field)
};
RigEffects rig_effects(const Pinholes& pinholes, Matrix root, const Field& field, Matrix z, Vector age);
Array<double, 3> disparity_effects(const Pinholes& pinholes, Matrix points, Matrix motion, Matrix z);
Array<double, 2> field_basis(const Field& field, Matrix at);
Array<double, 2> polynomial_rows(const ExposedRows& exposed, Matrix z);
Array<double, 3> timed_views(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points, Matrix motion,
                             Vector timing, std::optional<Matrix> z);
Array<double, 3> timing_unknowns(const Pinholes& pinholes, const ExposedRows& exposed, Matrix points_before,
                                 Vector twist_before, Matrix points, Vector twist, Vector mean, Matrix cov,
                                 std::optional<Vector> std_twist);
// Errors (n, k) of σ = 1 as principal components (n, j) of σ = 1, without those that are negligible beside a good view's noise.
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
                    double counts, double counts_of_lenses, double share_alone, bool known_wrong);

}  // namespace core
