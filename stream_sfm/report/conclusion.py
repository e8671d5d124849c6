"""The first line of a comparison: which methods drift less than the window, or more, and which covariances hold.

A method is ahead or behind only if an interval says so, within a log or over several: of two equal methods, this names
a winner in 5 % of comparisons.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..evaluation.drift import KINDS, Compared, of_interval
from ..evaluation.figures import NEES_INTERVAL
from ..evaluation.paired import outcome_of
from ..evaluation.relative import paired_ratio
from ..methods import REFERENCE, REPLAYED, key_of
from ..system.wording import in_a_row
from .tables import of_method

_MOST_NAMED = 3  # inconsistent methods that are named with their figures; for more, the range is given


def verdict_of(methods: Mapping[str, Compared]) -> dict[str, Any] | None:
    """Return the ratios of the errors of methods to those of the window, and who is ahead of it, behind, or neither.

    None without the window, or if no ratio has an interval: the log is too short. The ratios of position and rotation
    hold together in 95 % of logs.
    """
    window = methods.get(key_of(REFERENCE))
    ratios: dict[str, Any] = {}
    for key, method in methods.items():
        if window is None or method is window:
            continue
        both = paired_ratio(method.poses, window.poses, method.truth, window.truth)
        if both is not None:
            ratios[key] = dict(zip(KINDS, map(of_interval, both), strict=True))
    return decided(ratios) if ratios else None


def decided(ratios: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> dict[str, Any]:
    """Return the `ratios` by method and kind with who is ahead of the window, behind it, or neither."""
    found: dict[str, list[str]] = {"ahead": [], "behind": [], "mixed": [], "level": []}
    for key, both in ratios.items():
        found[outcome_of([ratio["ci95"] for ratio in both.values()])].append(key)
    return {"ratios": ratios, **found}


def in_words(content: dict[str, Any], methods: dict[str, Any]) -> str:
    """Return the first line of page, terminal and report.json; `content`: the section `drift` of report.json.

    What is decided against the window comes first.
    """
    found = [*who_is_ahead(content["verdict"]), _which_hold(methods, content["as_is"]), _as_replayed(methods)]
    if content["common"] is not None:
        found.append(f"All methods share {content['common']['text']}, which is removed here")
    sentences = [sentence for sentence in found if sentence]
    if not sentences:
        return "There is no ground truth for these frames."
    if content["against"] == "halves":
        sentences.insert(0, "There is no ground truth: errors come from halves of the tracks")
    elif content["verdict"] is not None and content["verdict"]["against"] == "halves":
        sentences.insert(0, "The truth cannot separate the methods: their ratios come from halves of the tracks")
    return " ".join(f"{sentence}." for sentence in sentences)


def who_is_ahead(verdict: dict[str, Any] | None, shown_by: str = "This log") -> list[str]:
    """Return a sentence on the methods ahead of the window, on those behind it, and on those that are neither."""
    if verdict is None:
        return []
    window, sentences = of_method(REFERENCE).name, []

    def listed(group: str) -> str:
        return in_a_row([f"{of_method(key).name} ({_decided(verdict['ratios'][key])})" for key in verdict[group]])

    if verdict["ahead"]:
        errs = "errs" if len(verdict["ahead"]) == 1 else "err"
        sentences.append(f"{_capital(listed('ahead'))} {errs} less than {window}")
    if verdict["mixed"]:
        sentences.append(f"One kind of error is smaller, and the other larger, of {listed('mixed')}")
    if verdict["behind"]:
        sentences.append(f"{_capital(window)} errs less than {listed('behind')}")
    if verdict["level"]:
        names = [of_method(key).name for key in verdict["level"]]
        sentences.append(f"{shown_by} cannot separate {window} from {in_a_row(names)}")
    return sentences


def _decided(ratios: dict[str, Any]) -> str:
    """Return the ratios of the errors to those of the window that an interval decides."""
    cells = []
    for kind, ratio in ratios.items():
        low, high = ratio["ci95"]
        if not low <= 1 <= high:
            cells.append(f"{kind} ×{ratio['value']:.2f} [{low:.2f}, {high:.2f}]")
    return ", ".join(cells)


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def _as_replayed(methods: dict[str, Any]) -> str:
    """Say what NEES the window has if it finds the calibration on the way, as `replay` runs it."""
    nees = methods.get(key_of(REPLAYED), {}).get("nees_pose_mean")
    if nees is None:
        return ""
    least, most = NEES_INTERVAL
    held = "is consistent" if least <= nees <= most else "is not consistent"
    return f"As replayed, finding the calibration on the way, {of_method(REFERENCE).name} {held} (NEES {nees:.2g})"


def _which_hold(methods: dict[str, Any], as_is: bool) -> str:
    """Say which covariances hold, and how wrong those of the other methods are; for many methods, give the range."""
    low, high = (np.sqrt(x / 6) for x in NEES_INTERVAL)
    given = {key: of for key, of in methods.items() if key != key_of(REPLAYED)}
    factors = {key: factor for key, of in given.items() if (factor := of["sigma_factor"]) is not None}
    hold = [of_method(key).name for key, factor in factors.items() if low <= factor <= high]
    wrong = {key: factor for key, factor in factors.items() if not low <= factor <= high}
    by_halves = any(figures["sigma_factor_from"] == "halves" for figures in given.values())
    source = "" if as_is else ", with the calibration taken as exact,"
    source = ", by halves of the tracks," if by_halves else source
    text = f"Covariances{source} are consistent for {in_a_row(hold)}" if hold else ""
    if not wrong:
        return text
    text += ", not for " if text else f"Covariances{source} are not consistent for "
    if len(wrong) <= _MOST_NAMED:
        return text + in_a_row([f"{of_method(key).name} ({_off(size)})" for key, size in wrong.items()])
    mine = wrong.pop(key_of(REFERENCE), None)
    kind = "methods" if mine is None and not hold else "others"
    others = f"{len(wrong)} {kind} ({_off(*sorted(wrong.values()))})"
    return text + (others if mine is None else f"{of_method(REFERENCE).name} ({_off(mine)}) and {others}")


def _off(*sizes: float) -> str:
    """Say by how much σ is too small or too large."""
    least, most = ((f"{float(f'{max(x, 1 / x):.2g}'):g}", "small" if x > 1 else "large") for x in (sizes[0], sizes[-1]))
    if least[1] != most[1]:
        return f"σ up to {least[0]} times too {least[1]} and {most[0]} times too {most[1]}"
    ends = sorted({least[0], most[0]}, key=float)
    return f"σ {' to '.join(ends)} times too {least[1]}"
