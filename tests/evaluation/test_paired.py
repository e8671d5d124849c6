"""Two sets of runs over the same logs: ratios with intervals that hold, and one sentence."""

import numpy as np
import pytest

from stream_sfm.evaluation.paired import FIGURES, paired

KEYS = tuple(FIGURES)


def rows(folder: str, values: dict[str, float], keys: tuple[str, ...] = KEYS) -> list[dict[str, object]]:
    return [
        {"run": f"{folder}/{log}", "log": log, "ground_truth": dict.fromkeys(keys, value)}
        for log, value in values.items()
    ]


def test_ratios_are_over_logs_that_both_have() -> None:
    found = paired(rows("a", {"x": 1.0, "y": 10.0, "only": 5.0}) + rows("b", {"x": 0.5, "y": 4.9}))
    assert found is not None and (found.first, found.second) == ("a", "b")
    ratio = found.ratios["t_rel_percent"]
    assert ratio.value == pytest.approx(np.sqrt(0.5 * 0.49)) and ratio.logs == 2
    assert found.in_words().startswith("b over a, 2 logs: ATE aligned ×0.49 [")


@pytest.mark.parametrize(
    ("factors", "verdict"),
    [
        ((0.80, 0.82, 0.79, 0.81), "b drifts less than a"),
        ((1.20, 1.22, 1.19, 1.21), "a drifts less than b"),
        ((0.80, 1.22, 0.99, 1.01), "these 4 logs do not tell which one drifts less"),
    ],
)
def test_the_sentence_says_which_or_that_the_logs_do_not_tell(factors: tuple[float, ...], verdict: str) -> None:
    truth = {f"log{n}": 10.0**n for n in range(4)}
    other = {log: value * factor for (log, value), factor in zip(truth.items(), factors, strict=True)}
    found = paired(rows("a", truth) + rows("b", other))
    assert found is not None and found.in_words().splitlines()[1] == verdict


def test_figures_that_disagree_decide_nothing() -> None:
    logs = ("x", "y", "z")
    one = [{"run": f"a/{log}", "log": log, "ground_truth": dict.fromkeys(KEYS, 1.0)} for log in logs]
    factors = dict(zip(KEYS, (0.5, 2.0, 1.0), strict=True))
    other = [
        {"run": f"b/{log}", "log": log, "ground_truth": {k: f * (1 + 0.01 * n) for k, f in factors.items()}}
        for n, log in enumerate(logs)
    ]
    found = paired(one + other)
    assert found is not None and "do not tell" in found.in_words()


def test_there_is_nothing_to_pair_without_two_sets_of_two_common_logs() -> None:
    assert paired(rows("a", {"x": 1.0, "y": 1.0})) is None
    assert paired(rows("a", {"x": 1.0}) + rows("b", {"x": 1.0})) is None  # no interval
    assert paired(rows("a", {"x": 1.0, "y": 1.0}) + rows("b", {"v": 1.0, "w": 1.0})) is None
    mono = ("ate_rmse_sim3_m",)
    assert paired(rows("a", {"x": 1.0, "y": 1.0}, mono) + rows("b", {"x": 1.0, "y": 1.0}, mono)) is None


def test_equal_sets_are_told_apart_in_one_comparison_of_twenty_at_most() -> None:
    """Three figures of one log have the same error here, and one each in other sets: Bonferroni holds for both."""
    rng, trials, wrong = np.random.default_rng(7), 400, 0
    for _ in range(trials):
        errors = np.exp(0.2 * rng.normal(size=(2, 6, len(KEYS))))
        sets = [
            {"run": f"{name}/{n}", "log": str(n), "ground_truth": dict(zip(KEYS, values, strict=True))}
            for name, of_set in zip("ab", errors.tolist(), strict=True)
            for n, values in enumerate(of_set)
        ]
        found = paired(sets)
        assert found is not None
        wrong += "do not tell" not in found.in_words()
    assert wrong / trials < 0.05 + 3 * np.sqrt(0.05 * 0.95 / trials)
