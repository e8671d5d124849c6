"""A test of covariances without ground truth: estimates from disjoint halves of the observations must agree.

One test compares even with odd tracks. The other compares tracks that start in the left and right half of the image,
which also shows errors that neighbouring tracks share. Both halves have the same rig, so they get the same estimate of
its errors, and the rest must agree. No such test can show errors that both halves share entirely, above all that of the
baseline. Each half is estimated by its own window, from the same observations of the front-end.

Halves that estimate the rig errors themselves may contradict each other about these, above all the sides of the image.
The test is therefore repeated on observations without the errors that the run has found in the end: the difference of
halves with the same calibration is the error of their tracks alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..errors import StreamSfmError
from ..estimators import make_estimator
from ..evaluation.own_and_common import common_apart
from ..evaluation.relative_consistency import OF_WINDOW, factors
from ..geometry import Array, se3
from ..geometry.linear import mahalanobis2
from ..geometry.stereo import StereoProjection
from ..motion import Motion
from ..pipeline.observer import Observed
from ..report.records import HalvesRecord
from ..system.blas import one_thread
from ..system.interrupts import Interruption
from ..types import Estimator, FrameEstimate, LastingErrors, Observations, Solution, Status
from .lane import Lane
from .stored import StoredObservations

TESTS = ("tracks", "image")
MOST_FRAMES = 200  # for `Halves`: enough for spans of fifty, in bounded time
Mask = NDArray[np.bool_]


class SelfTest:
    """Takes observations frame by frame; `result` has the factors of both tests over each span."""

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._middle_px = (projection.width - 1) / 2
        self._pairs = {test: _pair("cross-frame", projection, config) for test in TESTS}
        self._apart: dict[tuple[str, int], list[tuple[Array, Array, Array]]] = {}
        self._common: dict[str, float | None] = {}  # the distance of the halves' common errors over its σ, latest
        self._born_left: dict[int, bool] = {}  # for the tracks in view

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Estimate the next frame from each half."""
        o = observed.observations
        left = o.z_px[:, 0] < self._middle_px
        self._born_left = {
            track: self._born_left.get(track, bool(now)) for track, now in zip(o.track_ids.tolist(), left, strict=True)
        }
        halves = {"tracks": o.track_ids % 2 == 0, "image": np.array(list(self._born_left.values()), bool)}
        for test, first in halves.items():
            a, b = _stepped(self._pairs[test], o, first)
            if Status.LOST not in (a.status, b.status):
                self._compare(test, o.frame_index, a, b)

    def _compare(self, test: str, frame_index: int, a: Solution, b: Solution) -> None:
        """Record the distance between the motions of both halves over each span, given their joint estimate of c.

        Given c, their errors are independent; the uncertainty of c counts as far as it moves them apart.
        """
        for span in OF_WINDOW:
            one, other = (Motion.to_frame(frame_index - span, half.relative, half.common) for half in (a, b))
            if one is None or other is None or one.mean.shape != other.mean.shape:
                continue
            share = one.cov_common @ np.linalg.pinv(one.cov_common + other.cov_common, hermitian=True)
            c = one.mean + share @ (other.mean - one.mean)
            poses = [
                half.earlier_from_newest @ se3.exp(half.common_jacobian @ (c - half.mean)) for half in (one, other)
            ]
            apart = one.common_jacobian - other.common_jacobian
            cov = one.cov_own + other.cov_own + apart @ share @ other.cov_common @ apart.T
            error = se3.log(se3.inverse(poses[0]) @ poses[1])
            self._apart.setdefault((test, span), []).append((error, cov, poses[0]))
            self._common[test] = common_apart(one, other)

    def result(self) -> dict[str, list[dict[str, Any]]]:
        """Return test -> for each span with motions of both halves: `frames`, `count`, `factor`, `factor_axes` …

        Both halves are given the same errors of the rig, so that `factor` is that of their own errors; what they found
        of the rig in the end is compared by `factor_common`.
        """
        found: dict[str, list[dict[str, Any]]] = {test: [] for test in TESTS}
        for test, span in sorted(self._apart, key=lambda key: key[1]):
            error, cov, poses = (np.stack(part) for part in zip(*self._apart[test, span], strict=True))
            of_motions = factors(error, cov, poses)
            parts = {"factor_own": of_motions["factor"], "factor_common": self._common[test]}
            found[test].append({"frames": span, **of_motions, **parts})
        return found


class SelfTestOfRun:
    """The check of a run: both tests, with the rig errors that each half finds and with those of the run."""

    def __init__(self, lane: Lane) -> None:
        self._lane = lane
        self._by_themselves = SelfTest(lane.observer.projection, lane.config)
        self._stored = None if lane.config.rig.exact else StoredObservations(lane)

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Estimate the next frame from each half. Raises OutputError if the disk is full."""
        if self._stored is not None:
            self._stored.add(observed, estimates)
        self._by_themselves.add(observed, estimates)

    def result(self, interruption: Interruption) -> dict[str, list[dict[str, Any]]]:
        """Return `SelfTest.result` with `tracks_calibrated` and `image_calibrated`: empty if interrupted or exact."""
        exact = msgspec.structs.replace(self._lane.config.rig, exact=True)
        calibrated = SelfTest(self._lane.observer.projection, msgspec.structs.replace(self._lane.config, rig=exact))
        if self._stored is not None and not interruption.requested:
            with one_thread:
                for observed in interruption.until_requested(self._stored.calibrated(self._lane.observer)):
                    calibrated.add(observed, {})
        later = calibrated.result()
        return self._by_themselves.result() | {f"{test}_calibrated": later[test] for test in TESTS}

    def close(self) -> None:
        """Remove what is stored."""
        if self._stored is not None:
            self._stored.close()


class Halves:
    """Takes observations frame by frame, for one method on the even tracks and on the odd ones.

    This gives its errors, and whether its covariances are consistent, without ground truth; except for errors that
    all tracks of a frame share, above all the calibration. If the estimator fails on either half, `record` ends
    there.
    """

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._pair = _pair(config.method, projection, config)
        self.method, self.record = config.method, HalvesRecord()
        self.failed = False

    def take(self, observations: Observations) -> None:
        """Estimate the next frame from each half."""
        if self.failed:
            return
        try:
            found = _stepped(self._pair, observations, observations.track_ids % 2 == 0)
        except (ArithmeticError, ValueError, LookupError, StreamSfmError):
            self.failed = True
            return
        if Status.LOST in (found[0].status, found[1].status):
            self.record.add(np.full((2, 4, 4), np.nan), float("nan"))
        else:
            self.record.add(np.stack([half.world_from_cam for half in found]), _nees(*found))


def _nees(one: Solution, other: Solution) -> float:
    """Return the NEES of the difference of two poses, 6 expected; NaN without covariances, as at the start."""
    cov = one.cov_pose + other.cov_pose
    if not (np.isfinite(cov).all() and (np.diag(cov) > 0).all()):
        return float("nan")
    apart = se3.log(se3.inverse(one.world_from_cam) @ other.world_from_cam)
    return float(mahalanobis2(apart[None], cov[None])[0])


def _pair(method: str, projection: StereoProjection, config: Config) -> list[Estimator]:
    return [make_estimator(method, projection, config) for _ in range(2)]


def _stepped(pair: Sequence[Estimator], observations: Observations, first: Mask) -> list[Solution]:
    """Estimate the next frame from the tracks that are `first`, and from the others."""
    return [e.step(part_of(observations, rows)) for e, rows in zip(pair, (first, ~first), strict=True)]


def part_of(observations: Observations, rows: Mask) -> Observations:
    """Return the observations of some tracks."""
    o, n_old = observations, len(observations.track_ids) - observations.n_new
    return replace(
        o,
        track_ids=o.track_ids[rows],
        z_px=o.z_px[rows],
        cov_px=o.cov_px[rows],
        n_new=int(np.count_nonzero(rows[n_old:])),
        lasting=LastingErrors(
            None if o.lasting.std_drift_px is None else o.lasting.std_drift_px[rows],
            None if o.lasting.inflation is None else o.lasting.inflation[rows],
        ),
    )
