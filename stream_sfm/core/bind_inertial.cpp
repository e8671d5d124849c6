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
    def<&slide_leads>(m, "slide_leads", R"(Return how slides move the poses that a camera is really at, (6n, 3n), and these poses (n, 4, 4).

Cameras (n, 4, 4) as images show them, each turned by a slide (n, 3) from its own frame on, about where it is.)",
        "cams"_a, "slides"_a);
    def<&inertial_rows>(m, "inertial_rows", R"(Return whitened residuals (9n,) of intervals in a row and their Jacobians, eq. (80).

By poses 6n, perturbed on the left, and the state (9n, 6n + 17), and by slides and velocities (9n, 6n). Cameras (n, 4,
4) with velocities (n, 3) in their own axes, in the reference camera's, with the state (17,) of that, which is fixed;
`lead` (6n, 3n): of poses by slides. Raises LinAlgError where a covariance is not definite.)",
        "intervals"_a, "cams"_a, "lead"_a, "velocities"_a, "state"_a, "cam_from_imu"_a);
    def<&inertial_motion>(m, "inertial_motion", R"(Return where one interval leads by samples alone, eq. (81): previous_from_now (4, 4) and the state (17,) at its end.

And how both move with those at its beginning, (23, 23), and the covariance (23, 23) that is added; `std_walk` (6,): of
the biases meanwhile.)",
        "interval"_a, "state"_a, "cam_from_imu"_a, "std_walk"_a);
}

}  // namespace binding
