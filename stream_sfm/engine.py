"""The page to read first: one stereo frame in, one estimate out. No I/O, no printing.

rectify -> front-end (observations) -> estimator (solution) -> the same in axes of the physical left camera. With one
camera (`Config.mono`) other parts of the same kind do this; all else is the same.
"""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .camera.models import MonoRig, StereoRig
from .camera.rectification import MonoRectifier, Rectifier
from .config import Config
from .errors import ConfigError, FrameError
from .estimators import make_estimator
from .estimators.cross_frame.mono import CrossFrameMono
from .frontend.front_end import FrontEnd
from .frontend.mono.front_end import MonoFrontEnd
from .frontend.prepared import PreparedImages
from .geometry import se3
from .geometry.se3 import Array
from .geometry.stereo import StereoProjection
from .types import Estimator, FrameEstimate, MonoFrame, Observations, Solution, StereoFrame


class Engine:
    """Stereo odometry, live: `step` takes bounded time and memory however long the run.

    With `Config.mono` only the left camera of a rig is looked at. Raises ConfigError for a rig or configuration that
    cannot work.
    """

    def __init__(self, rig: StereoRig | MonoRig, config: Config | None = None) -> None:
        self.config = config or Config()
        self.rectifier: Rectifier | MonoRectifier
        self.frontend: FrontEnd
        self.estimator: Estimator
        if self.config.mono:
            self.rig: StereoRig | MonoRig = MonoRig(rig.left)
            self.rectifier = MonoRectifier(rig.left)
            self.frontend = MonoFrontEnd(self.rectifier.projection, self.config, self.rectifier.valid)
            self.estimator = CrossFrameMono(self.rectifier.projection, self.config)
        elif isinstance(rig, StereoRig):
            self.rig, self.rectifier = rig, Rectifier(rig)
            self.frontend = FrontEnd(self.rectifier.projection, self.config, self.rectifier.valid)
            self.estimator = make_estimator(self.config.method, self.rectifier.projection, self.config)
        else:
            raise ConfigError("a rig of one camera needs Config(mono=True); its results have no scale")
        self._next_index = 0
        self._last_stamp_ns: int | None = None

    def prepare(self, frame: StereoFrame | MonoFrame, frame_index: int | None = None) -> PreparedImages:
        """Do what `step` does first with the images and needs no other frame for, so that another thread can do it
        one frame ahead.

        Pure: it may be called at any time, in any order, also for frames that are never stepped. Where the
        `frame_index` of the coming estimate is known (frames count from 0), more of the work is done here; the
        estimates are the same.
        """
        images = self.rectifier.rectify(*frame.images[: len(self.rig.cameras)])
        return self.frontend.prepare(*images, frame_index=frame_index)

    def step(self, frame: StereoFrame | MonoFrame, prepared: PreparedImages | None = None) -> FrameEstimate:
        """The estimate of the next frame; `prepared`: what `prepare` gave for it, if that was done already.

        Raises FrameError for images of the wrong kind or a stamp that does not advance; the engine is then
        unchanged and takes the next frame.
        """
        self._check(frame)
        t0 = time.perf_counter()
        pair = self.prepare(frame, self._next_index) if prepared is None else prepared
        t1 = time.perf_counter()
        observations = self.frontend.step(self._next_index, frame.stamp_ns, pair)
        t2 = time.perf_counter()
        solution = self.estimator.step(observations)
        t3 = time.perf_counter()
        self._next_index += 1
        self._last_stamp_ns = frame.stamp_ns
        timings = {"rectify": t1 - t0, "frontend": t2 - t1, "estimator": t3 - t2}
        std_bias_px = self.frontend.shared_errors.of
        return in_camera_axes(solution, observations, self.rectifier, std_bias_px, timings)

    def _check(self, frame: StereoFrame | MonoFrame) -> None:
        where = f"frame {self._next_index} (stamp {frame.stamp_ns} ns)"
        if isinstance(frame.stamp_ns, bool) or not isinstance(frame.stamp_ns, int | np.integer):
            raise FrameError(f"{where}: stamp_ns must be an integer number of nanoseconds")
        if self._last_stamp_ns is not None and frame.stamp_ns <= self._last_stamp_ns:
            raise FrameError(
                f"{where}: stamps must grow, the last frame had {self._last_stamp_ns} ns; drop this frame"
            )
        cameras, images = self.rig.cameras, frame.images
        if len(images) < len(cameras):
            raise FrameError(f"{where}: one image only; give a StereoFrame, or estimate with Config(mono=True)")
        for (side, camera), image in zip(cameras.items(), images, strict=False):
            if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
                kind = getattr(image, "dtype", type(image).__name__)
                raise FrameError(f"{where}: the {side} image is {kind}; give a NumPy array of uint8 (mono, h × w)")
            if image.shape != (camera.height, camera.width):
                raise FrameError(
                    f"{where}: the {side} image has shape {image.shape}, the calibration says "
                    f"({camera.height}, {camera.width}); give mono images of the calibrated size"
                )


def in_camera_axes(
    solution: Solution,
    observations: Observations,
    rectifier: Rectifier | MonoRectifier,
    std_bias_px: Callable[[NDArray[np.int64]], Array],
    timings_s: dict[str, float],
) -> FrameEstimate:
    """A Solution in rectified axes as the FrameEstimate in the physical left camera's axes.

    The world is the first physical left camera: T_cam = C⁻¹ T_rect C, and right perturbations turn with C⁻¹, eq. (7).
    Each point's covariance gets the disparity bias that all its views share, of which `std_bias_px` knows σ (n,) px by
    ids (n,). Points seen for the first time are not reported yet: one match of left and right may be wrong, and only a
    second view can tell.
    """
    n = len(observations.track_ids)
    shown = ~np.isin(solution.track_ids, observations.track_ids[n - observations.n_new :])
    in_cam = solution.points_in_cam[shown]
    r = rectifier.rect_from_cam.T  # cam_from_rect
    c = np.eye(4)
    c[:3, :3] = rectifier.rect_from_cam
    cov_bias = bias_covariances(in_cam, std_bias_px(solution.track_ids[shown]), rectifier.projection)
    world_r = solution.world_from_cam[:3, :3]
    last = solution.window_world_from_cam[0]  # an ended point was seen last about when the window begins
    ended = se3.transform(se3.inverse(last), solution.ended_points_in_world)
    cov_ended = bias_covariances(ended, std_bias_px(solution.ended_ids), rectifier.projection)
    cov_ended = solution.ended_cov_points_in_world + last[:3, :3] @ cov_ended @ last[:3, :3].T
    c_inv = c.T
    r6 = np.zeros((6, 6))
    r6[:3, :3] = r6[3:, 3:] = r

    def points(p: Array) -> Array:
        return p @ r.T

    def covariances(s: Array) -> Array:
        return r @ s @ r.T

    return FrameEstimate(
        frame_index=observations.frame_index,
        stamp_ns=int(observations.stamp_ns),
        status=solution.status,
        reason=solution.reason,
        world_from_cam=c_inv @ solution.world_from_cam @ c,
        cov_pose=r6 @ solution.cov_pose @ r6.T,
        track_ids=solution.track_ids[shown],
        points_in_cam=points(in_cam),
        cov_points=covariances(solution.cov_points[shown] + cov_bias),
        points_in_world=points(solution.points_in_world[shown]),
        cov_points_in_world=covariances(solution.cov_points_in_world[shown] + world_r @ cov_bias @ world_r.T),
        window_frame_indices=solution.window_frame_indices,
        window_world_from_cam=c_inv @ solution.window_world_from_cam @ c,
        ended_ids=solution.ended_ids,
        ended_points_in_world=points(solution.ended_points_in_world),
        ended_cov_points_in_world=covariances(cov_ended),
        counts={
            "tracked": n - observations.n_new,
            "new": observations.n_new,
            "used": len(solution.track_ids),
            "rejected": len(solution.rejected_ids),
        },
        nis=solution.nis,
        nis_dof=solution.nis_dof,
        timings_ms={name: 1e3 * t for name, t in timings_s.items()},
        unscaled=rectifier.unscaled,
    )


def bias_covariances(points_in_cam: Array, std_bias_px: Array, projection: StereoProjection) -> Array:
    """(n, 3, 3) m²: what errors of disparity that all views of a point share, σ (n,), do to points (n, 3), eq. (18)."""
    share = points_in_cam[:, 2] * std_bias_px / (projection.f_px * projection.baseline_m)
    moved = points_in_cam * share[:, None]
    return moved[:, :, None] * moved[:, None, :]
