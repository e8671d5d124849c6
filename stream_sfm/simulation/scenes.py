"""Random scenes seen by the converging pair of the paper, section 4.1: their truth and their observations.

Points are projected into the two physical cameras, where noise is added; coordinates and covariance are then mapped
into the rectified pair in which estimators work. All poses and points are in axes of the rectified left camera.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..geometry.stereo import MIN_DEPTH, StereoProjection
from ..types import Observations

WIDTH, HEIGHT = 512, 480  # px; paper
NEAR_M, FAR_M = 2.0, 3.0  # paper: depths of points are uniform between them
F_PX, BASELINE_M, CROSSING_M = 600.0, 0.250, 2.5  # ours: axes cross in the middle of the scene
ROUND_OFF_PX = 12**-0.5  # closed form: standard deviation of rounding to whole pixels
FRAME_NS = 100_000_000  # ours: ten frames per second
_MAX_DRAWS = 50  # rounds of drawing points before the image support is reduced
_LESS_SUPPORT = 0.95  # factor of the support in each round after that
_BEYOND_ENDS = 12  # frames by which the scene extends beyond the first and last camera, more than half a track
_CENTRE = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
_TOE_IN_RAD = float(np.arctan(BASELINE_M / 2 / CROSSING_M))


def rectified_projection() -> StereoProjection:
    """Return the rectified pair, whose principal points keep the crossing point in place."""
    shift = F_PX * np.tan(_TOE_IN_RAD)
    return StereoProjection(
        f_px=F_PX,
        cx_left_px=_CENTRE[0] - shift,
        cx_right_px=_CENTRE[0] + shift,
        cy_px=_CENTRE[1],
        baseline_m=BASELINE_M,
        width=WIDTH,
        height=HEIGHT,
    )


_PROJECTION = rectified_projection()
_RECTIFIED_FROM_PHYSICAL = (
    se3.exp_so3([0.0, _TOE_IN_RAD, 0.0]),  # the left camera looks towards +x, the right one towards −x
    se3.exp_so3([0.0, -_TOE_IN_RAD, 0.0]),
)


def physical_views(points_in_cam: Array) -> Array:
    """Return the pixels (…, 2 sides, 2) of points (…, 3), rectified left axes, in the two physical cameras."""
    sides = []
    for offset, rectified in zip((0.0, BASELINE_M), _RECTIFIED_FROM_PHYSICAL, strict=True):
        p = (points_in_cam - [offset, 0.0, 0.0]) @ rectified  # = (Rᵀ X)ᵀ
        sides.append(F_PX * p[..., :2] / p[..., 2:] + _CENTRE)
    return np.stack(sides, axis=-2)


def rectified_views(pixels: Array, std_px: float) -> tuple[Array, Array]:
    """Return rectified z (…, 4) and covariance (…, 4, 4) of physical pixels (…, 2, 2) with noise std_px."""
    z = np.empty((*pixels.shape[:-2], 4))
    cov = np.zeros((*pixels.shape[:-2], 4, 4))
    centres = ((_PROJECTION.cx_left_px, _CENTRE[1]), (_PROJECTION.cx_right_px, _CENTRE[1]))
    for k, (centre, rectified) in enumerate(zip(centres, _RECTIFIED_FROM_PHYSICAL, strict=True)):
        m = (pixels[..., k, :] - _CENTRE) / F_PX
        ray = np.concatenate([m, np.ones((*m.shape[:-1], 1))], axis=-1) @ rectified.T
        side = slice(2 * k, 2 * k + 2)
        z[..., side] = F_PX * ray[..., :2] / ray[..., 2:] + centre
        j = (rectified[:2, :2] - ray[..., :2, None] / ray[..., 2:, None] * rectified[2, :2]) / ray[..., 2:, None]
        cov[..., side, side] = std_px**2 * j @ np.swapaxes(j, -1, -2)
    return z, cov


@dataclass(frozen=True, slots=True)
class Motion:
    """A camera path along +x that turns about the vertical axis, `step_m` and `turn_rad` per frame, with hand shake.

    Each pose except the first deviates from the smooth path by a Gaussian of `shake_m` and `shake_rad` on each axis.
    """

    step_m: float
    turn_rad: float = 0.0
    shake_m: float = 0.0
    shake_rad: float = 0.0

    def poses(self, frames: int, rng: np.random.Generator) -> Array:
        """Draw the true poses world_from_cam (frames, 4, 4) of one trial; the first is the origin of the world."""
        step = se3.exp(np.array([self.step_m, 0, 0, 0, -self.turn_rad, 0]))
        path = np.empty((frames, 4, 4))
        path[0] = np.eye(4)
        for k in range(1, frames):
            path[k] = se3.orthonormalise(path[k - 1] @ step)
        shake = rng.normal(size=(frames, 6)) * np.repeat([self.shake_m, self.shake_rad], 3)
        shake[0] = 0
        return path @ se3.exp(shake)


# Paper: about 200 mm between frames. Ours: the shake, which keeps round-off noise from repeating; 10 mm, for a path
# that is short compared with the depth of the scene; and the turn of 0.03 rad, a right angle in fifty frames.
MOTIONS = {
    "lateral": Motion(step_m=0.200, shake_m=0.005, shake_rad=0.005),
    "slow": Motion(step_m=0.010, shake_m=0.0005, shake_rad=0.005),
    "arc": Motion(step_m=0.200, turn_rad=0.03, shake_m=0.005, shake_rad=0.005),
}


@dataclass(frozen=True, slots=True)
class Sequence:
    """The truth and the observations of one trial: `world_from_cam` (n, 4, 4), `points_in_world` (p, 3) by track id."""

    projection: StereoProjection
    world_from_cam: Array
    points_in_world: Array
    observations: tuple[Observations, ...]


@dataclass(frozen=True, slots=True)
class Scene:
    """A recipe of trials.

    With `track_length` (L) and `visible` (M), every point is seen in exactly L successive frames, and M points at a
    time, with evenly spread births. Otherwise points are seen whenever both images contain them, `density` per
    frame.

    A point of a controlled scene is drawn from the common view of the cameras in `support_frames` (default L)
    around the middle of its track, so that runs of different L can share one image support. `std_px`: `round_off`
    noise of that deviation (pixels of size std·√12), or Gaussian with `autocorrelation` from view to view of a
    track.
    """

    frames: int = 31
    motion: Motion = MOTIONS["lateral"]
    track_length: int | None = None
    visible: int = 48
    density: float = 60.0
    support_frames: int | None = None
    std_px: float = ROUND_OFF_PX
    round_off: bool = True
    autocorrelation: float = 0.0

    def sequence(self, seed: np.random.SeedSequence) -> Sequence:
        """Draw one trial; the same seed gives the same numbers."""
        rng = np.random.default_rng(seed)
        path = self.motion.poses(self.frames, rng)
        if self.track_length is None:
            points, seen = self._natural(path, rng)
        else:
            points, seen = self._controlled(path, rng)
        frame, track, points = _tracks(seen, points)
        in_cam = np.einsum("kij,kj->ki", se3.inverse(path)[frame, :3, :3], points[track] - path[frame, :3, 3])
        exact = physical_views(in_cam)
        if self.round_off:
            pixel = self.std_px / ROUND_OFF_PX
            measured = np.round(exact / pixel) * pixel
        else:
            white = rng.normal(scale=self.std_px, size=exact.shape)
            measured = exact + _lasting(white, frame, track, self.autocorrelation)
        z, cov = rectified_views(measured, self.std_px)
        observations = []
        for n in range(self.frames):
            rows = slice(*np.searchsorted(frame, [n, n + 1]))
            before = slice(*np.searchsorted(frame, [n - 1, n]))
            observations.append(
                Observations(
                    frame_index=n,
                    stamp_ns=n * FRAME_NS,
                    track_ids=track[rows].astype(np.int64),
                    z_px=z[rows],
                    cov_px=cov[rows],
                    n_new=int((~np.isin(track[rows], track[before])).sum()),
                )
            )
        return Sequence(_PROJECTION, path, points, tuple(observations))

    def _controlled(self, path: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """Draw M·(n + L − 1)/L points whose tracks start evenly from frame 1 − L on; (p, 3) and seen (n, p)."""
        length = min(self.track_length or self.frames, self.frames)
        if length == self.frames:
            birth = np.zeros(self.visible, int)
        else:
            count = -(-self.visible * (self.frames + length - 1) // length)
            birth = np.arange(count) * length // self.visible + 1 - length
        support = self.support_frames or length
        middle = birth + (length - 1) / 2
        twist = _twist(path)  # continues the path at both ends; only image support depends on it
        centre = se3.exp(twist * middle[:, None])
        offsets = np.linspace(-(support - 1) / 2, (support - 1) / 2, 3 if support > 1 else 1)
        points = np.empty((len(birth), 3))
        open_, rounds = np.arange(len(birth)), 0
        while len(open_):
            draw = _draw_in_view(rng, len(open_))
            inside = np.all([_in_view(se3.transform(se3.exp(-twist * o), draw)) for o in offsets], axis=0)
            world = np.einsum("pij,pj->pi", centre[open_, :3, :3], draw) + centre[open_, :3, 3]
            points[open_[inside]] = world[inside]
            open_ = open_[~inside]
            rounds += 1
            if rounds > _MAX_DRAWS:  # no place is in view for that long, so reduce the support
                offsets = _LESS_SUPPORT * offsets
        n = np.arange(self.frames)[:, None]
        return points, (n >= birth) & (n < birth + length)

    def _natural(self, path: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """Draw points along the path and beyond its ends, `density` of them in view per frame; (p, 3), seen (n, p)."""
        tried = int(2 * self.density * (self.frames + 2 * _BEYOND_ENDS))
        anchor = se3.exp(_twist(path) * rng.uniform(-_BEYOND_ENDS, self.frames - 1 + _BEYOND_ENDS, (tried, 1)))
        world = np.einsum("pij,pj->pi", anchor[:, :3, :3], _draw_in_view(rng, tried)) + anchor[:, :3, 3]
        seen = np.stack([_in_view(se3.transform(se3.inverse(p), world)) for p in path])
        visible = seen.sum() / self.frames / tried  # fraction of the points in view of an average frame
        count = min(tried, round(self.density / max(visible, 1 / tried)))
        return world[:count], seen[:, :count]


def _lasting(white: Array, frame: NDArray[np.intp], track: NDArray[np.intp], autocorrelation: float) -> Array:
    """Return noise of the same variance as `white` (k, …) that is autocorrelated along tracks, eq. (76)."""
    result = white.copy()
    if autocorrelation == 0:
        return result
    latest = np.full(track.max() + 1, -1)  # the row of the latest view of each track
    for n in range(frame.max() + 1):
        rows = np.arange(*np.searchsorted(frame, [n, n + 1]))
        before = latest[track[rows]]
        later = before >= 0
        result[rows[later]] *= np.sqrt(1 - autocorrelation**2)
        result[rows[later]] += autocorrelation * result[before[later]]
        latest[track[rows]] = rows
    return result


def _twist(path: Array) -> Array:
    """Return the motion (6,) per frame on the smooth path through the first and last pose."""
    return np.asarray(se3.log(path[-1]) / max(1, len(path) - 1))


def _in_view(points_in_cam: Array) -> NDArray[np.bool_]:
    """Return whether both physical images contain the points (…, 3)."""
    pixels = physical_views(points_in_cam)
    inside = (pixels >= -0.5) & (pixels < [WIDTH - 0.5, HEIGHT - 0.5])
    return (points_in_cam[..., 2] > MIN_DEPTH) & inside.all(axis=(-1, -2))


def _draw_in_view(rng: np.random.Generator, n: int) -> Array:
    """Draw points (n, 3) uniform in depth and over the left image, whether or not the right image contains them."""
    depth = rng.uniform(NEAR_M, FAR_M, n)
    pixel = rng.uniform([-0.5, -0.5], [WIDTH - 0.5, HEIGHT - 0.5], (n, 2))
    ray = np.column_stack([(pixel - _CENTRE) / F_PX, np.ones(n)]) @ _RECTIFIED_FROM_PHYSICAL[0].T
    return ray * (depth / ray[:, 2])[:, None]


def _tracks(seen: NDArray[np.bool_], points: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Return views as (frame, track) rows, ascending; a point that returns into view is a track with a new id."""
    born = seen & ~np.vstack([np.zeros((1, seen.shape[1]), bool), seen[:-1]])
    birth_frame, birth_point = np.nonzero(born)  # ascending by frame: ids ascend with time
    number = np.zeros(seen.shape, np.intp)
    number[birth_frame, birth_point] = np.arange(len(birth_frame)) + 1
    number = np.maximum.accumulate(number, axis=0) - 1
    frame, point = np.nonzero(seen)
    track = number[frame, point]
    order = np.lexsort((track, frame))
    return frame[order], track[order], points[birth_point]
