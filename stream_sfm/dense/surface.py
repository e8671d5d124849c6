"""The surface in a log: dense stereo of one frame, or of all frames, fused with the estimated poses."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from ..camera.rectification import Rectifier
from ..camera.rig import StereoRig, masked_by
from ..config import Config
from ..errors import ConfigError, LogError
from ..geometry import Array, se3
from ..geometry.stereo import StereoProjection
from ..inspection.calibration_check import images_of, log_problems
from ..logs.recording.frames import RecordedFrame
from ..logs.recording.images import decode_rgb
from ..logs.recording.stereo_log import StereoLog, open_log
from ..pictures.prepared import Image
from ..pipeline.observer import Observer
from ..run.lane import Lane
from ..run.loop import run
from ..system.blas import one_thread
from ..system.interrupts import deferred_interrupts
from ..types import Frame, FrameEstimate, Selection, Sink, Status
from .disparity import DenseStereo, DisparityMap
from .fusion import Fusion
from .mesh import Mesh, mesh_of_frame
from .rules import DenseRules

# Measured memory: limit of a run for its images; bytes per pixel of images for tracking and for dense stereo.
_MEMORY_BYTES, _TRACKING_BYTES, _DENSE_BYTES = 800e6, 48, 320
_NOTHING_SEEN = (
    "no surface was found: the images may be black, blurred or without texture, or the calibration may be that of "
    "other cameras"
)


@dataclass(slots=True, eq=False, repr=False)
class Surface:
    """A surface, and its source.

    `mesh`: in axes of the physical left camera, that of the first frame if many were fused. `read`, `used`: frames
    read, and frames in the surface; `voxel_m`: edge of a voxel, 0 for a single frame; `path` (n, 3): positions of the
    left camera in the same axes. `warnings`, `complete` and `interrupted` as in a replay.
    """

    mesh: Mesh
    read: int
    used: int
    voxel_m: float
    path: Array
    warnings: list[str] = field(default_factory=list)
    complete: bool = True
    interrupted: bool = False

    def __repr__(self) -> str:
        return f"<Surface of {self.used} frames: {self.mesh!r}>"


class DenseView:
    """Computes the disparities and the rectified colour image of a stereo frame.

    Large images are reduced by a whole factor, so that memory stays bounded; `projection` is that of the reduced
    images.
    """

    def __init__(self, rectifier: Rectifier, config: Config) -> None:
        self._rectifier = rectifier
        self._factor = _reduction(rectifier.projection.width * rectifier.projection.height)
        self.projection = _reduced_projection(rectifier.projection, self._factor)
        self.cam_from_rect = se3.from_rotation_translation(rectifier.rect_from_cam.T, np.zeros(3))
        valid = self._reduced(rectifier.valid.astype(np.uint8)) == 1
        self._stereo = DenseStereo(self.projection, config.rules.of(DenseRules), valid)

    def see(self, frame: RecordedFrame) -> tuple[DisparityMap, Image]:
        """Return the disparities of a frame, and its rectified left image (h, w, 3)."""
        left, right = (self._reduced(image) for image in self._rectifier.rectify(*images_of(frame)))
        rgb = decode_rgb(frame.recorded.left)
        if rgb is None or rgb.shape[:2] != frame.left.shape:
            picture = np.repeat(left[:, :, None], 3, axis=2)
        else:
            picture = self._reduced(self._rectifier.rectify(rgb)[0])
        return self._stereo.match(left, right), picture

    def _reduced(self, image: Image) -> Image:
        """Return the mean of each block of pixels; incomplete blocks at the right and at the bottom are dropped."""
        if self._factor == 1:
            return image
        width, height = self.projection.width, self.projection.height
        whole = image[: height * self._factor, : width * self._factor]
        return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _reduction(pixels: int) -> int:
    """Return the reduction factor for images of this many pixels: tracking and dense stereo share the memory."""
    granted = (_MEMORY_BYTES - pixels * _TRACKING_BYTES) / _DENSE_BYTES
    return max(1, int(np.ceil(np.sqrt(pixels / granted))))


def _reduced_projection(projection: StereoProjection, factor: int) -> StereoProjection:
    """Return the projection of images whose pixels are `factor` times as wide, with pixel 0 centred on the first."""
    p = projection
    centre = {name: (getattr(p, name) + 0.5) / factor - 0.5 for name in ("cx_left_px", "cx_right_px", "cy_px")}
    return replace(p, f_px=p.f_px / factor, width=p.width // factor, height=p.height // factor, **centre)


def surface(
    log: str | Path | StereoLog,
    frame: int | None = 0,
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    left: str | None = None,
    right: str | None = None,
    calibration: str | Path | StereoRig | None = None,
    sinks: Sequence[Sink] = (),
) -> Surface:
    """Reconstruct the dense surface of one frame of a log, or of all frames fused (`frame=None`).

    `frame` counts the selected frames, from 0; its surface is in axes of its left camera, a fused one in the world.
    `left`, `right`, `calibration`: as in `open_log`. `sinks` take the estimates of a fused surface, and are closed
    at the end. Lost frames are left out; if the log breaks off, or on Ctrl-C, the surface has the frames so far.
    Raises ConfigError if there is no such frame, LogError if no frame could be read or none shows a surface.
    """
    if not isinstance(log, StereoLog):
        log = open_log(log, left, right, calibration)
    config = config or Config()
    config.needs_scale("a surface")
    if frame is None:
        return _of_all_frames(log, config, selection, sinks)
    return _of_one_frame(log, frame, config, selection)


def _of_one_frame(log: StereoLog, number: int, config: Config, selection: Selection | None) -> Surface:
    """Return the surface in one frame, in the axes of its physical left camera."""
    read, frame = 0, None
    for read, frame in enumerate(islice(log.frames(selection), number + 1), 1):  # noqa: B007 the last one counts
        pass
    if frame is None or read <= number:
        if not log.stats.complete:
            raise LogError(f"{log.path}: frame {number} could not be read: {'; '.join(log.stats.warnings)}")
        raise ConfigError(f"{log.path} has no frame {number}: the last one is {read - 1}")
    view = DenseView(Rectifier(masked_by(config, log.stereo_rig)), config)
    found, picture = view.see(frame)
    mesh = mesh_of_frame(view.projection, found, picture, config.rules.of(DenseRules).max_disparity_step_px)
    if not len(mesh.faces):
        raise LogError(f"{log.path}: frame {number}: {_NOTHING_SEEN}", hint=("inspect",))
    warnings = [*log.stats.warnings, *log_problems(log, [frame])]
    return Surface(mesh.moved(view.cam_from_rect), read, 1, 0.0, np.zeros((1, 3)), warnings)


def _of_all_frames(log: StereoLog, config: Config, selection: Selection | None, sinks: Sequence[Sink]) -> Surface:
    """Return the surface in all selected frames, in the world frame, until the log ends or Ctrl-C."""
    with one_thread:
        observer = Observer(log.stereo_rig, config)
        lane = Lane(config, observer, None, None)
        fused = _Fused(log, config, observer.rectifier)
    with deferred_interrupts() as interruption:
        outcome = run(log, lane, [fused, *sinks], selection=selection or Selection(), interruption=interruption)
    if lane.error is not None:
        outcome.end(lane.error)
    if outcome.error is not None:
        raise outcome.error
    fusion, record = fused.fusion, lane.record
    mesh, problems = fusion.mesh(), [*outcome.warnings, *record.warnings()]
    if record.count(Status.LOST):
        problems.append("lost frames are left out, and later parts of the surface may be displaced")
    if not len(mesh.faces):
        raise LogError("; ".join([f"{log.path}: {_NOTHING_SEEN}", *problems]), hint=("inspect",))
    path = record.trajectory().world_from_cam[:, :3, 3]
    return Surface(
        mesh,
        len(path) + record.refused,
        fusion.frames,
        fusion.voxel_m,
        path,
        list(dict.fromkeys([*log.stats.warnings, *(fused.problems or []), *problems])),
        outcome.complete and log.stats.complete,
        outcome.interrupted,
    )


class _Fused(Sink):
    """A sink that fuses frames, unless their pose is lost; `problems` are those of the first frame."""

    def __init__(self, log: StereoLog, config: Config, rectifier: Rectifier) -> None:
        self._log, self._view = log, DenseView(rectifier, config)
        self._rect_from_cam = rectifier.rect_from_cam
        self.fusion = Fusion(self._view.projection, config.rules.of(DenseRules), config.dense.voxel_m)
        self.problems: list[str] | None = None

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        assert isinstance(frame, RecordedFrame)  # of a log
        self.problems = log_problems(self._log, [frame]) if self.problems is None else self.problems
        if estimate.status is not Status.LOST:
            cov_position = self._rect_from_cam @ estimate.cov_pose[:3, :3] @ self._rect_from_cam.T
            world_from_rect = estimate.world_from_cam @ self._view.cam_from_rect
            self.fusion.add(*self._view.see(frame), world_from_rect, cov_position)
