"""Hostile inputs of many kinds: none hangs, swells, ends in a defect, reaches the terminal, or touches other files.

`tools/fuzz.py` runs as many more as one likes, with other seeds.
"""

import pytest

from tests.faults.attacks import ATTACKS, fuzz

TRIALS = {"logs": 60, "definitions": 30, "images": 30, "texts": 30, "bags": 30, "results": 30, "core": 60}
MAX_SECONDS = 30  # of CPU; the longest take two


@pytest.mark.slow
@pytest.mark.parametrize("kind", ATTACKS)
def test_attacks_end_in_results_or_in_a_sentence(kind, tmp_path):
    outcome = fuzz(kind, 0, TRIALS[kind], tmp_path, MAX_SECONDS)
    assert outcome.failures == {}
    if kind in ("logs", "images"):
        assert min(outcome.exit_codes[0], outcome.exit_codes[3]) > 1  # both ends occur
