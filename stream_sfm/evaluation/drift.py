"""How errors of relative motions grow with the span, for several methods: curves, and ratios over some spans.

Errors are measured against the truth. Without a truth, or if its errors exceed the differences of the methods, they are
half the difference of estimates from two halves of the tracks: each half has twice the variance of the whole.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..geometry import Array
from ..record import record
from .relative import Interval, band, relative_errors, span_ratio, spans_up_to
from .settings import SETTINGS

SPANS = (1, 2, 5, 10, 20, 50)  # frames, of the table
KINDS = ("position", "rotation")


@record
class Compared:
    """Poses (n, 4, 4) of one method and their reference (n, 4, 4): NaN where one of them is unknown.

    `share`: the share of their difference that is the error.
    """

    poses: Array
    truth: Array
    share: float = 1.0

    @classmethod
    def of_halves(cls, halves: Array) -> "Compared":
        """Return the poses (2, n, 4, 4) of two halves."""
        return cls(halves[0], halves[1], SETTINGS.of_halves)

    def until(self, frames: int) -> "Compared":
        """Return the same for more frames, the last of which are unknown."""
        more = np.full((frames - len(self.truth), 4, 4), np.nan)
        return Compared(np.concatenate([self.poses, more]), np.concatenate([self.truth, more]), self.share)

    def errors(self, span: int) -> tuple[Array, Array]:
        """Return errors of position (m) and rotation (rad) over a span, (n − span,) each."""
        position, rotation = relative_errors(self.poses, self.truth, span)
        return self.share * position, self.share * rotation


def errors_over(span: int, methods: Mapping[str, Compared]) -> dict[str, Array]:
    """Return errors of position (m) and rotation (rad), (2, n) per method, of the same motions: NaN where one has none.

    A method with less than half of the motions, such as one that failed early, removes none from the others.
    """
    if not methods:
        return {}
    frames = max(len(compared.truth) for compared in methods.values())
    errors = {name: np.stack(compared.until(frames).errors(span)) for name, compared in methods.items()}
    known = np.array([np.isfinite(x[0]) for x in errors.values()])
    counts = known.sum(axis=1)
    all_know = known[counts > SETTINGS.least_common * counts.max()].all(axis=0)
    return {name: np.where(all_know, x, np.nan) for name, x in errors.items()}


def curves(methods: Mapping[str, Compared]) -> dict[str, Any]:
    """Return RMS errors over spans from one frame to a quarter of them, with 95 % bands: `frames`, `methods`."""
    frames = spans_up_to(max((len(m.truth) for m in methods.values()), default=0) // 4)
    found = [errors_over(span, methods) for span in frames]
    result: dict[str, Any] = {"frames": frames, "methods": {}}
    for name in methods:
        result["methods"][name] = {
            f"{kind}_rms_{unit}": [_rounded(band(errors[name][k])) for errors in found]
            for k, (kind, unit) in enumerate(zip(KINDS, ("m", "rad"), strict=True))
        }
    return result


def table(
    methods: Mapping[str, Compared], reference: str, of_halves: Mapping[str, Compared] | None = None
) -> list[dict[str, Any]]:
    """Return errors and ratios to the reference for each of the `SPANS` that fit four times into the log.

    If the truth cannot separate a method from the reference, their ratio comes from `of_halves`.
    """
    longest = max((len(m.truth) for m in methods.values()), default=0) // 4
    return [_line(span, methods, reference, of_halves or {}) for span in SPANS if span <= longest]


def _line(
    span: int, methods: Mapping[str, Compared], reference: str, of_halves: Mapping[str, Compared]
) -> dict[str, Any]:
    """Return the errors of the methods over one span."""
    errors, errors_of_halves = errors_over(span, methods), errors_over(span, of_halves)
    line: dict[str, Any] = {"frames": span, "methods": {}}
    for name in methods:
        decided = (True, True)
        if name != reference and reference in methods:
            decided = separates(methods[name], methods[reference], span)
        of: dict[str, Any] = {}
        for k, (kind, unit) in enumerate(zip(KINDS, ("m", "rad"), strict=True)):
            source = errors if decided[k] else errors_of_halves
            ratio = None
            if name != reference and name in source and reference in source:
                ratio = span_ratio(source[name][k], source[reference][k], span)
            of[f"{kind}_rms_{unit}"] = _rms(errors[name][k])
            of[f"{kind}_over_{reference}"] = of_interval(ratio)
            of[f"{kind}_from_halves"] = not decided[k]
        line["methods"][name] = of
    return line


def separates(method: Compared, reference: Compared, span: int) -> tuple[bool, bool]:
    """Whether the truth can separate two methods over a span, in position and in rotation.

    If their difference is small compared with their errors, these are mostly errors of the truth.
    """
    if method.share < 1:
        return True, True
    apart = relative_errors(method.poses, reference.poses, span)
    pairs = zip(method.errors(span), reference.errors(span), strict=True)
    first, second = (
        _rms(d) >= SETTINGS.least_apart * min(_rms(a), _rms(b)) for d, (a, b) in zip(apart, pairs, strict=True)
    )
    return first, second


def of_interval(ratio: Interval | None) -> dict[str, Any] | None:
    """Return a ratio as in report.json; its interval is None if there are too few blocks of frames for one."""
    if ratio is None:
        return None
    known = bool(np.isfinite(ratio.low))
    return {"value": ratio.value, "ci95": [ratio.low, ratio.high] if known else None}


def _rounded(interval: Interval) -> list[float | None]:
    return [x if np.isfinite(x) else None for x in (interval.value, interval.low, interval.high)]


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.nanmean(errors**2))) if np.isfinite(errors).any() else float("nan")
