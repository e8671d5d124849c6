"""Errors of relative motions over spans of frames, eq. (57): RPE, its growth with the span, ratios between methods.

Every frame is the start of a span, so that no figure depends on a single end point. Spans overlap and are correlated
in time; intervals therefore come from a bootstrap over contiguous blocks of starts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import se3
from ..geometry.se3 import Array

_BLOCKS = 10  # of the bootstrap: long blocks keep the correlation of the errors, many give a stable interval
_REPLICATES = 400  # of the bootstrap: the ends of a 95 % interval are then known to about 3 % of its width
_MIN_FRAMES = 24  # with fewer, spans reach 5 frames at most and a block has less than two starts
_TURNING_RAD_S = np.radians(5.0)  # faster counts as turning; a convention of the report


@dataclass(frozen=True, slots=True)
class Exponent:
    """The exponent p in mean squared error ∝ frames^p, with its 95 % interval; 1: random walk, 2: constant bias."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Ratio:
    """The RMS error of one method divided by that of another on the same spans, with its 95 % interval."""

    value: float
    low: float
    high: float


def relative_errors(estimate: Array, truth: Array, span: int) -> tuple[Array, Array]:
    """Position (m) and rotation (rad) errors (n − span,) of the motion from frame i to i + span; poses (n, 4, 4)."""
    e = se3.inverse(estimate[:-span]) @ estimate[span:]
    t = se3.inverse(truth[:-span]) @ truth[span:]
    error = se3.inverse(t) @ e
    return np.linalg.norm(error[:, :3, 3], axis=1), np.linalg.norm(se3.log_so3(error[:, :3, :3]), axis=1)


def spans_for(frames: int) -> list[int]:
    """Spans from 1 to a quarter of the frames, evenly spaced in the logarithm; none below 24 frames."""
    if frames < _MIN_FRAMES:
        return []
    return sorted({round(s) for s in np.geomspace(1, frames // 4, 12)})


def mean_squares(estimate: Array, truth: Array, spans: list[int]) -> tuple[Array, Array]:
    """Mean squared position (m²) and rotation (rad²) errors for each span."""
    pairs = [relative_errors(estimate, truth, s) for s in spans]
    return np.array([(p**2).mean() for p, _ in pairs]), np.array([(r**2).mean() for _, r in pairs])


def growth_exponents(estimate: Array, truth: Array) -> tuple[Exponent, Exponent] | None:
    """Growth of the position and of the rotation error with the span; None below 24 frames or without any error."""
    spans = spans_for(len(truth))
    if len(spans) < 3:
        return None
    pairs = [relative_errors(estimate, truth, s) for s in spans]
    if any(not p.any() or not r.any() for p, r in pairs):
        return None
    return _exponent(spans, [p**2 for p, _ in pairs]), _exponent(spans, [r**2 for _, r in pairs])


def _exponent(spans: list[int], squares: list[Array]) -> Exponent:
    x = np.log(spans)
    design = np.linalg.pinv(np.stack([np.ones_like(x), x], axis=1))[1]
    replicates = design @ np.log(np.stack([_block_means(s) for s in squares]))
    return Exponent(float(replicates[0]), *_interval(replicates[1:]))


def paired_ratio(method: Array, reference: Array, truth: Array) -> tuple[Ratio, Ratio] | None:
    """Ratios of the RMS relative errors of `method` and `reference`, position and rotation; None below 24 frames.

    Each is the geometric mean over the spans; both methods share the frames and the blocks of the bootstrap.
    """
    spans = [s for s in spans_for(len(truth)) if s > 1]
    if not spans:
        return None
    result = []
    pairs = [(relative_errors(method, truth, s), relative_errors(reference, truth, s)) for s in spans]
    for k in range(2):
        if any(not m[k].any() or not r[k].any() for m, r in pairs):
            return None
        logs = [0.5 * np.log(_block_means(m[k] ** 2) / _block_means(r[k] ** 2)) for m, r in pairs]
        replicates = np.exp(np.mean(logs, axis=0))
        result.append(Ratio(float(replicates[0]), *_interval(replicates[1:])))
    return result[0], result[1]


def _block_means(values: Array) -> Array:
    """The mean, then the means of resampled contiguous blocks, (1 + replicates,); every call draws the same blocks."""
    blocks = np.array_split(values, _BLOCKS)
    sums = np.array([b.sum() for b in blocks])
    counts = np.array([len(b) for b in blocks])
    draws = np.random.default_rng(0).integers(0, _BLOCKS, (_REPLICATES, _BLOCKS))
    resampled = np.maximum(sums[draws].sum(axis=1), 1e-300) / counts[draws].sum(axis=1)
    return np.concatenate([[sums.sum() / counts.sum()], resampled])


def _interval(replicates: Array) -> tuple[float, float]:
    low, high = np.quantile(replicates, [0.025, 0.975])
    return float(low), float(high)


def turning(stamps_ns: NDArray[np.int64], world_from_cam: Array, span: int) -> NDArray[np.bool_]:
    """Whether the camera turns faster than 5° per second between frames i and i + span, (n − span,)."""
    motion = se3.inverse(world_from_cam[:-span]) @ world_from_cam[span:]
    seconds = (stamps_ns[span:] - stamps_ns[:-span]) / 1e9
    turned = np.linalg.norm(se3.log_so3(motion[:, :3, :3]), axis=1)
    return np.asarray(turned > _TURNING_RAD_S * seconds)
