"""Hostile inputs, many more than the tests try: `python -m tools.fuzz --count 20000`. Exit code 1 on any failure.

Damaged logs are made as in tests/faults/mutations.py, with `--attacks` everything else as in tests/faults/attacks.py:
definitions, images, texts. Each seed is one input;
`--first` continues where another run ended.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from tests.faults.attacks import ATTACKS, attacked
from tests.faults.fuzz import MAX_SECONDS, Trial, damaged_logs, fuzz, replay_and_check
from tests.faults.mutations import BASES

_MAX_ATTACK_SECONDS = 60.0  # of CPU


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000, metavar="N", help="how many, over all kinds")
    parser.add_argument("--first", type=int, default=2000, metavar="SEED", help="the tests use those below 120")
    parser.add_argument(
        "--attacks", action="store_true", help="hostile inputs of all kinds instead of damaged logs"
    )
    args = parser.parse_args()
    kinds: dict[str, Callable[[Path], Trial]]
    if args.attacks:
        kinds, seconds = {kind: partial(attacked, kind) for kind in ATTACKS}, _MAX_ATTACK_SECONDS
    else:
        kinds, seconds = {base: partial(damaged_logs, base, replay_and_check) for base in BASES}, MAX_SECONDS
    return 1 if sum(_tried(name, make, args, len(kinds), seconds) for name, make in kinds.items()) else 0


def _tried(name: str, make: Callable[[Path], Trial], args: argparse.Namespace, kinds: int, seconds: float) -> int:
    """The number of failures of one kind."""
    with tempfile.TemporaryDirectory() as folder:
        outcome = fuzz(make, args.first, args.count // kinds, Path(folder), seconds)
    codes = ", ".join(f"{n} with exit code {code:d}" for code, n in sorted(outcome.exit_codes.items()))
    due = f"; {outcome.frames_due} leading frames were due" if outcome.frames_due else ""
    print(f"{name}: {outcome.tried} inputs, {codes}{due}")
    print(f"  {len(outcome.failures)} failures, peak {outcome.peak_rss_mib:.0f} MiB", flush=True)
    for seed, why in outcome.failures.items():
        print(f"  seed {seed}: {why}", flush=True)
    return len(outcome.failures)


if __name__ == "__main__":
    sys.exit(main())
