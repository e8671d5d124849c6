"""A log to a surface: dense stereo of one frame, or of all frames fused by the poses that the engine estimates."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..camera.rectification import Rectifier
from ..config import Config
from ..engine import Engine
from ..errors import ConfigError, InputError, LogError
from ..geometry import se3
from ..geometry.se3 import Array
from ..interrupts import signals_noted
from ..recording import StereoLog, StereoPair
from ..recording.images import decode_rgb
from ..types import FrameEstimate, Status, StereoFrame
from .disparity import DenseStereo, DisparityMap
from .fusion import Fusion
from .mesh import Mesh, mesh_of_frame

Frames = Iterator[tuple[StereoPair, StereoFrame]]
_NOTHING_SEEN = (
    "no surface could be found: are the images black, blurred or without texture, or is the calibration that of "
    "other cameras?"
)


@dataclass(slots=True)
class Surface:
    """`mesh` in axes of the physical left camera: of the frame, or of the first frame where many were fused.

    `read`: frames read; `used`: frames that are part of it; `voxel_m`: 0 where nothing was fused; `path` (n, 3): where
    the left camera was, same axes. `warnings`, `complete`, `interrupted`: as in a replay.
    """

    mesh: Mesh
    read: int
    used: int
    voxel_m: float
    path: Array
    warnings: list[str] = field(default_factory=list)
    complete: bool = True
    interrupted: bool = False


class DenseView:
    """What one stereo frame shows: rectification and dense stereo of a rig."""

    def __init__(self, rectifier: Rectifier, config: Config) -> None:
        self._rectifier = rectifier
        self.projection = rectifier.projection
        self.cam_from_rect = se3.from_rotation_translation(rectifier.rect_from_cam.T, np.zeros(3))
        self._stereo = DenseStereo(rectifier.projection, config.dense, rectifier.valid)

    def see(self, pair: StereoPair, frame: StereoFrame) -> tuple[DisparityMap, NDArray[np.uint8]]:
        """Disparities, and the rectified left image (h, w, 3), red green blue."""
        left, right = self._rectifier.rectify(frame.left, frame.right)
        rgb = decode_rgb(pair.left)
        if rgb is None or rgb.shape[:2] != frame.left.shape:
            picture = np.repeat(left[:, :, None], 3, axis=2)
        else:
            picture = self._rectifier.rectify(rgb, frame.right)[0]
        return self._stereo.match(left, right), picture


def surface_of_frame(log: StereoLog, frames: Frames, number: int, config: Config) -> Surface:
    """The surface that frame `number`, from 0, of `frames` shows, in the axes of its physical left camera.

    Raises ConfigError where there is no such frame, LogError where it shows no surface or could not be read.
    """
    config.needs_scale("a surface")
    read = 0
    wanted = None
    for item in frames:
        read += 1
        if read > number:
            wanted = item
            break
    if wanted is None:
        if not log.stats.complete:
            raise LogError(f"{log.path}: frame {number} could not be read: {'; '.join(log.stats.warnings)}")
        raise ConfigError(f"{log.path}: there is no frame {number}, the last one is {read - 1}")
    view = DenseView(Rectifier(log.stereo_rig), config)
    found, picture = view.see(*wanted)
    mesh = mesh_of_frame(view.projection, found, picture, config.dense.max_disparity_step_px)
    if not len(mesh.faces):
        raise LogError(f"{log.path}: frame {number}: {_NOTHING_SEEN}", hint=("inspect",))
    return Surface(mesh.moved(view.cam_from_rect), read, 1, 0.0, np.zeros((1, 3)), log.stats.warnings)


def surface_of_log(
    log: StereoLog, frames: Frames, config: Config, on_frame: Callable[[FrameEstimate], None] | None = None
) -> Surface:
    """The surface that all `frames` show together, in the world: the axes of the first left camera.

    Frames whose pose is lost are left out. A log that breaks off, and Ctrl-C, end it with what was seen until then.
    `on_frame` sees each estimate. Raises LogError where no frame can be read or none shows a surface.
    """
    config.needs_scale("a surface")
    engine = Engine(log.stereo_rig, config)
    assert isinstance(engine.observer.rectifier, Rectifier)
    view = DenseView(engine.observer.rectifier, config)
    fusion = Fusion(view.projection, config.dense)
    rect_from_cam = engine.observer.rectifier.rect_from_cam
    path: list[Array] = []
    problems: list[str] = []
    lost = 0
    with signals_noted() as signals:
        try:
            for pair, frame in frames:
                estimate = engine.step(frame)
                path.append(estimate.world_from_cam[:3, 3])
                if estimate.status is Status.LOST:
                    lost += 1
                else:
                    cov_position = rect_from_cam @ estimate.cov_pose[:3, :3] @ rect_from_cam.T
                    fusion.add(*view.see(pair, frame), estimate.world_from_cam @ view.cam_from_rect, cov_position)
                if on_frame is not None:
                    on_frame(estimate)
                if signals:
                    break
        except InputError as error:
            if not path:
                raise
            problems.append(str(error))
    mesh = fusion.mesh()
    if signals:
        problems.append(f"interrupted after {len(path)} frames")
    complete = log.stats.complete and not problems
    if lost:
        problems.append(f"{lost} of {len(path)} frames are lost and left out; what was seen after may be displaced")
    if not len(mesh.faces):
        raise LogError("; ".join([f"{log.path}: {_NOTHING_SEEN}", *problems]), hint=("inspect",))
    warnings = list(dict.fromkeys([*log.stats.warnings, *problems]))
    return Surface(
        mesh, len(path), fusion.frames, fusion.voxel_m, np.array(path), warnings, complete, bool(signals)
    )
