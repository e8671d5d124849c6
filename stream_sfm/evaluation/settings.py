"""The numbers of the evaluation, each with its reason: what is compared, and what counts as known."""

import math

from ..record import record


@record
class EvaluationSettings:
    """For all logs; intervals are those of the published conventions where there are any."""

    # Ground truth at the stamps of frames.
    max_gap_ns: int = 150_000_000  # between two truths that are interpolated: 10 Hz with half a period of jitter
    # In wider gaps, and of depth images: at 30 m/s a camera travels 3 cm in this time.
    same_stamp_ns: int = 1_000_000
    least_known: float = 0.8  # of the frames: leaves a third of the starts of the longest span, a quarter of them
    standing_m: float = 1e-3  # a shorter path or extent counts as standing: a percentage of it would be noise
    max_misfit: float = 0.01  # of the inverse depth in a patch, relative: a larger one marks a depth edge

    # Errors over spans of frames, and how certain they are.
    blocks: int = 10  # long ones keep the correlation of the errors, many give a stable interval
    fewest_blocks: int = 6  # of fewer no exchange is as rare as one in twenty
    most_spans: int = 12  # evenly spaced in the logarithm
    confidence: float = 0.95
    confidence_of_both: float = 0.975  # of each of two intervals, so that position and rotation hold together
    half_intervals: tuple[float, float] = (1e-4, 20.0)  # of a ratio's logarithm: where the search begins and ends
    turning_rad_s: float = math.radians(5.0)  # faster counts as turning; a convention of the report

    # Methods compared with each other.
    # Share of their errors by which two must be apart at least, so that these errors are not the truth's.
    least_apart: float = 1 / 3
    # Share of the motions that any one knows: one that knows fewer is left out where all are compared.
    least_common: float = 0.5
    of_halves: float = 0.5  # of the difference of halves: variances add up to four times that of the whole

    # What all methods share of their errors.
    most_left: float = 0.9  # of the mean square of every method, where they are real
    fits: int = 5  # Gauss-Newton steps
    # Share of the largest distance from the start: nearer frames hardly tell how its pose is turned.
    far_from_start: float = 0.1


SETTINGS = EvaluationSettings()
