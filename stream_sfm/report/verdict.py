"""What a log shows about its methods, in two plain sentences: how far they drift, and whose covariance holds.

Errors are those of motions over some frames, over those of the reference (`evaluation.relative.paired_ratio`). Where no
method is told apart from it, the sentence says how long a log would have to be.
"""

import math
from typing import Any, NamedTuple

from ..evaluation.relative import MIN_FRAMES_RATIO
from .methods import label

REFERENCE = "cross-frame"
EXPECTED_NEES = 6.0
NEES_INTERVAL = (1.24, 14.45)  # 95 % of one pose: those of a log share their errors and are worth hardly more
_WORTH_KNOWING = math.log(1.1)  # of a ratio: nobody needs a log that shows a smaller difference
_IN_FULL = 2  # methods whose figures the sentence gives; the chart has all

Ratios = dict[str, dict[str, Any]]  # position and rotation -> value and ci95


class Verdict(NamedTuple):
    """`drift` and `covariances`, a sentence each, the second empty without NEES."""

    drift: str
    covariances: str

    @property
    def text(self) -> str:
        """Both."""
        return f"{self.drift} {self.covariances}".strip()


def verdict(content: dict[str, Any]) -> Verdict:
    """What the log shows; `content` is that of report.json."""
    covariances = _covariances(content["methods"])
    if not content["frames_with_ground_truth"]:
        return Verdict(_returned(content["methods"]), covariances)
    ratios: dict[str, Ratios] = content["error_over_cross_frame"]
    if not ratios:
        return Verdict(f"Nothing can be said about which method drifts least: {_obstacle(content)}.", covariances)
    behind = [key for key, found in ratios.items() if _side(found) > 0]
    ahead = [key for key, found in ratios.items() if _side(found) < 0]
    level = len(ratios) - len(behind) - len(ahead)
    if ahead:
        said = f"{_upper(_all(ahead, ratios))} smaller errors than {REFERENCE}"
        said += f", and {_all(behind, ratios)} larger ones" if behind else ""
    elif not behind:
        return Verdict(_undecided(ratios, content["frames_with_ground_truth"]), covariances)
    elif not level:
        said = f"{_upper(REFERENCE)} drifts least: {_all(behind, ratios)} larger errors"
    else:
        said = f"{_upper(REFERENCE)} drifts less than others: {_all(behind, ratios)} larger errors"
    said += f"; {_count(level)} cannot be told apart from {REFERENCE}" if level else ""
    return Verdict(f"{said}.", covariances)


def _upper(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def _side(found: Ratios) -> int:
    """1 where errors are larger than the reference's, −1 smaller; 0 where neither, or one of each, is certain."""
    low, high = (max(f["ci95"][0] for f in found.values()), min(f["ci95"][1] for f in found.values()))
    return int(low > 1) - int(high < 1)


def _all(keys: list[str], ratios: dict[str, Ratios]) -> str:
    """Methods with the figure of the quantity that is most certain, and the verb."""
    named = [f"{label(key)} ({_figure(ratios[key])})" for key in keys[:_IN_FULL]]
    if (more := len(keys) - _IN_FULL) > 0:
        named.append(_count(more))
    text = named[0] if len(named) == 1 else f"{', '.join(named[:-1])} and {named[-1]}"
    return f"{text} {'has' if len(keys) == 1 else 'have'}"


def _figure(found: Ratios) -> str:
    """The ratio that is farthest from 1 for its interval."""
    quantity = max(found, key=lambda q: abs(math.log(found[q]["value"])) / _half_width(found[q]))
    value, (low, high) = found[quantity]["value"], found[quantity]["ci95"]
    return f"{quantity} ×{value:.2f} [{low:.2f}, {high:.2f}]"


def _half_width(figure: dict[str, Any]) -> float:
    """Half the width of an interval, of the logarithm."""
    low, high = figure["ci95"]
    return max(0.5 * math.log(high / low), 1e-9)


def _rounded(value: float) -> str:
    """Two significant digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def _count(methods: int) -> str:
    return "one other method" if methods == 1 else f"{methods} other methods"


def _undecided(ratios: dict[str, Ratios], frames: int) -> str:
    """That no method is told apart, by what the widest of differences is hidden, and how long a log would show it."""
    key = "ekf" if "ekf" in ratios else next(iter(ratios))
    figure = ratios[key]["position"]
    wanted, longer = frames_to_tell(figure, frames)
    low, high = figure["ci95"]
    return (
        f"Nothing can be said about which method drifts least: on {frames} frames none is told apart from {REFERENCE} "
        f"({label(key)}: position ×{figure['value']:.2f} [{low:.2f}, {high:.2f}]). "
        f"A difference of {100 * (wanted - 1):.0f} % would show on about {longer} frames."
    )


def frames_to_tell(figure: dict[str, Any], frames: int) -> tuple[float, int]:
    """The ratio as measured, at least 1.1, and how many frames like these would tell it apart from 1.

    Intervals shrink with the square root of the length, as blocks of a log are taken for independent. Two significant
    digits.
    """
    wanted = max(abs(math.log(figure["value"])), _WORTH_KNOWING)
    needed = frames * max((_half_width(figure) / wanted) ** 2, 1.0)
    step = 10 ** (math.floor(math.log10(needed)) - 1)
    return math.exp(wanted), math.ceil(needed / step) * step


def _obstacle(content: dict[str, Any]) -> str:
    """Why there are no ratios, and what would help."""
    methods, known = content["methods"], content["frames_with_ground_truth"]
    if stopped := [f"{label(key)} {m['failure']}" for key, m in methods.items() if m["failure"]]:
        return "; ".join(stopped)
    if "cross_frame" not in methods or len(methods) < 2:
        return f"it takes {REFERENCE} and another method"
    if known < MIN_FRAMES_RATIO:
        return f"it takes {MIN_FRAMES_RATIO} frames in a row with ground truth, and this log has {known}"
    return "too many frames have no ground truth, or a method has no error at all"


def _returned(methods: dict[str, Any]) -> str:
    """Without ground truth: how far the methods end from their start, there and back."""
    ends = {key: m["there_and_back"]["end_drift_percent"] for key, m in methods.items() if m["there_and_back"]}
    if not ends:
        return "Nothing can be said about which method drifts least: the log has no ground truth."
    best = min(ends, key=lambda key: ends[key])
    said = f"{label(best)} ends closest to its start, {ends[best]:.2g} % of the way there and back"
    if best != "cross_frame" and "cross_frame" in ends:
        said += f" ({REFERENCE}: {ends['cross_frame']:.2g} %)"
    return f"The log has no ground truth. {_upper(said)}; a single end says little about drift."


def _covariances(methods: dict[str, Any]) -> str:
    """Whether the covariance of the reference holds, and which methods' are too small."""
    nees = {key: m["nees_pose_mean"] for key, m in methods.items() if m["nees_pose_mean"] is not None}
    low, high = NEES_INTERVAL
    small = {key: value for key, value in nees.items() if value > high}
    said = []
    if "cross_frame" in nees and "cross_frame" not in small:
        value = nees["cross_frame"]
        size = "larger than needed" if value < low else "right"
        said.append(f"{REFERENCE} is {size} (NEES {value:.2g}, {EXPECTED_NEES:.0f} expected)")
    said += [f"{label(key)} is {_rounded(value / EXPECTED_NEES)} times too small" for key, value in small.items()]
    return f"The covariance of {', that of '.join(said)}." if said else ""
