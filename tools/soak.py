"""Long runs: `python tools/soak.py [--simulated 100000] [--rendered 5000]`. Exit code 1 where anything is not flat.

The estimator alone on simulated observations without end (a path there and back, fresh noise at every visit), then the
whole engine on the images of logs/room.mcap, there and back. Asked of each: resident memory within 20 MiB and CPU a
frame within 10 % from the second tenth on, finite covariances, rotations orthonormal to 1e-12, no frame lost.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

from stream_sfm import Config, Engine, Status, StereoFrame, open_log
from stream_sfm.estimators import make_estimator
from stream_sfm.geometry import se3
from stream_sfm.simulation.scenes import FRAME_NS, ROUND_OFF_PX, Scene, Sequence, physical_views, rectified_views
from stream_sfm.types import FrameEstimate, Observations, Solution

ROOM = Path(__file__).parents[1] / "logs" / "room.mcap"
MEMORY_MIB, TIME_SHARE, ORTHONORMAL = 20.0, 0.10, 1e-12
BLOCKS = 20


def there_and_back(n: int) -> Iterator[int]:
    """0, 1 … n − 1, n − 2 … 1, 0, 1 … without end."""
    while True:
        yield from range(n)
        yield from range(n - 2, 0, -1)


def simulated(sequence: Sequence) -> Iterator[Observations]:
    """Observations without end; a point that comes back into view has a new id."""
    rng = np.random.default_rng(1)
    ids: dict[int, int] = {}
    born = 0
    bounds = np.searchsorted(sequence.frame, np.arange(len(sequence.world_from_cam) + 1))
    for index, k in enumerate(there_and_back(len(sequence.world_from_cam))):
        tracks = sequence.track[bounds[k] : bounds[k + 1]].tolist()
        present = set(tracks)
        new = {t: born + i for i, t in enumerate(t for t in tracks if t not in ids)}
        ids = {t: number for t, number in ids.items() if t in present} | new  # ascending: new ones come last
        born += len(new)
        cam_from_world = se3.inverse(sequence.world_from_cam[k])
        exact = physical_views(se3.transform(cam_from_world, sequence.points_in_world[list(ids)]))
        z, cov = rectified_views(exact + rng.normal(scale=ROUND_OFF_PX, size=exact.shape), ROUND_OFF_PX)
        numbers = np.array(list(ids.values()), dtype=np.int64)
        yield Observations(index, index * FRAME_NS, numbers, z, cov, n_new=len(new))


def rendered(path: Path) -> tuple[Engine, Iterator[StereoFrame]]:
    """An engine, and the frames of a log without end."""
    log = open_log(path)
    frames = list(log.frames())
    period_ns = frames[1].stamp_ns - frames[0].stamp_ns

    def stream() -> Iterator[StereoFrame]:
        for index, k in enumerate(there_and_back(len(frames))):
            yield StereoFrame(index * period_ns, frames[k].left, frames[k].right)

    return Engine(log.rig, Config()), stream()


def resident_mib() -> float:
    """Of this process, now (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def soak(
    name: str, step: Callable[..., Solution | FrameEstimate], inputs: Iterator, frames: int, table: Table
) -> list[str]:
    """Run `frames` frames and add a row to the table; return what misses its requirement."""
    size = max(frames // BLOCKS, 1)
    memory, cpu_ms = [], []
    worst_rotation, finite, lost = 0.0, True, 0
    for _ in range(BLOCKS):
        times = np.empty(size)
        for i in range(size):
            item = next(inputs)
            began = time.thread_time()
            result = step(item)
            times[i] = time.thread_time() - began
            r = result.world_from_cam[:3, :3]
            worst_rotation = max(worst_rotation, float(np.abs(r @ r.T - np.eye(3)).max()))
            finite &= bool(np.isfinite(result.cov_pose).all() and np.isfinite(result.cov_points).all())
            lost += result.status == Status.LOST
        cpu_ms.append(1e3 * float(times.mean()))
        memory.append(resident_mib())
    steady = slice(BLOCKS // 10, None)
    growth = max(memory[steady]) - min(memory[steady])
    half = BLOCKS // 2
    early, late = (float(np.median(cpu_ms[s])) for s in (slice(BLOCKS // 10, half), slice(half, None)))
    table.add_row(
        name, f"{BLOCKS * size}", f"{growth:.1f}", f"{early:.2f} → {late:.2f}", f"{worst_rotation:.1e}", str(lost),
        f"{np.sqrt(np.trace(result.cov_pose[:3, :3])):.3g}",
    )  # fmt: skip
    asked = {
        f"resident memory varies by {growth:.1f} MiB": growth <= MEMORY_MIB,
        f"CPU a frame goes from {early:.2f} to {late:.2f} ms": abs(late / early - 1) <= TIME_SHARE,
        f"rotations are off by {worst_rotation:.1e}": worst_rotation < ORTHONORMAL,
        "a covariance is not finite": finite,
        f"{lost} frames were lost": lost == 0,
    }
    return [f"{name}: {problem}" for problem, good in asked.items() if not good]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--simulated", type=int, default=100_000, metavar="N", help="frames of the estimator alone")
    parser.add_argument("--rendered", type=int, default=5_000, metavar="N", help="frames of the whole engine")
    args = parser.parse_args()
    columns = ("", "frames", "memory varies, MiB", "CPU a frame, ms", "off orthonormal", "lost", "σ position, m")
    table = Table(*columns)
    problems = []
    if args.simulated:
        sequence = Scene(frames=200).sequence(np.random.SeedSequence(1))
        estimator = make_estimator("cross-frame", sequence.projection, Config())
        problems += soak("simulated", estimator.step, simulated(sequence), args.simulated, table)
    if args.rendered:
        engine, frames = rendered(ROOM)
        problems += soak("rendered", engine.step, frames, args.rendered, table)
    Console(width=120).print(table)
    for problem in problems:
        print(problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
