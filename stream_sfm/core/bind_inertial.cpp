// Python's view of inertial.hpp.

#include "binding.hpp"
#include "inertial.hpp"

namespace binding {

void bind_inertial(nb::module_& m) {
    describe_taken<IntervalViews>(m, R"(Intervals (n) between frames: `rotation` (n, 3, 3), velocity and position `motion` (n, 6), Jacobians `by_bias` (n, 9, 6)
and `by_clock` (n, 9), `cov` (n, 9, 9), the `biases` (n, 6) and `clock` offsets (n,) at which they were integrated, and
their `seconds` (n,).)");
    describe_returned<Preintegrated>(m, R"(The motion of an inertial unit between two times, in its axes at the first one: `rotation` (3, 3), velocity and position
`motion` (2, 3) without gravity, their Jacobians `by_bias` (9, 6) and `by_clock` (3, 3), the latter by the time of both
ends, and their covariances (9, 9) from either sensor, of (rotation on the right, velocity, position).)");
    def<&preintegrate>(m, "preintegrate", R"(Return the motion of an inertial unit between two times, eqs. (78) and (79), in its axes at the first one.

Samples (n, 3), rad/s and m/s², at ascending times (n,); the first and the last of them bound the interval;
`widened` (n − 1,): factors on the variance of each step; biases (6,) of gyroscope and accelerometer, and their noise densities (2,).)",
        "seconds"_a, "gyro"_a, "accel"_a, "widened"_a, "biases"_a, "densities"_a);
    def<&slide_leads>(m, "slide_leads", R"(Return the Jacobian (6n, 3n) of the true poses of cameras by slides, and these poses (n, 4, 4).

`cams` (n, 4, 4): as the images show them; each slide (n, 3) rotates its own and all later cameras, about their
positions.)",
        "cams"_a, "slides"_a);
    def<&inertial_rows>(m, "inertial_rows", R"(Return whitened residuals (9n,) of consecutive intervals and their Jacobians, eq. (80).

The Jacobians are by poses, perturbed on the left, and state (9n, 6n + 17), and by slides and velocities (9n, 6n).
`cams` (n, 4, 4): poses in the reference camera, which is fixed and has the state (17,); velocities (n, 3) are in the
axes of each camera; `lead` (6n, 3n): Jacobian of poses by slides. Raises LinAlgError if a covariance is not definite.)",
        "intervals"_a, "cams"_a, "lead"_a, "velocities"_a, "state"_a, "cam_from_imu"_a);
    def<&inertial_information>(m, "inertial_information", R"(Return the information (6n + 17, …) of consecutive intervals about poses and state, and its weighted sums (6n + 17,), eq. (82).

Slides (n, 3), of σ `std_slides` (n,), and velocities (n, 3) are eliminated. Also returns the Jacobian `lead` (6n, 3n)
of true poses by slides, and of slides and velocities given the rest: the covariance (6n, 6n), the Jacobian (6n, 6n +
17), and the right-hand side (6n,). The other arguments are those of `inertial_rows`.)",
        "intervals"_a, "cams"_a, "slides"_a, "std_slides"_a, "velocities"_a, "state"_a, "cam_from_imu"_a);
    def<&inertial_motion>(m, "inertial_motion", R"(Return the motion over one interval by samples alone, eq. (81): previous_from_now (4, 4) and the state (17,) at its end.

Also returns the Jacobian (23, 23) of both by pose and state at the beginning, and the added covariance (23, 23);
`std_walk` (6,): of the random walk of the biases.)",
        "interval"_a, "state"_a, "cam_from_imu"_a, "std_walk"_a);
    def<&innovation>(m, "innovation", R"(Return how far a motion by images is from the expected one, eq. (85): (6,) and its covariance (6, 6).

Also returns the motion by images (6,), of the camera, and the expected rotation, rad. `expected` (4, 4) with covariance
(6, 6): previous from current camera; `cov` (6, 6): of the inverse of `cam_from_previous`; `std_slide_rad`: of patches
that slide.)",
        "expected"_a, "cov_expected"_a, "cam_from_previous"_a, "cov"_a, "std_slide_rad"_a);
    describe_returned<WeighedInnovation>(m, R"(How far two motions are apart: `distance2`, 6 on average; `log_likelihoods` (2,) of rotation and translation, without the
constant; and the time `late_s` in which the camera moves by the difference, with its variance `var_s2`, eq. (86a).)");
    def<&weigh_innovation>(m, "weigh_innovation", R"(Return how far two motions are apart, by their difference (6,), its covariance (6, 6), and the twist (6,) of points per second.)",
        "apart"_a, "cov"_a, "twist"_a);
}

}  // namespace binding
