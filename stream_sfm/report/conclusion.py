"""What a log shows about its methods, in plain words: the paragraph on top of the report.

It names methods as the tables do, speaks of position and rotation separately, and adds where errors are far larger
than the covariances say.
"""

from typing import Any, NamedTuple

from ..evaluation.relative import MIN_FRAMES_RATIO, tested_spans
from .methods import label

_REFERENCE = "cross-frame"
_IN_FULL = (
    "ekf",
    "iterated-ekf",
    "frame-to-frame",
)  # methods with figures in any case; of the others only where they are ahead
_EXPECTED_NEES = 6
_EXCESSIVE_NEES = 9 * _EXPECTED_NEES  # errors three times as large as estimated; no single log varies as much

_WITHOUT_TRUTH = (
    "This log has no ground truth, so the accuracy of the methods is unknown. The report shows how far each method "
    "ends from its start when the frames are processed forwards and then in reverse order, and how far the methods "
    "diverge from each other."
)

Ratios = dict[str, dict[str, Any]]  # position and rotation -> value and ci95


class Conclusion(NamedTuple):
    """What a log shows: a style class, and sentences, one per method or fact."""

    style: str
    sentences: list[str]

    @property
    def text(self) -> str:
        """All of it."""
        return " ".join(self.sentences)


def conclusion(content: dict[str, Any]) -> Conclusion:
    """What the log shows; `content` is that of report.json."""
    if not content["frames_with_ground_truth"]:
        return Conclusion("open", [_WITHOUT_TRUTH])
    ratios = {_name(key): found for key, found in content["error_over_cross_frame"].items()}
    if not ratios:
        obstacle = f"The methods cannot be compared on this log: {_obstacle(content)}."
        return Conclusion("open", [obstacle, *_covariances(content)])
    longest = tested_spans(content["frames_with_ground_truth"])[-1]
    spans = "2 frames" if longest == 2 else f"2 to {longest} frames"
    method = (
        f"Figures are RMS errors of motions over {spans}, over those of {label(_REFERENCE)}; position and rotation of "
        "a method are both in their intervals in 95 % of logs."
    )
    style = _style(ratios["ekf"]) if "ekf" in ratios else "open"
    return Conclusion(style, [*_in_order(ratios), *_covariances(content), method])


def _name(key: str) -> str:
    return key.replace("_", "-")


def _obstacle(content: dict[str, Any]) -> str:
    """Why there are no ratios."""
    methods = content["methods"]
    if stopped := [f"{label(_name(k))} {m['failure']}" for k, m in methods.items() if m["failure"]]:
        return "; ".join(stopped)
    if "cross_frame" not in methods or len(methods) < 2:
        return f"{label(_REFERENCE)} and another method are needed"
    return f"fewer than {MIN_FRAMES_RATIO} consecutive frames have ground truth, or a method has no error at all"


def _sides(found: Ratios) -> dict[str, int]:
    """1, −1 or 0 for position and rotation: larger errors than the reference, smaller ones, or cannot be told apart."""
    ends = {quantity: figures["ci95"] for quantity, figures in found.items()}
    return {quantity: int(low > 1) - int(high < 1) for quantity, (low, high) in ends.items()}


def _style(found: Ratios) -> str:
    sides = set(_sides(found).values())
    return "larger" if sides in ({1}, {0, 1}) else "smaller" if sides in ({-1}, {0, -1}) else "open"


def _in_order(ratios: dict[str, Ratios]) -> list[str]:
    """The methods that are always named, those that are ahead, and the rest by what they have in common."""
    full = [name for name in _IN_FULL if name in ratios]
    ahead = [name for name in ratios if name not in full and -1 in _sides(ratios[name]).values()]
    said = [_begun(_clause(name, ratios[name])) for name in [*full, *ahead]]
    rest = [name for name in ratios if name not in full and name not in ahead]
    level = [label(name) for name in rest if not any(_sides(ratios[name]).values())]
    behind = [label(name) for name in rest if any(_sides(ratios[name]).values())]
    if level:
        said.append(f"Not told apart from {label(_REFERENCE)} in either: {', '.join(level)}.")
    if behind:
        said.append(f"Larger errors than {label(_REFERENCE)} in position, rotation or both: {', '.join(behind)}.")
    return said


def _begun(sentence: str) -> str:
    """A sentence with a capital, where it begins with the name of a method."""
    return sentence[:1].upper() + sentence[1:]


def _clause(name: str, found: Ratios) -> str:
    """One method against the reference, for each quantity."""
    sides = _sides(found)
    figures = {q: f"×{f['value']:.2f} [{f['ci95'][0]:.2f}, {f['ci95'][1]:.2f}]" for q, f in found.items()}
    every = ", ".join(f"{q} {figures[q]}" for q in found)
    if not any(sides.values()):
        return f"{label(name)} and {label(_REFERENCE)} cannot be told apart: {every}."
    if len(set(sides.values())) == 1:
        size = "larger" if 1 in sides.values() else "smaller"
        return f"{label(name)} has {size} errors than {label(_REFERENCE)}: {every}."
    clauses = [f"in {q} {figures[q]}" for q in found if sides[q]]
    clauses += [f"{q} cannot be told apart ({figures[q]})" for q in found if not sides[q]]
    return f"{label(name)} against {label(_REFERENCE)}: {'; '.join(clauses)}."


def _covariances(content: dict[str, Any]) -> list[str]:
    """A sentence where errors are much larger than estimated, with the NEES of these methods."""
    nees = {key: m["nees_pose_mean"] for key, m in content["methods"].items() if m["nees_pose_mean"] is not None}
    found = [f"{label(_name(key))} {value:.3g}" for key, value in nees.items() if value >= _EXCESSIVE_NEES]
    if not found:
        return []
    return [
        f"Errors more than three times as large as estimated (NEES, {_EXPECTED_NEES} expected): {', '.join(found)}."
    ]
