"""The rules for inertial samples in the window: their priors, and when they are believed."""

from typing import Annotated

from ....config.section import Section, expert


class InertiaRules(Section, frozen=True, kw_only=True):
    """The priors of inertia and the checks on its samples: equations (85) to (87)."""

    # These are unknown when inertia starts. Biases are those of consumer-grade units.
    std_velocity_m_s: Annotated[float, expert("σ of the initial velocity, each axis, m/s", 1e-3, 1e3)] = 3.0
    std_start_m_s2: Annotated[float, expert("σ of the initial acceleration without gravity, m/s²", 1e-3, 1e3)] = 4.0
    std_gyro_bias_rad_s: Annotated[float, expert("σ of the gyroscope's biases, rad/s", 1e-6, 10)] = 0.05
    std_accel_bias_m_s2: Annotated[float, expert("σ of the accelerometer's biases, m/s²", 1e-6, 10)] = 0.3
    # Biases are not known well enough to bridge longer gaps.
    max_gap_s: Annotated[float, expert("time since the last estimate that samples bridge, s", 0, 1000)] = 10.0
    max_std_turn_rad: Annotated[float, expert("largest σ of a rotation from samples alone, rad", 0, 3)] = 0.1
    # Lasting errors of views make motions worse than their σ.
    farther: Annotated[float, expert("factor on σ of an image motion, compared with samples", 1, 100)] = 1.5
    # 6 are expected. A single bad frame is no contradiction, but its interval is not used.
    apart: Annotated[float, expert("squared distance of two motions that contradict each other", 6, 1e8)] = 40.0
    # Single frames of sound units reach 11, and the mean over these frames hardly 9; a real drone's is 6.
    surprise_frames: Annotated[float, expert("frames over which surprise by samples is averaged", 1, 1e4)] = 5.0
    surprising: Annotated[
        float, expert("mean squared distance of motions that surprises, of its expected one", 1, 1e4)
    ] = 2.0
    # Five σ: once in 3.5 million.
    bound: Annotated[float, expert("log odds of samples, at most, and so how soon they change", 1e-3, 1e4)] = 14.4
    # What the views of a frame share is one event, so that a single bad frame is no contradiction.
    most_of_frame: Annotated[float, expert("log odds that a single frame changes, at most", 1e-3, 1e4)] = 9.6
    usual_frames: Annotated[float, expert("frames that show the usual accelerations", 1, 10_000)] = 20.0
    # Images of a camera that is shaken so are of no use, and a wrong prediction costs the tracks of a frame.
    most_change: Annotated[float, expert("largest predicted change of velocity, usual changes", 1, 1e6)] = 10.0
    lasting_s: Annotated[float, expert("time from which agreement and gaps count as lasting, s", 0, 1000)] = 1.0
    # A step of the bias by 0.2 m/s² on a walk is at 22, a mounting off by 0.1 m at 36 to 48. Without an error the
    # largest values are 3, 4, 6, and 11 in 300 frames of a real drone.
    moved: Annotated[float, expert("squared distance that gravity does not move within that time", 3, 1e8)] = 16.0
    unexplained: Annotated[float, expert("share of gravity's variance by which it may move", 1e-3, 1e3)] = 0.25
    # An axis or a sign that is wrong from the start shows once the motion has changed. Until then nothing is known: the
    # error may be π.
    std_any_tilt_rad: Annotated[float, expert("σ of the tilt while samples are not proven, rad", 0, 10)] = 1.0
    # It is at most 4.6 in sound units, simulated and real; accelerometers with a wrong axis reach 20 to 90.
    most_unexplained: Annotated[float, expert("factor on the noise that leaves the tilt open", 1, 1e6)] = 10.0
    # 3 is expected for the biases, 1 for gravity.
    far_bias: Annotated[float, expert("squared distance of impossible accelerometer biases", 3, 1e8)] = 25.0
    far_gravity: Annotated[float, expert("squared distance of an impossible size of gravity", 1, 1e8)] = 25.0
    std_gravity_m_s2: Annotated[float, expert("σ of gravity's size beside impossible ones, m/s²", 1e-4, 10)] = 0.1
    # This covers all places on Earth, and the scale error of an accelerometer.
    std_known_gravity_m_s2: Annotated[float, expert("σ of gravity's size as an observation, m/s²", 1e-4, 10)] = 0.03
    known_gravity_m2_s4: Annotated[float, expert("gravity variance at which its size counts, m²/s⁴", 0, 1e4)] = 1.0
    # If the motion in such a time is too small for images to show, nothing is learnt. No stamp errs by more.
    tells_jitter_s: Annotated[float, expert("largest σ of a time that shows stamp errors, s", 1e-6, 1)] = 0.005
    jitter_frames: Annotated[float, expert("frames from which stamp errors are learnt", 1, 1e6)] = 100.0
    data_sheet: Annotated[float, expert("weight of the densities of the data sheet, intervals", 1e-3, 1e4)] = 3.0
    # Little evidence is needed that the noise is larger.
    little: Annotated[float, expert("weight of the data sheet beside huge residuals, intervals", 1e-3, 1e4)] = 0.1
    remembered: Annotated[float, expert("intervals from which densities are learnt", 1, 1e6)] = 400.0
    least_factor: Annotated[float, expert("least factor on a density", 1e-4, 1)] = 0.05
    most_factor: Annotated[float, expert("largest factor on a density", 1, 1e6)] = 100.0
