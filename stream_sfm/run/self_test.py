"""A test of covariances without any truth: estimates from disjoint halves of the observations must agree within them.

Even against odd tracks; and tracks born in the left half of the image against those of the right half, which sees also
what neighbouring tracks share. The errors of the rig are one for both halves, so they are given alike to both, and what
is left must agree; what both share altogether, above all the baseline, no such test can see. Each half is estimated by
a window of its own, from the front-end's one set of observations.

Halves that find the errors of the rig by themselves may contradict each other about these, above all the sides of the
image. So the test is made a second time on the observations without the errors that the run has found in the end:
what halves with one calibration differ by is the error of their tracks alone.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ..blas import one_thread
from ..config import Config
from ..estimators import make_estimator
from ..evaluation.relative_consistency import OF_WINDOW, factors
from ..geometry import se3
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..interrupts import Interruption
from ..motion import Motion
from ..observer import Observed
from ..types import FrameEstimate, LastingErrors, Observations, Solution, Status
from .lane import Lane
from .stored import StoredObservations

TESTS = ("tracks", "image")
Mask = NDArray[np.bool_]


class SelfTest:
    """Takes observations frame by frame; `result` has the factors of both tests over each span."""

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._middle_px = (projection.width - 1) / 2
        self._pairs = {
            test: [make_estimator("cross-frame", projection, config) for _ in range(2)] for test in TESTS
        }
        self._apart: dict[tuple[str, int], list[tuple[Array, Array, Array]]] = {}
        self._born_left: dict[int, bool] = {}  # of the tracks in view

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Estimate the next frame from each half."""
        o = observed.observations
        left = o.z_px[:, 0] < self._middle_px
        self._born_left = {
            track: self._born_left.get(track, bool(now))
            for track, now in zip(o.track_ids.tolist(), left, strict=True)
        }
        halves = {"tracks": o.track_ids % 2 == 0, "image": np.array(list(self._born_left.values()), bool)}
        for test, first in halves.items():
            a, b = (
                estimator.step(part_of(o, rows))
                for estimator, rows in zip(self._pairs[test], (first, ~first), strict=True)
            )
            if Status.LOST not in (a.status, b.status):
                self._compare(test, o.frame_index, a, b)

    def _compare(self, test: str, frame_index: int, a: Solution, b: Solution) -> None:
        """Record how far apart the motions of both halves are over each span, given their joint knowledge of c.

        Given c their errors are independent; what of c is not known counts as far as it moves them apart.
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

    def result(self) -> dict[str, list[dict[str, Any]]]:
        """Test -> for each span with motions of both halves: `frames`, `count`, `factor`, `factor_axes` …"""
        found: dict[str, list[dict[str, Any]]] = {test: [] for test in TESTS}
        for test, span in sorted(self._apart, key=lambda key: key[1]):
            error, cov, poses = (np.stack(part) for part in zip(*self._apart[test, span], strict=True))
            found[test].append({"frames": span, **factors(error, cov, poses)})
        return found


class SelfTestOfRun:
    """The check of a run: both tests with halves that find the rig's errors, and with those that the run has found."""

    def __init__(self, lane: Lane) -> None:
        self._lane = lane
        self._by_themselves = SelfTest(lane.observer.projection, lane.config)
        self._stored = None if lane.config.rig.exact else StoredObservations(lane)

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Estimate the next frame from each half. Raises OutputError where the disk is full."""
        if self._stored is not None:
            self._stored.add(observed, estimates)
        self._by_themselves.add(observed, estimates)

    def result(self, interruption: Interruption) -> dict[str, list[dict[str, Any]]]:
        """As of a `SelfTest`, and `tracks_calibrated` and `image_calibrated`: empty if interrupted or the rig exact."""
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
