"""Two hundred damaged logs: none hangs, swells, ends in a traceback, or costs a frame that came before the damage.

`tools/fuzz.py` runs as many more as one likes, with other seeds.
"""

import os
import signal
from pathlib import Path

import pytest

from tests.faults.fuzz import MAX_RSS_MIB, fuzz_logs
from tests.faults.mutations import BASES, FRAMES

pytestmark = pytest.mark.slow

LOGS = 200 // len(BASES)  # six of each kind of damage


@pytest.mark.parametrize("base", BASES)
def test_damaged_logs_give_all_that_is_whole(base: str, tmp_path: Path):
    outcome = fuzz_logs(base, 0, LOGS, tmp_path)
    assert outcome.failures == {}
    assert outcome.tried == LOGS and outcome.peak_rss_mib < MAX_RSS_MIB
    # the damage is neither so slight nor so bad that nothing is tested
    assert LOGS < outcome.frames_due < LOGS * FRAMES / 2
    assert min(outcome.exit_codes[code] for code in (0, 3)) > 1  # both ends occur


def _sabotage(log: Path, out: Path, due: list[int], checked: bool) -> tuple[int, str]:
    number = int((out.parent / "number").read_text()) + 1
    (out.parent / "number").write_text(str(number))
    if number == 2:
        signal.setitimer(signal.ITIMER_PROF, 0.1)
        while True:
            pass
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 0, "a frame is missing" if number == 4 else ""


def test_what_hangs_or_dies_is_a_failure_and_the_rest_goes_on(tmp_path: Path):
    (tmp_path / "number").write_text("0")
    outcome = fuzz_logs("protobuf, unchunked", 0, 5, tmp_path, _sabotage)
    assert outcome.tried == 5 and outcome.exit_codes == {0: 2}
    said = [outcome.failures[seed] for seed in (1, 2, 3)]
    assert "did not come back" in said[0] and "died (-9)" in said[1] and "a frame is missing" in said[2]
