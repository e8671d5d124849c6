"""Settings for checking and storing inertial samples, each with its reason."""

from ..record import record


@record
class SampleSettings:
    """Settings for all units; those of the window are in its `inertia/rules.py`."""

    kept_s: float = 12.0  # of samples; a longer interval is not bridged
    waiting: int = 100_000  # waiting samples before the oldest are dropped: more than a minute of any unit
    # Longer ones are gaps, and so are those that are longer than `dense_s`: within it a hand turns evenly, so that a
    # straight line between two samples shows the motion. With gaps nothing is predicted.
    gap_periods: float = 3.0
    dense_s: float = 0.03
    fewest: int = 10  # samples that show how often they come

    # A frame comes with the samples up to its stamp, and one beyond. Later stamps are not those of its time.
    ahead_s: float = 1.0

    # A sensor measures hardly beyond its nominal range: larger values are errors of the transfer.
    beyond_range: float = 1.5

    # Factor on variances of missing or saturated samples. For a gap it grows with the square of its length,
    # starting from this factor, up to that of a second, after which nothing is known of the motion.
    widened: float = 1e4
    gap_s: float = 0.01
    gone_s: float = 1.0

    # At the end of its range a sensor repeats itself: this many consecutive samples are equal and large. The
    # narrowest range in use is a sixteenth of the widest usual one.
    equal: int = 5
    least_range: float = 1 / 16

    # Samples that show the rotation of a camera: this long before a time, half as long after it, and at least this
    # many.
    turning_s: float = 0.02
    least_turning: int = 3

    # Noise from differences of samples. A motion at 5 Hz, sampled at 100 Hz, is 300 times smaller in fifth
    # differences; white noise is √252 times larger.
    differences: int = 5
    grown: float = 252.0
    noise_samples: int = 30

    # Units are checked again after each this many samples. If the median norm of the acceleration is between these
    # values, the unit is g, not m/s².
    unit_samples: int = 100
    most_sizes: int = 2000  # samples from which the median is taken
    in_g: tuple[float, float] = (0.5, 2.0)


SETTINGS = SampleSettings()
