"""The path from keyframe to keyframe: motions composed of the engine's relative motions, with covariances."""

import numpy as np

from ..geometry import Array, se3
from ..geometry.linear import LEAST_VARIANCE, symmetric
from ..motion import UNSEEN, Motion
from ..types import FrameEstimate, Status
from .settings import SETTINGS


class Chain:
    """Follows the frames of a run, decides when the next keyframe is due, and tracks the motion since the last one.

    `link` is the motion from the last keyframe to the newest frame; None if it is not known.
    """

    def __init__(self) -> None:
        self._links: dict[int, Motion] = {}
        self._ids: np.ndarray = np.empty(0, np.int64)
        self._keyframe: int | None = None
        self._previous: FrameEstimate | None = None
        self.link: Motion | None = None

    def step(self, estimate: FrameEstimate, eager: bool = False) -> bool:
        """Take the next frame; return whether it should be a keyframe, sooner if `eager`."""
        self.link = self._link(estimate)
        self._previous = estimate
        if self.link is not None and self.link.cov[3:, 3:].trace() > SETTINGS.unknown_rad**2:
            self.link = None  # later frames may bypass this one
        earliest = int(estimate.window_frame_indices[0]) if len(estimate.window_frame_indices) else 0
        for index in [i for i in self._links if i < earliest or estimate.status is Status.LOST]:
            del self._links[index]
        if self.is_cut:
            known = estimate.status in (Status.INITIALISING, Status.OK)
            return bool(len(estimate.points_in_cam)) and (known or self._keyframe is None)
        if self.link is None:
            return False
        self._links[estimate.frame_index] = self.link
        if self._keyframe is None or estimate.frame_index - self._keyframe < SETTINGS.min_frames:
            return False
        return eager or self._is_new_view(estimate)

    @property
    def is_cut(self) -> bool:
        """Whether no motion connects the last keyframe with the newest frame, or with any later one."""
        return self.link is None and not self._links

    def set_keyframe(self, estimate: FrameEstimate) -> None:
        """Record that the newest frame has become a keyframe."""
        self._links = {estimate.frame_index: Motion(np.eye(4), np.zeros((6, 6)))}
        self._keyframe, self._ids = estimate.frame_index, estimate.track_ids

    def _is_new_view(self, estimate: FrameEstimate) -> bool:
        assert self.link is not None
        if not len(estimate.points_in_cam):
            return False
        motion = self.link.earlier_from_newest
        moved = np.linalg.norm(motion[:3, 3]) > SETTINGS.moved_depths * np.median(estimate.points_in_cam[:, 2])
        turned = np.linalg.norm(se3.log_so3(motion[:3, :3])) > SETTINGS.turned_rad
        return bool(moved or turned or np.isin(estimate.track_ids, self._ids).mean() < SETTINGS.new_view)

    def _link(self, estimate: FrameEstimate) -> Motion | None:
        """Return the link over the earliest frame of the window with a known link to the keyframe; None without one."""
        relative = estimate.relative
        if relative is not None:
            for row in np.argsort(relative.frame_indices):
                if (known := self._links.get(int(relative.frame_indices[row]))) is not None:
                    return known.then(_motion(estimate, int(relative.frame_indices[row])))
        before = self._previous
        if before is None or (known := self._links.get(before.frame_index)) is None:
            return None
        if estimate.status is Status.LOST:
            return None
        # The method has no joint covariance: take the growth of the covariance of the pose, which excludes shared
        # errors.
        motion = se3.inverse(before.world_from_cam) @ estimate.world_from_cam
        turn = se3.adjoint(se3.inverse(motion))
        return known.then(Motion(motion, positive(estimate.cov_pose - turn @ before.cov_pose @ turn.T)))


def _motion(estimate: FrameEstimate, frame_index: int) -> Motion:
    """Return a relative motion without errors that no view shows, as motions and loops share these."""
    motion = Motion.to_frame(frame_index, estimate.relative, estimate.common)
    assert motion is not None
    seen = slice(UNSEEN, None)
    return Motion(
        motion.earlier_from_newest,
        SETTINGS.shared_structure * positive(motion.cov_own),
        motion.common_jacobian[:, seen],
        motion.mean[seen],
        motion.cov_common[seen, seen],
    )


def positive(cov: Array) -> Array:
    """Return covariances (…, 6, 6) without negative eigenvalues that rounding and linearisation left."""
    values, vectors = np.linalg.eigh(symmetric(cov))
    return np.asarray((vectors * np.maximum(values, LEAST_VARIANCE)[..., None, :]) @ np.swapaxes(vectors, -1, -2))
