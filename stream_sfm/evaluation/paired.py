"""Ratios of errors over several logs, each of which is one sample, with intervals.

Two sets of runs over the same logs, such as two batches: which one drifts less. Methods of one comparison per log use
the same ratio (`report/over_logs.py`).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..record import record
from .settings import SETTINGS

FIGURES = {"ate_rmse_aligned_m": "ATE aligned", "t_rel_percent": "t_rel", "r_rel_deg_per_100m": "r_rel"}


@record
class Ratio:
    """The geometric mean over `logs` of ratios of one figure, with its 95 % interval."""

    value: float
    ci95: tuple[float, float]
    logs: int


def outcome_of(intervals: Sequence[Sequence[float]]) -> str:
    """Return whether ratios of errors are below 1 by their intervals: `ahead` if one is and no other is above 1.

    `behind` in the opposite case, `mixed` if they contradict each other, `level` if all contain 1.
    """
    less, more = any(high < 1 for _, high in intervals), any(low > 1 for low, _ in intervals)
    return "mixed" if less and more else "ahead" if less else "behind" if more else "level"


@record
class Paired:
    """The `ratios` by figure of the runs in folder `second` over those in folder `first`."""

    first: str
    second: str
    ratios: dict[str, Ratio]

    def in_words(self) -> str:
        """Return the ratios, and which set drifts less if the figures that differ agree about it."""
        texts = [f"{FIGURES[k]} ×{r.value:.2f} [{r.ci95[0]:.2f}, {r.ci95[1]:.2f}]" for k, r in self.ratios.items()]
        logs = max(ratio.logs for ratio in self.ratios.values())
        decided = {
            "ahead": f"{self.second} drifts less than {self.first}",
            "behind": f"{self.first} drifts less than {self.second}",
        }
        outcome = outcome_of([ratio.ci95 for ratio in self.ratios.values()])
        verdict = decided.get(outcome, f"these {logs} logs do not tell which one drifts less")
        return f"{self.second} over {self.first}, {logs} logs: {', '.join(texts)}\n{verdict}"


def paired(rows: Sequence[Mapping[str, Any]]) -> Paired | None:
    """Return the ratios of two sets of runs, each in a folder of its own; None if there are not two with common logs.

    `rows`: the folder of a run, its log and its figures against ground truth. Each log counts once, however long it
    is. The intervals are wide enough that all of them together hold in 95 % of such comparisons (Bonferroni).
    """
    sets: dict[str, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        sets.setdefault(str(Path(row["run"]).parent), {})[str(row["log"])] = row["ground_truth"]
    if len(sets) != 2:
        return None
    (first, of_first), (second, of_second) = sets.items()
    ratios = {}
    for key in FIGURES:
        pairs = [(of_first[log].get(key), of_second[log].get(key)) for log in of_first if log in of_second]
        if (ratio := mean_ratio([b / a for a, b in pairs if a and b], len(FIGURES))) is not None:
            ratios[key] = ratio
    return Paired(first, second, ratios) if ratios else None


def mean_ratio(of_logs: Sequence[float], together: int) -> Ratio | None:
    """Return the geometric mean of the ratios of logs with Student's interval; None of fewer than two.

    `together`: the number of such intervals that all hold in 95 % of comparisons.
    """
    if (logs := len(of_logs)) < SETTINGS.fewest_logs:
        return None
    from scipy.special import stdtrit  # of the extra `study`; one run needs none

    logarithms = np.log(of_logs)
    half = stdtrit(logs - 1, 1 - 0.025 / together) * logarithms.std(ddof=1) / np.sqrt(logs)
    value, low, high = np.exp([logarithms.mean(), logarithms.mean() - half, logarithms.mean() + half])
    return Ratio(float(value), (float(low), float(high)), logs)
