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
NEES_INTERVAL = (1.24, 14.45)  # 95 % interval of one pose: those of a log share their errors and say hardly more
_WORTH_KNOWING = math.log(1.1)  # logarithm of a ratio: smaller differences do not matter to anyone
_IN_FULL = 2  # methods whose figures the sentence gives; the chart has all

_CANNOT = "This log cannot tell which method drifts least"

Ratios = dict[str, dict[str, Any]]  # position and rotation -> value and ci95


class Verdict(NamedTuple):
    """`drift` and `covariances`, a sentence each, the second empty without NEES."""

    drift: str
    covariances: str

    @property
    def sentences(self) -> list[str]:
        """Both, the one first that says something."""
        first = -1 if self.drift.startswith(_CANNOT) and "too small" in self.covariances else 1
        return [sentence for sentence in self[::first] if sentence]


def verdict(content: dict[str, Any]) -> Verdict:
    """What the log shows; `content` is that of report.json."""
    covariances = _covariances(content["methods"])
    if not content["frames_with_ground_truth"]:
        return Verdict(f"{_CANNOT}: it has no ground truth.{_apart(content)}", covariances)
    ratios: dict[str, Ratios] = content["error_over_cross_frame"]
    if not ratios:
        return Verdict(f"{_CANNOT}: {_obstacle(content)}.", covariances)
    behind = [key for key, found in ratios.items() if _side(found) > 0]
    ahead = [key for key, found in ratios.items() if _side(found) < 0]
    level = len(ratios) - len(behind) - len(ahead)
    if not ahead and not behind:
        return Verdict(_undecided(ratios, content["frames_with_ground_truth"]), covariances)
    if ahead:
        said = f"{_upper(REFERENCE)} does not drift least: {_all(ahead, ratios, 'smaller')}"
        said += f"; {_all(behind, ratios, 'larger')}" if behind else ""
    else:
        least = "No method is shown to drift less than cross-frame" if level else "Cross-frame drifts least"
        said = f"{least}: {_all(behind, ratios, 'larger')}"
    said += f"; {_count(level)} cannot be told apart from it" if level else ""
    return Verdict(f"{said}.", covariances)


def _apart(content: dict[str, Any]) -> str:
    """Say how far apart the methods are where no truth tells which is right, beside the σ of the reference."""
    away, of_reference = content["divergence_from_cross_frame_m"], content["methods"].get("cross_frame")
    if not away or of_reference is None or of_reference["end_std_position_m"] is None:
        return ""
    far = [_rounded(find(away.values())) for find in (min, max)]
    between = far[0] if far[0] == far[1] else " to ".join(far)
    return (
        f" Positions of the others are {between} m (RMS) away from those of {REFERENCE}, "
        f"whose σ at the end is {_rounded(of_reference['end_std_position_m'])} m."
    )


def _upper(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def _side(found: Ratios) -> int:
    """1 where errors are larger than the reference's, −1 smaller; 0 where neither, or one of each, is certain."""
    low, high = (max(f["ci95"][0] for f in found.values()), min(f["ci95"][1] for f in found.values()))
    return int(low > 1) - int(high < 1)


def _all(keys: list[str], ratios: dict[str, Ratios], size: str) -> str:
    """How large the errors of some methods are, over those of the reference: of each the quantity most certain."""
    parts: list[str] = []
    for key in keys[:_IN_FULL]:
        quantity = max(ratios[key], key=lambda q: _certainty(ratios[key][q]))
        figure = ratios[key][quantity]
        low, high = figure["ci95"]
        are, as_large = ("are ", " as large") if not parts else ("", "")
        parts.append(
            f"{label(key)}’s {quantity} errors {are}{figure['value']:.2f} [{low:.2f}, {high:.2f}] times{as_large}"
        )
    if (more := len(keys) - _IN_FULL) > 0:
        parts.append(f"those of {_count(more)} are {size}, too")
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _certainty(figure: dict[str, Any]) -> float:
    """How far a ratio is from 1, in half widths of its interval."""
    return abs(math.log(figure["value"])) / _half_width(figure)


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
    """That no method is told apart, and how long a log would show the difference that was measured."""
    key = "ekf" if "ekf" in ratios else next(iter(ratios))
    figure = ratios[key]["position"]
    wanted, longer = frames_to_tell(figure, frames)
    low, high = figure["ci95"]
    return (
        f"{_CANNOT}: over {frames} frames none differs from {REFERENCE} "
        f"for certain ({label(key)}’s position errors: {figure['value']:.2f} [{low:.2f}, {high:.2f}] times as large). "
        f"A difference of {100 * (wanted - 1):.0f} % would show over about {longer} frames."
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


def _covariances(methods: dict[str, Any]) -> str:
    """Whether the covariance of the reference holds, and which methods' are too small."""
    nees = {key: m["nees_pose_mean"] for key, m in methods.items() if m["nees_pose_mean"] is not None}
    low, high = NEES_INTERVAL
    small = {key: value for key, value in nees.items() if value > high}
    said = []
    if "cross_frame" in nees and "cross_frame" not in small:
        value = nees["cross_frame"]
        size = "larger than needed" if value < low else "right"
        said.append(f"that of {REFERENCE} is {size} (NEES {value:.2g}, {EXPECTED_NEES:.0f} expected)")
    factors = sorted(value / EXPECTED_NEES for value in small.values())
    if len(small) == 1:
        said += [f"that of {label(key)} is {_rounded(factors[0])} times too small" for key in small]
    elif small:
        *names, last = map(label, small)
        ends = f"{_rounded(factors[0])} to {_rounded(factors[-1])}"
        said.append(f"those of {', '.join(names)} and {last} are {ends} times too small")
    sentence = ", ".join(said)
    first, _, rest = sentence.partition(" ")
    return f"The {'covariance' if first == 'that' else 'covariances'} {rest}." if said else ""
