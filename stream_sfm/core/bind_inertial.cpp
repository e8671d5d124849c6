// Python's view of inertial.hpp.

#include "binding.hpp"
#include "inertial.hpp"

namespace binding {

void bind_inertial(nb::module_& m) {
    describe_taken<IntervalViews>(m, R"(Intervals (n) between frames: `rotation` (n, 3, 3), velocity and position `motion` (n, 6), Jacobians `by_bias`
(n, 9, 6) and `by_clock` (n, 9), `cov` (n, 9, 9), and at which `biases` (n, 6) and `clock` offsets (n,) they were
integrated, over how many `seconds` (n,).)");
    describe_returned<Preintegrated>(m, R"(The motion of an inertial unit between two times, in its axes at the first one: `rotation` (3, 3), velocity and position
`motion` (2, 3) without gravity, their Jacobians `by_bias` (9, 6) and `by_clock` (3, 3), by the time of both ends, and
their covariances (9, 9) by either sensor, of (rotation on the right, velocity, position).)");
    def<&preintegrate>(m, "preintegrate", R"(Return the motion of an inertial unit between two times, eqs. (78) and (79), in its axes at the first one.

Samples (n, 3), rad/s and m/s², at ascending times (n,), of which the first and the last bound the interval;
`widened` (n − 1,): factors on the variance of each step; biases (6,) of gyroscope and accelerometer, and their
noise densities (2,).)",
        "seconds"_a, "gyro"_a, "accel"_a, "widened"_a, "biases"_a, "densities"_a);
    def<&inertial_rows>(m, "inertial_rows", R"(Return whitened residuals (9n,) of intervals in a row and their Jacobian (9n, 9n + 17), eq. (80).

Cameras (n + 1, 4, 4), the first of which is the reference, with velocities (n + 1, 3) in their own axes; the state
(17,) of the reference. Columns: poses 6n, perturbed on the left, the state, velocities 3n. The reference is fixed,
and its velocity is that of the state. Raises LinAlgError where a covariance is not definite.)",
        "intervals"_a, "cams"_a, "velocities"_a, "state"_a, "cam_from_imu"_a);
    def<&inertial_motion>(m, "inertial_motion", R"(Return previous_from_now (4, 4) and the state (17,) at the end of one interval, by samples alone, eq. (81).)",
        "interval"_a, "state"_a, "cam_from_imu"_a);
}

}  // namespace binding
