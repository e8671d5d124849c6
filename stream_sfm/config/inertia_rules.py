"""Numbers by which the window decides what inertial samples count for, each with its reason and its ends."""

from typing import Annotated

from .section import Section, expert


class InertiaRules(Section, frozen=True, kw_only=True):
    """How wide inertia begins, and what keeps it from harm: equations (85) to (87)."""

    # What is not known when inertia begins. Biases are those of consumer-grade units.
    std_velocity_m_s: Annotated[float, expert("σ of the first velocity, each axis, m/s", 1e-3, 1e3)] = 3.0
    std_start_m_s2: Annotated[float, expert("σ of the first acceleration beside gravity, m/s²", 1e-3, 1e3)] = 4.0
    std_gyro_bias_rad_s: Annotated[float, expert("σ of the gyroscope's biases, rad/s", 1e-6, 10)] = 0.05
    std_accel_bias_m_s2: Annotated[float, expert("σ of the accelerometer's biases, m/s²", 1e-6, 10)] = 0.3
    # Biases are not known well enough to go on for longer.
    max_gap_s: Annotated[float, expert("time since the last estimate that samples bridge, s", 0, 1000)] = 10.0
    max_std_turn_rad: Annotated[float, expert("largest σ of a rotation by samples alone, rad", 0, 3)] = 0.1
    # Errors of views that last make motions worse than their σ.
    farther: Annotated[float, expert("factor on the images' σ of a motion, compared with samples", 1, 100)] = 1.5
    frames: Annotated[int, expert("frames whose squared distances are added up", 1, 1000)] = 5
    # A single bad frame is not a contradiction, but is not used.
    impossible: Annotated[float, expert("most that one frame adds to the sum", 6, 1e8)] = 40.0
    # 30 are expected.
    bound: Annotated[float, expert("sum of squared distances that is a contradiction", 6, 1e8)] = 100.0
    largest_bound: Annotated[float, expert("the same where distances are larger anyway", 6, 1e8)] = 180.0
    usual_frames: Annotated[float, expert("frames over which the usual distance is taken", 1, 10_000)] = 20.0
    agreed_s: Annotated[float, expert("time of agreement after which samples are trusted, s", 0, 1000)] = 1.0
    # 3 expected of the biases, 1 of gravity.
    far_bias: Annotated[float, expert("squared distance of impossible accelerometer biases", 3, 1e8)] = 25.0
    far_gravity: Annotated[float, expert("squared distance of an impossible size of gravity", 1, 1e8)] = 25.0
    std_gravity_m_s2: Annotated[float, expert("σ of the size of gravity where it is judged, m/s²", 1e-4, 10)] = 0.1
    # Anywhere on Earth, and with the scale of an accelerometer.
    std_known_gravity_m_s2: Annotated[float, expert("σ of gravity's size as an observation, m/s²", 1e-4, 10)] = 0.03
    known_gravity_m2_s4: Annotated[float, expert("gravity variance at which its size counts, m²/s⁴", 0, 1e4)] = 1.0
    # A camera that moves by less than images show within such a time tells nothing; no stamp errs by more.
    tells_jitter_s: Annotated[float, expert("largest σ of a time that tells how stamps err, s", 1e-6, 1)] = 0.005
    jitter_frames: Annotated[float, expert("frames that errors of stamps are learnt from", 1, 1e6)] = 100.0
    data_sheet: Annotated[float, expert("intervals that a data sheet's densities count for", 1e-3, 1e4)] = 3.0
    # That noise is larger needs little evidence.
    little: Annotated[float, expert("the same where residuals are larger than they can be", 1e-3, 1e4)] = 0.1
    remembered: Annotated[float, expert("intervals that densities are learnt from", 1, 1e6)] = 400.0
    least_factor: Annotated[float, expert("least factor on a density", 1e-4, 1)] = 0.05
    most_factor: Annotated[float, expert("largest factor on a density", 1, 1e6)] = 100.0
