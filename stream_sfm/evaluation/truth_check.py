"""Looks for frames whose ground truth cannot be right: by itself, and beside what was estimated.

By itself: a measured motion is never exactly even over many frames (it was interpolated there), does not jump for one
frame, and a vehicle does not slide sideways. Beside an estimate: the two differ by far more than in the rest of the
log and by far more than methods differ among each other, while the estimates run on as smoothly as elsewhere. Poses
are `world_from_cam` (n, 4, 4) frame by frame, NaN where there is no truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import se3
from ..geometry.se3 import Array
from ..types import Trajectory
from .association import truth_of_frames

_MIN_STEPS = 20  # with fewer steps, what is usual in a log is not known
# Even motion. With noise, one second difference in 25 is that small by chance, so many in a row never are.
_EVEN, _EVEN_STEPS = 0.05, 8
# Jumps and sliding: in robust σ of the log itself, and as a share of the usual step, below which they do not matter.
_FAR_SIGMAS, _FAR_SHARE = 8.0, 0.02
_FAR_ROTATION_RAD = 1e-3  # smaller jumps of the heading do not matter: 0.06°
# A vehicle: it moves along its axis, and its camera's sideways motion follows from its turning, to this share.
_FORWARD_SHARE, _HOLONOMIC_SHARE = 0.9, 0.01
_NEIGHBOURS = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6  # a cubic through two steps on each side, at the middle
_TOLD = 8  # findings told one by one
_APART = 2  # findings with fewer frames between them are one


@dataclass(frozen=True, slots=True)
class TruthFinding:
    """Frames `first` to `last`, both included, whose ground truth is in doubt, and why."""

    first: int
    last: int
    reason: str

    def __str__(self) -> str:
        return f"the ground truth of frames {self.first} to {self.last} is in doubt: {self.reason}"


def find_doubts(
    stamps_ns: NDArray[np.int64],
    truth: Trajectory,
    estimates: Sequence[Array] = (),
    tracked: NDArray[np.bool_] | None = None,
) -> list[TruthFinding]:
    """Find frames whose truth cannot be right, by itself and beside `estimates` (n, 4, 4 each) of the same frames.

    `tracked` (n,): frames in which the estimates mean something. Where frames come faster than truths, only as many
    are looked at as there are truths: between those it is interpolated here.
    """
    if len(stamps_ns) < 2 or len(truth) < 2:
        return []
    periods_ns = [float(np.median(np.diff(t))) for t in (truth.stamps_ns, stamps_ns)]
    every = max(1, round(periods_ns[0] / max(periods_ns[1], 1)))
    true = truth_of_frames(stamps_ns, truth)[::every]
    found = check_truth(true, stamps_ns[::every])
    if tracked is not None:
        found += check_beside(true, [e[::every] for e in estimates], tracked[::every])
    found = [TruthFinding(every * f.first, every * f.last, f.reason) for f in found]
    return sorted(found, key=lambda f: (f.first, f.last))


def check_truth(world_from_cam: Array, stamps_ns: NDArray[np.int64]) -> list[TruthFinding]:
    """Find frames whose truth does not fit the rest of it; none in a log of less than 20 steps."""
    steps, dt_s = _steps(world_from_cam), np.diff(stamps_ns) / 1e9
    if np.isfinite(steps[:, 0]).sum() < _MIN_STEPS:
        return []
    rates = steps / np.maximum(dt_s, 1e-9)[:, None]
    speed, turn = np.linalg.norm(rates[:, :3], axis=1), rates[:, 3:]
    return [
        *_even(speed[:, None], "speed", speed, "m/s"),
        *_even(turn, "rate of turn", np.linalg.norm(turn, axis=1), "rad/s"),
        *_jumps(steps),
        *_slides(steps),
    ]


def check_beside(
    world_from_cam: Array, estimates: Sequence[Array], tracked: NDArray[np.bool_]
) -> list[TruthFinding]:
    """Find frames in which truth and all estimates (n, 4, 4 each) differ by far more than elsewhere.

    Where an estimate jumps itself, the truth is not in doubt.
    """
    true = _steps(world_from_cam)
    known = tracked[1:] & tracked[:-1] & np.isfinite(true[:, 0])
    if not len(estimates) or known.sum() < _MIN_STEPS:
        return []
    steps = np.stack([_steps(e) for e in estimates])
    known &= np.array([_smooth(s[:, :3]) & _smooth(s[:, 3:]) for s in steps]).all(axis=0)
    least_m = _FAR_SHARE * _typical(np.linalg.norm(true[:, :3], axis=1))
    return [
        *_apart(steps[:, :, :3], true[:, :3], known, least_m, "mm"),
        *_apart(steps[:, :, 3:], true[:, 3:], known, _FAR_ROTATION_RAD, "mrad"),
    ]


def _apart(steps: Array, true: Array, known: NDArray[np.bool_], least: float, unit: str) -> list[TruthFinding]:
    """Steps of the truth (n, 3) that are far from those of every method (k, n, 3), which are near each other."""
    difference = np.linalg.norm(steps - true, axis=2).min(axis=0)
    among = np.linalg.norm(steps - steps[:1], axis=2).max(axis=0)
    usual = _typical(difference)
    far = known & (difference > max(_FAR_SIGMAS * usual, least)) & (difference > 2 * among)
    return [
        TruthFinding(
            first,
            last,
            f"its motion differs from {'the' if len(steps) == 1 else 'every'} estimate by up to "
            f"{1e3 * float(difference[first:last].max()):.3g} {unit} per frame, where {1e3 * usual:.2g} {unit} are "
            "usual in this log, and the estimate runs on smoothly",
        )
        for first, last in _runs(far)
    ]


def warnings_of(findings: Sequence[TruthFinding]) -> list[str]:
    """What to tell about findings: the first few of them, and how many more there are."""
    told = [str(f) for f in findings[:_TOLD]]
    more = len(findings) - _TOLD
    return [*told, f"the ground truth is in doubt in {more} more places"] if more > 0 else told


def frames_in_doubt(findings: Sequence[TruthFinding]) -> list[tuple[int, int]]:
    """The frames of findings as ranges [first, end), in order, joined where they touch."""
    ranges: list[tuple[int, int]] = []
    for first, end in sorted((f.first, f.last + 1) for f in findings):
        if ranges and first <= ranges[-1][1]:
            ranges[-1] = ranges[-1][0], max(end, ranges[-1][1])
        else:
            ranges.append((first, end))
    return ranges


def _steps(world_from_cam: Array) -> Array:
    """Motions ξ (n − 1, 6) between neighbours, NaN where one of them is not known."""
    known = np.asarray(np.isfinite(world_from_cam).all(axis=(1, 2)))
    both = known[1:] & known[:-1]
    steps = np.full((max(0, len(world_from_cam) - 1), 6), np.nan)
    rows = np.flatnonzero(both)
    if len(rows):
        steps[rows] = se3.log(se3.inverse(world_from_cam[rows]) @ world_from_cam[rows + 1])
    return steps


def _even(values: Array, what: str, size: Array, unit: str) -> list[TruthFinding]:
    """Runs of steps whose second differences are next to nothing beside those of the rest of the log."""
    second = np.full(len(values), np.nan)
    second[1:-1] = np.linalg.norm(values[2:] - 2 * values[1:-1] + values[:-2], axis=1)
    usual = _typical(second)
    if not usual > 1e-6 * max(_typical(size), 1e-9):  # nothing but rounding: the truth of a simulation
        return []
    even = second < _EVEN * usual
    if np.mean(even[np.isfinite(second)]) > 0.5:  # the even steps are the rule
        return []
    found = []
    for first, last in _runs(even, join=False):
        if last - first >= _EVEN_STEPS:
            varies = float(second[first:last].max())
            found.append(
                TruthFinding(
                    max(first - 1, 0),
                    last + 1,
                    f"its {what} changes evenly, to {varies:.1g} {unit} from frame to frame, where {usual:.2g} {unit} "
                    "are usual in this log, as if interpolated",
                )
            )
    return found


def _jumps(steps: Array) -> list[TruthFinding]:
    """Single steps, or a few, that stand out of a smooth motion."""
    found = []
    for part, unit, least in (
        (slice(0, 3), "mm", _FAR_SHARE * _typical(np.linalg.norm(steps[:, :3], axis=1))),
        (slice(3, 6), "mrad", _FAR_ROTATION_RAD),
    ):
        rest = _roughness(steps[:, part])
        usual = _typical(rest)
        far = (rest > max(_FAR_SIGMAS * usual, least)) & (rest > _spread_around(steps[:, part]))
        found += [
            TruthFinding(
                first,
                last,
                f"it jumps by {1e3 * float(rest[first:last].max()):.3g} {unit} against the motion before and after, "
                f"where {1e3 * usual:.2g} {unit} are usual in this log",
            )
            for first, last in _runs(far)
        ]
    return found


def _roughness(steps: Array) -> Array:
    """Distances (n,) of steps (n, 3) from a smooth motion through their neighbours, NaN at the ends."""
    rest = np.full(len(steps), np.nan)
    smooth = sum(w * steps[k : len(steps) - 4 + k] for k, w in enumerate(_NEIGHBOURS))
    rest[2:-2] = np.linalg.norm(steps[2:-2] - smooth, axis=1)
    return rest


def _smooth(steps: Array) -> NDArray[np.bool_]:
    """Whether each step, and those beside it, fit their neighbours as well as steps usually do."""
    rest = _roughness(steps)
    rough = rest > _FAR_SIGMAS * _typical(rest)
    rough[1:] |= rough[:-1]
    rough[:-1] |= rough[1:]
    return ~rough


def _spread_around(steps: Array) -> Array:
    """Largest distance (n,) between any two of the four neighbours of each step: what an abrupt motion shows too."""
    spread = np.full(len(steps), np.inf)
    around = np.stack([steps[k : len(steps) - 4 + k] for k in (0, 1, 3, 4)])
    spread[2:-2] = np.linalg.norm(around[:, None] - around[None], axis=-1).max(axis=(0, 1))
    return spread


def _slides(steps: Array) -> list[TruthFinding]:
    """Steps sideways that no vehicle makes, where the rest of the log is that of a vehicle."""
    known = np.isfinite(steps[:, 0])
    ahead, sideways, turn = steps[:, 2], steps[:, 0], steps[:, 4]
    length = np.linalg.norm(steps[:, :3], axis=1)
    usual = _typical(length)
    moving = known & (length > 0.1 * usual)
    if moving.sum() < _MIN_STEPS or np.median(abs(ahead[moving]) / length[moving]) < _FORWARD_SHARE:
        return []
    design = np.stack([ahead, turn], axis=1)
    weights = np.ones(moving.sum())
    for _ in range(10):  # least absolute deviations
        coefficients, *_ = np.linalg.lstsq(
            weights[:, None] * design[moving], weights * sideways[moving], rcond=None
        )
        rest = sideways - design @ coefficients
        weights = 1 / np.sqrt(np.maximum(abs(rest[moving]), 1e-3 * usual))
    spread = 1.4826 * float(np.median(abs(rest[moving])))
    if spread > _HOLONOMIC_SHARE * usual:
        return []
    far = moving & (abs(rest) > max(_FAR_SIGMAS * spread, _FAR_SHARE * usual))
    return [
        TruthFinding(
            first,
            last,
            f"it slides sideways by up to {1e3 * float(abs(rest[first:last]).max()):.3g} mm per frame, where a vehicle "
            f"that turns as it does slides by {1e3 * spread:.2g} mm in this log",
        )
        for first, last in _runs(far)
    ]


def _typical(values: Array) -> float:
    """The median of those that are known, 0 if none is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def _runs(mask: NDArray[np.bool_], join: bool = True) -> list[tuple[int, int]]:
    """Frames (first, last) of each run of steps; step i leads from frame i to frame i + 1. Close ones are joined."""
    runs: list[tuple[int, int]] = []
    for i in np.flatnonzero(mask).tolist():
        if runs and i - runs[-1][1] <= (_APART if join else 0):
            runs[-1] = runs[-1][0], i + 1
        else:
            runs.append((i, i + 1))
    return runs
