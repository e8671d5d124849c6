"""Hostile inputs, many more than the tests try: `python -m tools.fuzz --count 20000`. Exit code 1 on any failure.

They are made as in tests/faults/attacks.py: damaged logs, definitions, images, texts, bags, results, and calls of the
core. Each seed is one input; `--first` continues where another run ended.
"""

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.faults.attacks import ATTACKS, fuzz

_MAX_CPU_SECONDS = 60.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000, metavar="N", help="how many, over all kinds")
    parser.add_argument("--first", type=int, default=2000, metavar="SEED", help="the tests use those below 60")
    args = parser.parse_args()
    return 1 if sum(_tried(kind, args.first, args.count // len(ATTACKS)) for kind in ATTACKS) else 0


def _tried(kind: str, first: int, count: int) -> int:
    """The number of failures of one kind."""
    with tempfile.TemporaryDirectory() as folder:
        outcome = fuzz(kind, first, count, Path(folder), _MAX_CPU_SECONDS)
    codes = ", ".join(f"{n} with exit code {code:d}" for code, n in sorted(outcome.exit_codes.items()))
    print(f"{kind}: {outcome.tried} inputs, {codes}")
    print(f"  {len(outcome.failures)} failures, peak {outcome.peak_rss_mib:.0f} MiB", flush=True)
    for seed, why in outcome.failures.items():
        print(f"  seed {seed}: {why}", flush=True)
    return len(outcome.failures)


if __name__ == "__main__":
    sys.exit(main())
