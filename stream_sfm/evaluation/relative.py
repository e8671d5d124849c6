"""Errors of relative motions over spans of frames, eq. (57): RPE, its growth with the span, ratios between methods.

Every frame starts a span, so that no figure depends on a single end point. Spans overlap, and the size of errors varies
along a log; intervals therefore come from contiguous blocks, each at least twice as long as the longest span
(docs/mathematics.md, section 10). Frames without a truth are NaN, and no span begins or ends there. For equal methods,
intervals exclude equality as rarely as they should (`tests/evaluation/test_relative.py`).
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..record import record
from .settings import SETTINGS


@record
class Interval:
    """A value and its 95 % interval."""

    value: float
    low: float
    high: float


def enough_known(truth: Array) -> bool:
    """Whether enough frames (n, 4, 4) have a truth for spans of every length."""
    return len(truth) > 1 and bool(known_frames(truth).mean() >= SETTINGS.least_known)


def known_frames(truth: Array) -> NDArray[np.bool_]:
    """Whether each frame has a truth (n,)."""
    return np.asarray(np.isfinite(truth).all(axis=(1, 2)))


def relative_errors(estimate: Array, truth: Array, span: int) -> tuple[Array, Array]:
    """Return position (m) and rotation (rad) errors (n − span,) of the motion from frame i to i + span."""
    position, rotation = np.full((2, len(truth) - span), np.nan)
    known = known_frames(truth) & known_frames(estimate)
    i = np.flatnonzero(known[:-span] & known[span:])
    e = se3.inverse(estimate[i]) @ estimate[i + span]
    t = se3.inverse(truth[i]) @ truth[i + span]
    error = se3.inverse(t) @ e
    position[i] = np.linalg.norm(error[:, :3, 3], axis=1)
    rotation[i] = np.linalg.norm(se3.log_so3(error[:, :3, :3]), axis=1)
    return position, rotation


def spans_up_to(longest: int) -> list[int]:
    """Return logarithmically spaced spans from one frame to the longest."""
    return sorted({round(s) for s in np.geomspace(1, longest, SETTINGS.most_spans)}) if longest else []


def tested_spans(frames: int) -> list[int]:
    """Return the spans for figures with intervals, from 1 to a twentieth of the frames, so that there are many of each.

    The longest one fits twice into a block, so that few spans cross from one block into the next.
    """
    return spans_up_to(frames // (2 * SETTINGS.blocks))


def band(errors: Array) -> Interval:
    """Return the RMS of errors (n,) over one span with its 95 % interval, NaN where that is not known.

    The band, for a chart, assumes that errors have the same size along the log. It cannot separate methods.
    """
    squares = errors[np.isfinite(errors)] ** 2
    if not squares.any():
        return Interval(0.0 if len(squares) else float("nan"), float("nan"), float("nan"))
    value = float(np.sqrt(squares.mean()))
    if len(squares) < 2 * SETTINGS.blocks:
        return Interval(value, float("nan"), float("nan"))
    means, _ = _jackknife(errors**2)
    found = _interval(0.5 * np.log(means), np.full(SETTINGS.blocks, 1 / SETTINGS.blocks))
    return Interval(value, float(np.exp(found.low)), float(np.exp(found.high)))


def span_ratio(mine: Array, theirs: Array, span: int) -> Interval | None:
    """Return the ratio of the RMS errors (n,) of two methods over one span; None if one has none.

    As in `paired_ratio`, the interval comes from blocks that share no motion; it is NaN if these are too few. It is
    centred on the ratio of all spans, which are more than those within blocks.
    """
    known = np.isfinite(mine) & np.isfinite(theirs)
    a, b = (np.where(known, x, 0.0) ** 2 for x in (mine, theirs))
    if not a.any() or not b.any():
        return None
    value = float(np.sqrt(a.sum() / b.sum()))
    blocks = min(SETTINGS.blocks, (len(known) + span) // (span + 1))
    edges = np.linspace(0, len(known) + span - 1, blocks + 1).round().astype(int)
    of_blocks = [_in_blocks(x, span, edges) for x in (a, b)]
    used = of_blocks[0].astype(bool) & of_blocks[1].astype(bool)
    if used.sum() < SETTINGS.fewest_blocks:
        return Interval(value, float("nan"), float("nan"))
    found = _exchange_ratio(of_blocks[0][None, used], of_blocks[1][None, used], SETTINGS.confidence)
    shift = value / found.value
    return Interval(value, shift * found.low, shift * found.high)


def growth_exponents(estimate: Array, truth: Array) -> tuple[Interval, Interval] | None:
    """Return the exponents p in mean squared error ∝ frames^p; None below 60 frames or without any error.

    They are for position and rotation; 1: a random walk, 2: a constant bias.
    """
    spans = tested_spans(int(known_frames(truth).sum()))
    if len(spans) < 3:  # two points always lie on a line
        return None
    pairs = [relative_errors(estimate, truth, s) for s in spans]
    if any(not np.nansum(p) or not np.nansum(r) for p, r in pairs):
        return None
    return _exponent(spans, [p**2 for p, _ in pairs]), _exponent(spans, [r**2 for _, r in pairs])


def _exponent(spans: list[int], squares: list[Array]) -> Interval:
    x = np.log(spans)
    design = np.linalg.pinv(np.stack([np.ones_like(x), x], axis=1))[1]
    means, shares = zip(*map(_jackknife, squares), strict=True)
    return _interval(design @ np.log(np.stack(means)), np.mean(shares, axis=0))


def paired_ratio(
    method: Array, reference: Array, truth: Array, truth_of_reference: Array | None = None
) -> tuple[Interval, Interval] | None:
    """Return the ratios of the RMS relative errors of two methods, position and rotation; None below 40 frames.

    Each is a geometric mean over spans that lie within a block, so that blocks share no motion. Both intervals hold
    together in 95 % of logs (Bonferroni): each of them in 97.5 %. The reference may have a truth of its own, such as
    its other half.
    """
    other = truth if truth_of_reference is None else truth_of_reference
    known = np.flatnonzero(known_frames(truth) & known_frames(other))
    spans = [s for s in tested_spans(len(known)) if s > 1]
    if not spans:
        return None
    edges = known[np.linspace(0, len(known) - 1, SETTINGS.blocks + 1).round().astype(int)]
    result = []
    pairs = [(relative_errors(method, truth, s), relative_errors(reference, other, s)) for s in spans]
    for k in range(2):
        mine, theirs = (
            np.stack([_in_blocks(pair[side][k] ** 2, s, edges) for s, pair in zip(spans, pairs, strict=True)])
            for side in range(2)
        )
        if not mine.any(axis=1).all() or not theirs.any(axis=1).all():
            return None
        result.append(_exchange_ratio(mine, theirs, SETTINGS.confidence_of_both))
    return result[0], result[1]


def _in_blocks(squares: Array, span: int, edges: NDArray[np.intp]) -> Array:
    """Return the sum of squared errors of the spans within each block (blocks,), without NaN."""
    return np.array([np.nansum(squares[first : last - span + 1]) for first, last in pairwise(edges)])


def _exchange_ratio(mine: Array, theirs: Array, confidence: float) -> Interval:
    """Return the ratio of RMS errors from their squares (spans, blocks), with the interval of an exchange test.

    If the methods are equal except for a factor, each block of one can be exchanged with that of the other, however
    large its errors. The interval contains the factors for which the observed ratio is not among the most extreme
    of all exchanges.
    """
    blocks = mine.shape[1]
    # The exchanged blocks (blocks, exchanges): none at first, and never the last block, as only the size of a ratio
    # counts.
    exchanges = (np.arange(2 ** (blocks - 1)) >> np.arange(blocks)[:, None] & 1).astype(float)
    kept, swapped = (np.stack([mine, theirs]) @ swaps for swaps in (1.0 - exchanges, exchanges))
    value = 0.5 * float(np.mean(np.log(kept[0, :, 0] / kept[1, :, 0])))

    def plausible(log_factor: float) -> bool:
        scale = np.exp(-2 * log_factor)
        ratios = (scale * kept[0] + swapped[1]) / (kept[1] + scale * swapped[0])
        sizes = np.abs(np.log(ratios).sum(axis=0))
        return bool(np.mean(sizes >= sizes[0] * (1 - 1e-9)) > 1 - confidence)

    low, high = (_end(plausible, value, sign) for sign in (-1, 1))
    return Interval(float(np.exp(value)), float(np.exp(low)), float(np.exp(high)))


def _end(plausible: Callable[[float], bool], value: float, sign: int) -> float:
    """Return the end of the plausible values from `value` in the direction of `sign`, to 0.1 % of the distance."""
    inside, (outside, longest) = 0.0, SETTINGS.half_intervals
    while plausible(value + sign * outside) and outside < longest:
        inside, outside = outside, 2 * outside
    for _ in range(10):  # 2⁻¹⁰ is 0.1 %
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if plausible(value + sign * middle) else (inside, middle)
    return value + sign * outside


def _jackknife(squares: Array) -> tuple[Array, Array]:
    """Return the mean of squared errors in blocks, then those without one block each, and each block's share."""
    blocks = np.array_split(squares[np.isfinite(squares)], SETTINGS.blocks)
    sums, counts = np.array([b.sum() for b in blocks]), np.array([len(b) for b in blocks])
    rest = np.maximum(sums.sum() - sums, 1e-300) / (counts.sum() - counts)
    return np.concatenate([[sums.sum() / counts.sum()], rest]), sums / sums.sum()


def _interval(estimates: Array, shares: Array) -> Interval:
    """Return the value and the ends of its interval, from the estimate of all blocks and those without one block each.

    Neighbouring blocks share the spans that cross from one into the next, so their covariance is added if it is
    positive. The interval is that of Student's t, as blocks are few, and effectively fewer the more of the error
    (`shares`) is in some of them.
    """
    from scipy.special import stdtrit  # late, as a replay does not need SciPy, which is slow to import

    value, off = estimates[0], estimates[1:] - estimates[1:].mean()
    neighbours = max(float(off[1:] @ off[:-1]), 0.0)
    std = np.sqrt((SETTINGS.blocks - 1) / SETTINGS.blocks * (float(off @ off) + 2 * neighbours))
    freedom = max(1 / float(shares @ shares) - 1, 1.0)
    half = stdtrit(freedom, 0.5 + SETTINGS.confidence / 2) * std
    return Interval(float(value), float(value - half), float(value + half))


def turning(stamps_ns: NDArray[np.int64], world_from_cam: Array, span: int) -> NDArray[np.bool_]:
    """Whether the camera turns faster than 5° per second between frames i and i + span, (n − span,)."""
    motion = se3.inverse(world_from_cam[:-span]) @ world_from_cam[span:]
    seconds = (stamps_ns[span:] - stamps_ns[:-span]) / 1e9
    turned = np.linalg.norm(se3.log_so3(motion[:, :3, :3]), axis=1)
    return np.asarray(turned > SETTINGS.turning_rad_s * seconds)
