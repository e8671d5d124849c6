"""How much of damaged logs is read: `python -m tools.damage LOG...`. Exit code 1 below 99 % or on a silent loss.

Each log is damaged in twelve ways (tests/faults/damage.py), with its index, without one and with one that is
damaged too. The frames whose chunks are intact are due; the table gives the share of them that was read.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from tests.faults.damage import INDEXES, KINDS, Trial, trial, whole_log

_GOAL_PERCENT = 99.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", metavar="LOG", nargs="+", type=Path, help="undamaged logs, chunked")
    parser.add_argument("--times", type=int, default=3, metavar="N", help="places of each damage (default: 3)")
    args = parser.parse_args()
    results: dict[tuple[str, str], list[Trial]] = {(kind, index): [] for kind in KINDS for index in INDEXES}
    with tempfile.TemporaryDirectory() as folder:
        for log in args.logs:
            whole = whole_log(log)
            print(f"{log.name}: {len(whole.frames)} frames in {len(whole.pieces)} chunks", file=sys.stderr)
            for kind, index in results:
                for seed in range(args.times):
                    results[kind, index].append(trial(whole, index, kind, seed, Path(folder, "damaged.mcap")))
    every = [t for trials in results.values() for t in trials]
    _print_table(results)
    due, found = sum(t.due for t in every), sum(t.found for t in every)
    silent = sum(t.silent for t in every)
    print(f"{len(every)} damaged logs: {found} of {due} intact frames, {100 * found / due:.2f} %")
    print(f"{silent} with a loss that is not reported")
    return 0 if 100 * found / due >= _GOAL_PERCENT and not silent else 1


def _print_table(results: dict[tuple[str, str], list[Trial]]) -> None:
    """Per kind of damage and state of the index: intact frames read, of those due."""
    print("| damage | " + " | ".join(INDEXES) + " |\n|---|" + "---|" * len(INDEXES))
    for kind in KINDS:
        cells = []
        for index in INDEXES:
            due, found = (sum(getattr(t, name) for t in results[kind, index]) for name in ("due", "found"))
            cells.append(f"{found} of {due}")
        print(f"| {kind} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    sys.exit(main())
