"""Settings of the evaluation, each with its reason: what is compared, and what counts as known."""

import math

from ..record import record


@record
class EvaluationSettings:
    """Settings for all logs; published conventions are followed where they exist."""

    # Ground truth at the stamps of frames.
    max_gap_ns: int = 150_000_000  # between two interpolated truths: 10 Hz with half a period of jitter
    # For wider gaps, and for depth images: at 30 m/s a camera travels 3 cm in this time.
    same_stamp_ns: int = 1_000_000
    least_known: float = 0.8  # of the frames: leaves a third of the starts of the longest span, a quarter of them
    test_points: int = 10  # one in so many points is a test point: some twenty in view, 1.5 kB per frame
    standing_m: float = 1e-3  # a shorter path or extent counts as standing still: a percentage of it would be noise
    max_misfit: float = 0.01  # relative, of the inverse depth in a patch: more marks a depth edge

    # Errors over spans of frames, and how certain they are.
    blocks: int = 10  # long blocks keep the correlation of errors, many blocks give a stable interval
    fewest_blocks: int = 6  # with fewer, no exchange is as rare as one in twenty
    most_spans: int = 12  # evenly spaced in the logarithm
    confidence: float = 0.95
    confidence_of_both: float = 0.975  # of each of two intervals, so that position and rotation hold jointly
    half_intervals: tuple[float, float] = (1e-4, 20.0)  # of the logarithm of a ratio: start and end of the search
    kept_motions: int = 300  # frames, with their common errors, some 16 kB each: enough for both factors
    turning_rad_s: float = math.radians(5.0)  # faster counts as turning; a convention of the report

    # Methods compared with each other.
    fewest_logs: int = 2  # for an interval
    # Least difference of two methods as a share of their errors, so that these are not errors of the truth.
    least_apart: float = 1 / 3
    # Share of the motions that any method has: a method with fewer is left out when all are compared.
    least_common: float = 0.5
    of_halves: float = 0.5  # of the difference of halves, whose variance is four times that of the whole

    # Errors that all methods share.
    most_left: float = 0.9  # of the mean square of every method that may remain, if they are real
    fits: int = 5  # Gauss-Newton steps
    own_fits: int = 4  # the weight of motions against c follows from `own`; it changes by less than 1 % then
    least_eigenvalue: float = 1e-6  # in σ of what was assumed, squared: less is a known error, or rounding
    # Share of the largest distance from the start: nearer frames hardly show the rotation of the first pose.
    far_from_start: float = 0.1


SETTINGS = EvaluationSettings()
