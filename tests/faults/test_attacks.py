"""Hostile inputs of three kinds: none hangs, swells, ends in a defect, reaches the terminal, or touches other files.

`tools/fuzz.py --attacks` runs as many more as one likes, with other seeds.
"""

from functools import partial
from pathlib import Path

import pytest

from tests.faults import attacks
from tests.faults.attacks import ATTACKS, Ammunition, Attack, attacked
from tests.faults.fuzz import MAX_RSS_MIB, fuzz

TRIALS = 30
MAX_SECONDS = 30  # of CPU; the longest take two


@pytest.mark.slow
@pytest.mark.parametrize("kind", ATTACKS)
def test_attacks_end_in_results_or_in_a_sentence(kind: str, tmp_path: Path) -> None:
    outcome = fuzz(partial(attacked, kind), 0, TRIALS, tmp_path, MAX_SECONDS)
    assert outcome.failures == {}
    assert outcome.tried == TRIALS and outcome.peak_rss_mib < MAX_RSS_MIB


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["recover", "{log}", "{field}/elsewhere"], "changed"),
        (["replay", "{log}", "--out", "{field}/elsewhere", "--method", "frame-to-frame"], "changed"),
        (["config"], ""),
    ],
)
def test_what_is_written_elsewhere_is_seen(
    words: list[str], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def elsewhere(_: object, ammunition: Ammunition, field: Path) -> Attack:
        return Attack([word.format(log=ammunition.log, field=field) for word in words])

    monkeypatch.setitem(attacks.ATTACKS, "elsewhere", elsewhere)
    code, _, problem = attacked("elsewhere", tmp_path)(0)
    assert code == 0 and (why in problem if why else not problem)
