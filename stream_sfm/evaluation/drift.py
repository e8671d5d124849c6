"""How errors of relative motions grow with the span, of several methods: the curves, and over some spans their ratios.

Errors are those against the truth, or where there is none, or where it errs more than the methods differ, half of what
estimates from two halves of the tracks are apart: each half has twice the variance of the whole.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..geometry.se3 import Array
from ..record import record
from .relative import Interval, band, relative_errors, span_ratio, spans_for

SPANS = (1, 2, 5, 10, 20, 50)  # frames, of the table
_TELLS = 1 / 3  # of their errors two methods must be apart at least, so that these errors are not the truth's
_OF_HALVES = 0.5  # of the difference of halves: variances add up to four times that of the whole
KINDS = ("position", "rotation")


@record
class Compared:
    """Poses (n, 4, 4) of one method, and what they are compared with (n, 4, 4): NaN where one of them is not known.

    `share`: of their difference, which is the error.
    """

    poses: Array
    truth: Array
    share: float = 1.0

    @classmethod
    def of_halves(cls, halves: Array) -> "Compared":
        """The poses (2, n, 4, 4) of two halves."""
        return cls(halves[0], halves[1], _OF_HALVES)

    def errors(self, span: int) -> tuple[Array, Array]:
        """Errors of position (m) and of rotation (rad) over a span, (n − span,) each."""
        position, rotation = relative_errors(self.poses, self.truth, span)
        return self.share * position, self.share * rotation


def curves(methods: Mapping[str, Compared]) -> dict[str, Any]:
    """Return RMS errors over spans from one frame to a quarter of them, with 95 % bands: `frames`, `methods`."""
    frames = spans_for(max((len(m.truth) for m in methods.values()), default=0))
    result: dict[str, Any] = {"frames": frames, "methods": {}}
    for name, compared in methods.items():
        found = [compared.errors(span) for span in frames]
        result["methods"][name] = {
            f"{kind}_rms_{unit}": [_rounded(band(errors[k])) for errors in found]
            for k, (kind, unit) in enumerate(zip(KINDS, ("m", "rad"), strict=True))
        }
    return result


def table(
    methods: Mapping[str, Compared], reference: str, of_halves: Mapping[str, Compared] | None = None
) -> list[dict[str, Any]]:
    """Return for each of the `SPANS` that fit four times into the log what the methods err, and over the reference.

    Where a method and the reference are too close together for the truth to tell, their ratio is that of `of_halves`.
    """
    longest = max((len(m.truth) for m in methods.values()), default=0) // 4
    return [
        {"frames": span, "methods": {name: _at(name, span, methods, reference, of_halves) for name in methods}}
        for span in SPANS
        if span <= longest
    ]


def _at(
    name: str,
    span: int,
    methods: Mapping[str, Compared],
    reference: str,
    of_halves: Mapping[str, Compared] | None,
) -> dict[str, Any]:
    """What one method errs over one span."""
    mine = methods[name].errors(span)
    result: dict[str, Any] = {}
    for k, kind in enumerate(KINDS):
        unit = "m" if k == 0 else "rad"
        result[f"{kind}_rms_{unit}"] = _rms(mine[k])
        result[f"{kind}_over_{_key(reference)}"] = None
        result[f"{kind}_from_halves"] = False
        if name == reference or reference not in methods:
            continue
        theirs = methods[reference].errors(span)[k]
        told = tells(methods[name], methods[reference], span)[k]
        if not told:
            result[f"{kind}_from_halves"] = True
            if of_halves is None or name not in of_halves or reference not in of_halves:
                continue
            ratio = span_ratio(of_halves[name].errors(span)[k], of_halves[reference].errors(span)[k], span)
        else:
            ratio = span_ratio(mine[k], theirs, span)
        result[f"{kind}_over_{_key(reference)}"] = of_interval(ratio)
    return result


def tells(method: Compared, reference: Compared, span: int) -> tuple[bool, bool]:
    """Whether the truth can tell two methods apart over a span, in position and in rotation.

    Where their difference is small against their errors, these are mostly the truth's own.
    """
    if method.share < 1:
        return True, True
    apart = relative_errors(method.poses, reference.poses, span)
    pairs = zip(method.errors(span), reference.errors(span), strict=True)
    first, second = (_rms(d) >= _TELLS * min(_rms(a), _rms(b)) for d, (a, b) in zip(apart, pairs, strict=True))
    return first, second


def of_interval(ratio: Interval | None) -> dict[str, Any] | None:
    """A ratio as in report.json; its interval is None where there are too few blocks of frames for one."""
    if ratio is None:
        return None
    known = bool(np.isfinite(ratio.low))
    return {"value": ratio.value, "ci95": [ratio.low, ratio.high] if known else None}


def _rounded(interval: Interval) -> list[float | None]:
    return [x if np.isfinite(x) else None for x in (interval.value, interval.low, interval.high)]


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.nanmean(errors**2))) if np.isfinite(errors).any() else float("nan")


def _key(method: str) -> str:
    return method.replace("-", "_")
