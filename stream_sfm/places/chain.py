"""The way from keyframe to keyframe: motions put together of the engine's relative motions, with their covariances."""

from dataclasses import dataclass, field

import numpy as np

from ..geometry import se3
from ..geometry.linear import symmetric
from ..geometry.se3 import Array
from ..types import FrameEstimate, RelativeMotions, Status

_MIN_FRAMES = 2  # between keyframes
# Of the median depth, and of the view. At .1 and 8° a corridor has a fifth more keyframes and costs a third more.
_MOVED_DEPTHS, _TURNED_RAD = 0.15, np.radians(11)
_NEW_VIEW = 0.5  # of the points: less in common with the last keyframe, and much of the view is new
_LEAST_VARIANCE = 1e-12  # m² and rad²: of a motion that is known by definition, so that it can be inverted


# Factor on the variance of a motion's own error: successive motions see the same structure, so their errors add up to
# more than independent ones. NEES of the way along a corridor, 6 expected: 9.4 without it.
_SHARED_STRUCTURE = 2.0
UNSEEN = 3  # common errors that come first: of lengths and axes, which turn and scale motions and loops alike


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """The motion between two cameras, as known with the run's common errors c (m,) = `mean`.

    True is first_from_second·Exp(jacobian (c − mean) + own): `first_from_second` (4, 4), `jacobian` (6, m), and `cov`
    (6, 6) of `own`. m is 0 where the motion has nothing in common with others.
    """

    first_from_second: Array
    cov: Array
    jacobian: Array = field(default_factory=lambda: np.zeros((6, 0)))
    mean: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def none(cls) -> "Link":
        """No motion at all."""
        return cls(np.eye(4), np.zeros((6, 6)))

    def given(self, c: Array) -> Array:
        """The motion (4, 4) with common errors c (m,), or (0,) where they are not known."""
        if not len(c) or len(c) != len(self.mean):
            return self.first_from_second
        return se3.orthonormalise(self.first_from_second @ se3.exp(self.jacobian @ (c - self.mean)))

    def then(self, other: "Link") -> "Link":
        """This motion and another one after it, whose own errors are independent."""
        size = max(len(self.mean), len(other.mean))
        mean = other.mean if len(other.mean) else self.mean
        turn = se3.adjoint(se3.inverse(other.first_from_second))
        return Link(
            se3.orthonormalise(self.given(mean) @ other.first_from_second),
            symmetric(turn @ self.cov @ turn.T + other.cov),
            turn @ padded(self.jacobian, size) + padded(other.jacobian, size),
            mean,
        )

    def back(self) -> "Link":
        """The same motion the other way."""
        turn = se3.adjoint(self.first_from_second)
        cov = symmetric(turn @ self.cov @ turn.T)
        return Link(se3.inverse(self.first_from_second), cov, -turn @ self.jacobian, self.mean)

    def total(self, cov_common: Array) -> Array:
        """The covariance (6, 6) with that of the common errors (m, m)."""
        if not len(self.mean):
            return self.cov
        return symmetric(self.cov + self.jacobian @ cov_common @ self.jacobian.T)


def padded(jacobian: Array, size: int) -> Array:
    """A Jacobian (…, 6, size): of nothing in common, if it has no columns."""
    return jacobian if jacobian.shape[-1] == size else np.zeros((*jacobian.shape[:-1], size))


class Chain:
    """Follows the frames of a run, and says when the next keyframe is due and how the camera has moved since the last.

    `link` is the motion from the last keyframe to the newest frame; None where frames between them were lost.
    """

    def __init__(self) -> None:
        self._links: dict[int, Link] = {}
        self._ids: np.ndarray = np.empty(0, np.int64)
        self._keyframe: int | None = None
        self._previous: FrameEstimate | None = None
        self.link: Link | None = None

    def step(self, estimate: FrameEstimate, eager: bool = False) -> bool:
        """Take the next frame; whether it should be a keyframe, which an `eager` caller wants soon."""
        self.link = self._link(estimate)
        self._previous = estimate
        if estimate.status is Status.LOST:
            self._links.clear()
            return False
        if self.link is None:
            return bool(len(estimate.points_in_cam))
        self._links[estimate.frame_index] = self.link
        earliest = int(estimate.window_frame_indices[0]) if len(estimate.window_frame_indices) else 0
        for index in [i for i in self._links if i < earliest]:
            del self._links[index]
        if self._keyframe is None or estimate.frame_index - self._keyframe < _MIN_FRAMES:
            return False
        return eager or self._is_new_view(estimate)

    def set_keyframe(self, estimate: FrameEstimate) -> None:
        """The newest frame has become a keyframe."""
        self._links = {estimate.frame_index: Link.none()}
        self._keyframe, self._ids = estimate.frame_index, estimate.track_ids

    def _is_new_view(self, estimate: FrameEstimate) -> bool:
        assert self.link is not None
        if not len(estimate.points_in_cam):
            return False
        motion = self.link.first_from_second
        moved = np.linalg.norm(motion[:3, 3]) > _MOVED_DEPTHS * np.median(estimate.points_in_cam[:, 2])
        turned = np.linalg.norm(se3.log_so3(motion[:3, :3])) > _TURNED_RAD
        return bool(moved or turned or np.isin(estimate.track_ids, self._ids).mean() < _NEW_VIEW)

    def _link(self, estimate: FrameEstimate) -> Link | None:
        """Over the earliest frame of the window whose way from the keyframe is known; None if there is none."""
        relative = estimate.relative
        if relative is not None:
            for row in np.argsort(relative.frame_indices):
                if (known := self._links.get(int(relative.frame_indices[row]))) is not None:
                    return known.then(_motion(estimate, relative, int(row)))
        before = self._previous
        if before is None or (known := self._links.get(before.frame_index)) is None:
            return None
        if estimate.status is Status.LOST:
            return None
        # The method has no joint covariance: what the pose's own has grown by, which leaves out what both share.
        motion = se3.inverse(before.world_from_cam) @ estimate.world_from_cam
        turn = se3.adjoint(se3.inverse(motion))
        return known.then(Link(motion, growth(turn @ before.cov_pose @ turn.T, estimate.cov_pose)))


def _motion(estimate: FrameEstimate, relative: RelativeMotions, row: int) -> Link:
    """One of the relative motions without what no view shows, which is no error between motions and loops."""
    motion, cov = relative.frame_from_newest[row], relative.cov[row]
    jacobian, common = relative.common_jacobian, estimate.common
    if jacobian is None or common is None:
        return Link(motion, _SHARED_STRUCTURE * cov)
    j = jacobian[row]
    own = _SHARED_STRUCTURE * positive(cov - j @ common.cov @ j.T)
    return Link(motion, own, j[:, UNSEEN:], common.mean[UNSEEN:])


def growth(before: Array, after: Array) -> Array:
    """What covariances (…, 6, 6) have grown by; nothing where they have shrunk."""
    return positive(after - before)


def positive(cov: Array) -> Array:
    """Covariances (…, 6, 6) that rounding and linearisation have not left below zero."""
    values, vectors = np.linalg.eigh(symmetric(cov))
    return np.asarray((vectors * np.maximum(values, _LEAST_VARIANCE)[..., None, :]) @ np.swapaxes(vectors, -1, -2))
