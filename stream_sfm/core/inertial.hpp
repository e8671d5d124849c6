// Inertial samples between frames, and their information about poses and velocities.
#pragma once

#include "algebra.hpp"

namespace core {

struct Preintegrated {  // rotation, (velocity, position), Jacobians by the biases and the clock, covariances from both sensors
    Array<double, 2> rotation{3, 3}, motion{2, 3}, by_bias{9, 6}, by_clock{3, 3}, cov_gyro{9, 9}, cov_accel{9, 9};
    RECORD(Preintegrated, rotation, motion, by_bias, by_clock, cov_gyro, cov_accel)
};
struct IntervalViews {  // consecutive intervals, with the biases and the clock offsets at which they were integrated
    Matrices rotation;
    Matrix motion;
    Matrices by_bias;
    Matrix by_clock;
    Matrices cov;
    Matrix biases;
    Vector clock, seconds;
    RECORD(Intervals, rotation, motion, by_bias, by_clock, cov, biases, clock, seconds)
};
struct InertialRows {
    Array<double, 1> residual;
    Array<double, 2> shared, local;
    FIELDS(residual, shared, local)
};
struct Leads {
    Array<double, 2> lead;
    Array<double, 3> true_cams;
    FIELDS(lead, true_cams)
};
struct InertialInformation {
    Array<double, 2> about;
    Array<double, 1> weighted;
    Array<double, 2> lead, cov, gain;
    Array<double, 1> right;
    FIELDS(about, weighted, lead, cov, gain, right)
};
struct InertialMotion {
    Array<double, 2> previous_from_now{4, 4};
    Array<double, 1> state{17};
    Array<double, 2> rows{23, 23}, cov{23, 23};
    FIELDS(previous_from_now, state, rows, cov)
};
Preintegrated preintegrate(Vector seconds, Matrix gyro, Matrix accel, Vector widened, Vector biases, Vector densities);
Leads slide_leads(Matrices cams, Matrix slides);
InertialRows inertial_rows(const IntervalViews& of, Matrices cams, Matrix lead, Matrix velocities, Vector state,
                           Matrix cam_from_imu);
InertialInformation inertial_information(const IntervalViews& of, Matrices cams, Matrix slides, Vector std_slides,
                                         Matrix velocities, Vector state, Matrix cam_from_imu);
InertialMotion inertial_motion(const IntervalViews& of, Vector state, Matrix cam_from_imu, Vector std_walk);

// innovation.cpp
struct Innovation {
    Array<double, 1> apart{6};
    Array<double, 2> cov{6, 6};
    Array<double, 1> motion{6};
    double turned_rad = 0;
    FIELDS(apart, cov, motion, turned_rad)
};
struct WeighedInnovation {
    double distance2 = 0;
    Array<double, 1> log_likelihoods{2};
    double late_s = 0, var_s2 = 0;
    RECORD(WeighedInnovation, distance2, log_likelihoods, late_s, var_s2)
};
Innovation innovation(Matrix expected, Matrix cov_expected, Matrix cam_from_previous, Matrix cov, double std_slide_rad);
WeighedInnovation weigh_innovation(Vector apart, Matrix cov, Vector twist);

}  // namespace core
