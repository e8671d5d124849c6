"""Views of a cloud of points along a swaying path, with inertial samples: input for estimators, without images."""

from collections.abc import Iterator, Sequence

import numpy as np

from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.types import InertialView, Observations, Solution
from tools.render.inertial import BMI160, Unit, measured

PROJECTION = StereoProjection(
    f_px=300.0, cx_left_px=160.0, cx_right_px=160.0, cy_px=120.0, baseline_m=0.1, width=320, height=240
)
FRAME_NS, STD_PX, POINTS = 50_000_000, 0.4, 200
DOWN = np.array([0.0, 1.0, 0.0])
BODY_M_S = np.array([0.8, 0.0, 0.0])


def swaying(seed: int) -> "Swaying":
    """Return a path like that of a hand, drawn from a seed."""
    return Swaying(np.random.default_rng([seed, 1]))


class Swaying:
    """The pose (4, 4) in its own first camera as a function of seconds: forwards at a walk, swaying about all axes."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rate, self._phase = rng.uniform(1.0, 6.0, 6), rng.uniform(0, 2 * np.pi, 6)
        self._size = rng.uniform(0.3, 1.0, 6) * np.repeat([0.06, 0.05], 3)
        self._first = se3.inverse(self._at(0.0))

    def _at(self, seconds: float) -> Array:
        xi = self._size * np.sin(self._rate * seconds + self._phase)
        forwards = se3.exp(np.array([0.0, 0.0, 0.5 * seconds, 0.0, 0.1 * seconds, 0.0]))
        return np.asarray(forwards @ se3.exp(xi))

    def __call__(self, seconds: float) -> Array:
        return np.asarray(self._first @ self._at(seconds))

    @property
    def down(self) -> Array:
        """The direction of gravity in the first camera."""
        return np.asarray(self._first[:3, :3] @ DOWN)


def rms_m(found: Sequence[Solution], poses: Sequence[Array]) -> float:
    """The error of positions."""
    apart = [e.world_from_cam[:3, 3] - p[:3, 3] for e, p in zip(found, poses, strict=True)]
    return float(np.sqrt(np.mean(np.square(apart))))


def observed(
    seed: int, frames: int, unit: Unit = BMI160, std_stamp_s: float = 0.0, body_from: int | None = None
) -> Iterator[tuple[Array, Observations]]:
    """Yield true poses and observations: each view with noise of STD_PX, samples up to one beyond the frame.

    Stamps err by `std_stamp_s`. From frame `body_from` on nothing is seen but other points, of a body at BODY_M_S.
    """
    path, rng, late_s = swaying(seed), np.random.default_rng([seed, 2]), np.random.default_rng([seed, 3])
    cloud = rng.uniform([-6.0, -3.0, 1.0], [6.0, 3.0, 9.0], (POINTS, 3))
    samples = measured(path, (-0.1, FRAME_NS * frames / 1e9), path.down, unit, seed)
    cov = STD_PX**2 * np.eye(4)
    ids, next_id, last_ns = np.full(POINTS, -1), 0, -(10**18)
    for n in range(frames):
        stamp_ns = n * FRAME_NS
        pose = path(stamp_ns / 1e9 + (late_s.normal() * std_stamp_s if n else 0.0))
        by_body = np.zeros(3)
        if body_from is not None and n >= body_from:
            by_body = BODY_M_S * (n - body_from) * FRAME_NS / 1e9
            ids[:] = -1 if n == body_from else ids
        in_cam = se3.transform(se3.inverse(pose), cloud + by_body)
        z = PROJECTION.project(np.maximum(in_cam, [-np.inf, -np.inf, 0.1]))
        inside = (z[:, [0, 2]] > 0).all(axis=1) & (z[:, [0, 2]] < 320).all(axis=1) & (z[:, 1] > 0) & (z[:, 1] < 240)
        seen = inside & (in_cam[:, 2] > 0.8)
        ids[~seen] = -1
        new = np.flatnonzero(seen & (ids < 0))
        ids[new] = next_id + np.arange(len(new))
        next_id += len(new)
        rows = np.flatnonzero(seen)
        rows = rows[np.argsort(ids[rows])]
        coming = (samples.stamps_ns > last_ns) & (samples.stamps_ns <= stamp_ns + 5_000_000)
        last_ns = stamp_ns + 5_000_000
        view = InertialView(samples[coming], unit.calibration)
        noise = rng.normal(size=(len(rows), 4)) * STD_PX
        of_all = np.broadcast_to(cov, (len(rows), 4, 4)).copy()
        yield (
            pose,
            Observations(n, stamp_ns, ids[rows].copy(), z[rows] + noise, of_all, n_new=len(new), inertial=view),
        )
