"""The numbers by which inertial samples are checked and kept, each with its reason."""

from ..record import record


@record
class SampleSettings:
    """For all units; what the window makes of samples is in `config/inertia_rules.py`."""

    kept_s: float = 12.0  # of samples; a longer interval is not bridged
    waiting: int = 100_000  # samples without a frame, the oldest are dropped: a minute and more of any unit
    gap_periods: float = 3.0  # longer ones are gaps

    # Factor on variances where samples are missing or saturated. That of a gap grows with its square, from a gap that
    # is widened by just this.
    widened: float = 1e4
    gap_s: float = 0.01

    # At the end of its range a sensor repeats itself: so many samples in a row are the same, and large. The narrowest
    # range that sensors are set to is a sixteenth of the widest usual one.
    equal: int = 5
    least_range: float = 1 / 16

    # Samples that show how a camera turns: so long before a time, and half of it after, and at least so many.
    turning_s: float = 0.02
    least_turning: int = 3

    # Noise by differences of samples. A motion at 5 Hz, sampled at 100 Hz, is 300 times smaller in fifth differences;
    # white noise is √252 times larger.
    differences: int = 5
    grown: float = 252.0
    noise_samples: int = 30

    # Units are asked for again and again after so many samples. Between these medians of the acceleration's norm they
    # are g, not m/s².
    unit_samples: int = 100
    in_g: tuple[float, float] = (0.5, 2.0)


SETTINGS = SampleSettings()
