// Stages on poses and small arrays, and on the reported poses and points of a frame.
#pragma once

#include "algebra.hpp"

namespace core {

// poses.cpp
Array<double, 3> pose_exp(Matrix xi);
Array<double, 2> pose_log(Matrices poses);
Array<double, 3> pose_inverse(Matrices poses);
Array<double, 3> pose_adjoint(Matrices poses);
Array<double, 3> point_motions(Matrices poses, Vector seconds);
Array<double, 2> errors_of_motions(Vector seconds, double period);
Array<double, 2> rotation_vectors(Matrices rotations);
Array<double, 2> quaternions(Matrices rotations);
Array<double, 3> orthonormalise(Matrices poses);

// arrays.cpp
Array<double, 2> inverse_root(Matrix matrix, bool repair);
Array<double, 2> inverse_root_of(Rows matrix, std::size_t n, bool repair);  // of some of its rows and columns
struct SolvedBySize {
    Array<double, 1> log_det;
    Array<double, 3> mean;
    FIELDS(log_det, mean)
};
SolvedBySize solved_by_size(Matrix information, Matrix weighted, Matrix sizes);
Array<bool, 1> among(Indices ids, Indices known);
Array<std::int64_t, 1> times_among(Indices ids, Indices others, Flags counted);
Array<std::int64_t, 1> union_of(Indices ids);

// reported.cpp
struct PhysicalAxes {
    Matrix rotation;
    double std_scale, std_axes_rad;
    RECORD(PhysicalAxes, rotation, std_scale, std_axes_rad)
};
struct ReportedMotions {
    Array<double, 3> poses, cov, jacobian;
    FIELDS(poses, cov, jacobian)
};
ReportedMotions reported_motions(const PhysicalAxes& axes, Matrices poses, Matrices cov, Matrices by_terms);
struct ReportedPoints {
    Array<double, 2> points;
    Array<double, 3> cov;
    FIELDS(points, cov)
};
ReportedPoints reported_points(const PhysicalAxes& axes, Matrix points, Matrices cov, Vector std_shared,
                               Matrix frame_from_cam);

}  // namespace core
