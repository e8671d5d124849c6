"""A log through the engine into files: open, step, write, sum up. What was computed is never lost.

Ctrl-C and SIGTERM end a replay after the frame in hand; a log that breaks off, a full disk or a defect end it where
they occur. In each case the estimates so far are written, and summary.json says `complete: false` and why.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..camera.rig import MonoRig, StereoRig
from ..config import Config, config_to_toml
from ..engine import Engine
from ..errors import ConfigError, FrameError, InputError, LogError, OutputError
from ..evaluation import StructureComparison, evaluate, evaluate_unscaled
from ..files import json_bytes, write_whole
from ..interrupts import signals_noted
from ..recording import ImageMessage, StereoLog, open_log
from ..results.estimates_writer import EstimatesWriter
from ..results.trajectory_files import KittiWriter, TumWriter
from ..types import FrameEstimate, Trajectory
from .accounting import Account, log_figures, peak_rss_mib
from .prefetch import Ahead, prepared
from .there_and_back import TOO_LONG, WayBack, closure, with_return

if TYPE_CHECKING:
    from ..viewer.sink import Picture, RerunSink

UNSCALED = "unscaled: the distance between the first two views that show depths (one camera)"


class Sink(Protocol):
    """Takes estimates as they come: files, a viewer, a queue."""

    def write(self, estimate: FrameEstimate) -> None:
        """Take the next frame's estimate."""
        ...

    def close(self) -> None:
        """No more will come."""
        ...


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """`summary` as in summary.json; `out_dir` (None: nothing was to be written); all poses with covariances."""

    summary: dict[str, Any]
    out_dir: Path | None
    trajectory: Trajectory


class ReplayInterrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM; `result` is what there was until then, already written."""

    def __init__(self, result: ReplayResult) -> None:
        super().__init__("replay interrupted")
        self.result = result


def replay(
    log: str | Path | StereoLog,
    out_dir: str | Path | None = None,
    config: Config | None = None,
    *,
    left: str | None = None,
    right: str | None = None,
    calibration: str | Path | StereoRig | MonoRig | None = None,
    start_s: float | None = None,
    end_s: float | None = None,
    max_frames: int | None = None,
    stride: int = 1,
    there_and_back: bool = False,
    on_frame: Callable[[FrameEstimate], None] | None = None,
    sinks: Sequence[Sink] = (),
    viewer: "RerunSink | None" = None,
) -> ReplayResult:
    """Estimate the frames of a log and write the results to `out_dir` (None: nowhere).

    `left`, `right`, `calibration` as in `open_log`; `start_s`, `end_s`, `max_frames`, `stride` as in
    `StereoLog.frames`. `there_and_back`: then the same frames backwards, and how far the run ends from where it began
    in the summary (`there_and_back`). `on_frame` sees each estimate; further `sinks` and the `viewer`, which is
    given the recorded images too, are closed at the end. Memory grows by some 600 bytes a frame, not with the images
    of the log; with `there_and_back` they are kept as recorded, up to a bound. Raises ConfigError, LogError where not
    one frame could be estimated, OutputError, ReplayInterrupted.
    """
    if not isinstance(log, StereoLog):
        log = open_log(log, left, right, calibration, mono=config is not None and config.mono)
    run = _Replay(log, None if out_dir is None else Path(out_dir), config or Config(), list(sinks), viewer)
    frames = log.decoded(start_s, end_s, max_frames, stride)
    if there_and_back:
        run.way_back = WayBack()
        frames = with_return(frames, run.way_back)
    whole = start_s is None and end_s is None and max_frames is None and stride == 1
    with signals_noted() as signals:
        problem = run.through(prepared(run.engine, frames), on_frame, signals)
        result = run.finish(problem, whole, interrupted=bool(signals))
    if signals:
        raise ReplayInterrupted(result)
    if problem is not None:
        raise problem
    return result


class _Replay:
    """The state of one replay."""

    def __init__(
        self,
        log: StereoLog,
        out_dir: Path | None,
        config: Config,
        sinks: list[Sink],
        viewer: "RerunSink | None",
    ) -> None:
        self.log, self.out_dir, self.config, self.sinks, self.viewer = log, out_dir, config, sinks, viewer
        self.engine = Engine(log.rig, config)
        self.account = Account()
        self.structure: StructureComparison | None = None
        if not config.mono:
            self.structure = StructureComparison(log.rig.left)
        self.depths = log.depth_images()
        self.warnings: list[str] = []
        self.complete = True
        self.way_back: WayBack | None = None
        self.cpu_began_s = time.process_time()

    def through(
        self,
        frames: Ahead,
        on_frame: Callable[[FrameEstimate], None] | None,
        signals: list[int],
    ) -> BaseException | None:
        """Step through the frames; the exception that the caller has to see in the end, if any."""
        try:
            while not signals:
                began_s = time.perf_counter()
                item = next(frames, None)
                decoded_s = time.perf_counter()
                if item is None:
                    break
                pair, frame, images = item
                try:
                    estimate = self.engine.step(frame, images)
                except FrameError as error:
                    self.account.refuse(error)
                    continue
                self._write(estimate)
                self.account.add(estimate, decoded_s - began_s, time.perf_counter() - began_s)
                self._compare(estimate)
                if self.viewer is not None:
                    self.viewer.write(estimate, _picture(pair.left, frame.left), _picture(pair.right, frame.right))
                if on_frame is not None:
                    on_frame(estimate)
        except InputError as error:
            if not self.account.stamps_ns:
                return error
            self.complete = False
            self.warnings.append(str(error))
        except BaseException as error:
            self.complete = False
            self.warnings.append(f"the run was ended by {type(error).__name__}: {error}")
            return error
        finally:
            frames.close()
        if not self.account.stamps_ns and self.account.first_refusal is not None:
            return LogError(f"{self.log.path}: no frame could be used: {self.account.first_refusal}")
        return None

    def _write(self, estimate: FrameEstimate) -> None:
        if not self.account.stamps_ns and self.out_dir is not None:
            self._open_files(self.out_dir)
        for sink in self.sinks:
            sink.write(estimate)

    def _open_files(self, out_dir: Path) -> None:
        """With the first estimate, so that a log which cannot be used leaves no folder behind."""
        try:
            out_dir.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot make the folder {out_dir}: {error.strerror}") from None
        write_whole(out_dir / "config.toml", config_to_toml(self.config).encode())
        self.sinks.append(EstimatesWriter(out_dir / "estimates.mcap", self.engine.rig, self.config))
        self.sinks.append(TumWriter(out_dir / "trajectory.tum", UNSCALED if self.config.mono else ""))
        self.sinks.append(KittiWriter(out_dir / "trajectory.kitti"))

    def _compare(self, estimate: FrameEstimate) -> None:
        if self.structure is None:
            return
        try:
            self.structure.add(estimate, self.depths.at(estimate.stamp_ns))
        except InputError as error:
            self.warnings.append(f"ground-truth depth is not compared: {error}")
            self.structure = None

    def finish(self, problem: BaseException | None, whole: bool, interrupted: bool) -> ReplayResult:
        """Close the sinks, evaluate, write the summary. Raises OutputError unless `problem` is worse already."""
        failures: list[Exception] = []
        for sink in self.sinks if self.viewer is None else [*self.sinks, self.viewer]:
            try:
                sink.close()
            except Exception as error:
                failures.append(error)
        trajectory = self.account.trajectory()
        summary = self._summary(trajectory, whole, interrupted)
        if self.out_dir is not None and self.account.stamps_ns:
            try:
                write_whole(self.out_dir / "summary.json", json_bytes(summary))
            except OutputError as error:
                failures.append(error)
        if failures and problem is None:
            raise failures[0]
        return ReplayResult(summary, self.out_dir, trajectory)

    def _summary(self, trajectory: Trajectory, whole: bool, interrupted: bool) -> dict[str, Any]:
        cpu_s = time.process_time() - self.cpu_began_s
        if interrupted:
            self.warnings.append(f"interrupted after {len(trajectory)} frames")
        truth = None
        try:
            truth = self.log.ground_truth() if len(trajectory) else None
        except InputError as error:
            self.warnings.append(f"ground truth is not compared: {error}")
        stats = self.log.stats
        summary = {
            "log": str(self.log.path),
            "method": self.config.method,
            "unscaled": self.config.mono,
            "unit_of_length": UNSCALED if self.config.mono else "metre",
            "complete": self.complete and stats.complete and not interrupted,
            "warnings": list(dict.fromkeys([*stats.warnings, *self.account.warnings(), *self.warnings])),
            "frames": log_figures(stats, self.account, whole),
            **self.account.figures(),
            "cpu_s": cpu_s,
            "peak_rss_mib": peak_rss_mib(),
        }
        if self.way_back is not None:
            if self.way_back.too_long:
                summary["warnings"].append(f"the frames were not fed backwards: {TOO_LONG}; select fewer frames")
            summary["there_and_back"] = None if self.way_back.too_long or interrupted else closure(trajectory)
        if truth is not None:
            summary["ground_truth"] = (
                evaluate_unscaled(trajectory, truth)
                if self.config.mono
                else evaluate(trajectory, truth, self.structure)
            )
        return summary


def new_run_folder(log_path: str | Path, root: str | Path = "runs") -> Path:
    """A name not in use, `<root>/<log>-<local time>`, for a replay of this log; nothing is made yet."""
    root, stem = Path(root), Path(log_path).stem or "log"
    name = f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}"
    folder, number = root / name, 1
    while folder.exists():
        number += 1
        folder = root / f"{name}-{number}"
    return folder


def point_latest_to(folder: Path) -> None:
    """Let `latest`, beside the folder, point to it, where the system knows symbolic links."""
    link = folder.parent / "latest"
    with suppress(OSError):
        if link.is_symlink():
            link.unlink()
        link.symlink_to(folder.name, target_is_directory=True)


def check_selection(start_s: float | None, end_s: float | None) -> None:
    """Raises ConfigError where no frame can lie between."""
    if start_s is not None and end_s is not None and end_s < start_s:
        raise ConfigError(f"the end, {end_s:g} s, lies before the start, {start_s:g} s")


def _picture(recorded: ImageMessage, decoded: NDArray[np.uint8]) -> "Picture":
    """For the viewer: compressed bytes as they were recorded; of a raw image the grey one."""
    return recorded.data if recorded.compressed else decoded
