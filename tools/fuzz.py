"""Replay damaged logs, many more than the tests do: `python -m tools.fuzz --logs 20000`. Exit code 1 on any failure.

Each seed is one log, made as in tests/faults/mutations.py; `--first` continues where another run ended.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from tests.faults.fuzz import fuzz
from tests.faults.mutations import BASES


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=20_000, metavar="N", help="how many, over all kinds of log")
    parser.add_argument("--first", type=int, default=2000, metavar="SEED", help="the tests use those below 400")
    args = parser.parse_args()
    failed = 0
    for base in BASES:
        with tempfile.TemporaryDirectory() as folder:
            outcome = fuzz(base, args.first, args.logs // len(BASES), Path(folder))
        codes = ", ".join(f"{n} with exit code {code}" for code, n in sorted(outcome.exit_codes.items()))
        print(f"{base}: {outcome.tried} logs, {codes}; {outcome.frames_due} leading frames were due")
        print(f"  {len(outcome.failures)} failures, peak {outcome.peak_rss_mib:.0f} MiB", flush=True)
        for seed, why in outcome.failures.items():
            print(f"  seed {seed}: {why}", flush=True)
        failed += len(outcome.failures)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
