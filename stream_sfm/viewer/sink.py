"""A sink that logs estimates and images to Rerun, frame by frame.

Compressed images are passed on as recorded, neither decoded nor encoded again; others become JPEG.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ..camera.lens import project_into_image
from ..camera.rig import MonoRig, StereoRig
from ..evaluation.settings import SETTINGS
from ..geometry import Array, se3
from ..logs.sources.image_header import image_format
from ..types import Frame, FrameEstimate, InertialEstimate, Picture, Status, Trajectory
from . import layout
from .recording import Recording

if TYPE_CHECKING:
    from ..places.place_map import PlaceMap

_LEVELS = {Status.OK: "INFO", Status.INITIALISING: "INFO", Status.DEGRADED: "WARN", Status.LOST: "ERROR"}
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 85]  # for uncompressed images: a fifth to a tenth of their bytes


class RerunSink:
    """A `Sink` that shows each frame in Rerun; `open_viewer` describes the arguments and errors.

    Time and memory per frame do not grow with the length of the run; the viewer keeps data up to its own limit.
    """

    def __init__(
        self,
        rig: StereoRig | MonoRig,
        rrd: str | Path | None,
        view: bool,
        ground_truth: Trajectory | None,
        name: str,
    ) -> None:
        self._cameras = tuple(rig.cameras.values())
        self._sides = layout.SIDES[: len(self._cameras)]
        self._cams_from_left, self._image_distance, self._unit = [np.eye(4)], 1.0, "first baselines"
        if isinstance(rig, StereoRig):
            self._cams_from_left, self._unit = [np.eye(4), rig.right_from_left], "metres"
            self._image_distance = 3 * rig.baseline_m  # in front of its camera
        self._truth = ground_truth if ground_truth is not None and len(ground_truth) else None
        self._world_from_truth: Array | None = None
        self._previous: Array | None = None
        self._status = ""
        self._has_inertia = False
        self._places: PlaceMap | None = None
        self._stages: tuple[str, ...] = ()
        self._recording = Recording(rrd, view, layout.blueprint(self._sides, self._unit), name)
        self._stream = self._recording.stream
        self._describe()

    def _describe(self) -> None:
        """Log everything static: axes, cameras, legends and styles."""
        log = self._stream.log
        log("world", rr.ViewCoordinates.RDF, static=True)
        for side, camera, from_left in zip(self._sides, self._cameras, self._cams_from_left, strict=True):
            pinhole = rr.Pinhole(
                image_from_camera=camera.K,
                resolution=(camera.width, camera.height),
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=self._image_distance,
            )
            log(side, pinhole, static=True)
            log(side, _transform(se3.inverse(from_left)), static=True)
            if camera.mask is not None:
                log(f"{side}/mask", layout.MASKED, static=True)
                hidden = rr.SegmentationImage((~camera.mask).astype(np.uint8), opacity=0.6, draw_order=1)
                log(f"{side}/mask", hidden, static=True)
        drift, colours = ["estimated σ", "error"], [layout.ELLIPSOID_COLOUR, layout.ESTIMATE_COLOUR]
        n = 1 if self._truth is None else 2
        log(layout.DRIFT, rr.SeriesLines(names=drift[:n], colors=colours[:n]), static=True)
        log(layout.TRACKS, rr.SeriesLines(names=layout.TRACK_SERIES, colors=layout.SERIES_COLOURS), static=True)
        for path, style in layout.styles().items():
            log(path, style, static=True)

    def write(self, estimate: FrameEstimate, frame: Frame | None = None) -> None:
        """Show an estimate, and the images of its frame if given (as recorded, if available)."""
        if not self._recording.watched:
            return
        stream = self._stream
        stream.set_time("frame", sequence=estimate.frame_index)
        stream.set_time("time", timestamp=np.datetime64(estimate.stamp_ns, "ns"))
        pictures: tuple[Picture, ...] = () if frame is None else frame.pictures or frame.images
        for side, picture in zip(self._sides, pictures, strict=False):
            stream.log(f"{side}/image", _picture(picture))
        stream.log(layout.CAMERA, _transform(estimate.world_from_cam))
        position = estimate.world_from_cam[:3, 3]
        if self._previous is not None:
            segment = np.stack([self._previous, position])[None].astype(np.float32)
            stream.log(layout.TRAJECTORY, rr.LineStrips3D.from_fields(strips=segment))
        self._previous = position
        colours = layout.colours_of(estimate.points_in_cam, estimate.cov_points)
        stream.log(layout.POINTS, rr.Points3D.from_fields(positions=estimate.points_in_cam, colors=colours))
        self._ellipsoid(estimate.cov_pose[:3, :3])
        self._inertia(estimate.inertial)
        self._tracks(estimate, colours)
        self._series(estimate)
        self._log_status(estimate)

    def show_map(self, places: "PlaceMap") -> None:
        """Show the keyframes of a map at the end, before and after its loops, and the loops as lines."""
        self._places = places

    def close(self) -> None:
        """Write all buffered data. Raises OutputError if the file is incomplete."""
        if self._places is not None and self._recording.watched:
            *ways, joined = self._places.lines()
            for path, way in zip((layout.LOOPS_BEFORE, layout.LOOPS_AFTER), ways, strict=True):
                for name, strips in (("way", way[None]), ("loops", way[joined])):
                    shown = rr.LineStrips3D.from_fields(strips=strips.astype(np.float32))
                    self._stream.log(f"{path}/{name}", shown)
        self._recording.close()

    def _ellipsoid(self, cov_position: Array) -> None:
        """Log the 3σ ellipsoid of the position, in the axes of the camera."""
        values, axes = np.linalg.eigh(cov_position)
        axes[:, 0] *= np.sign(np.linalg.det(axes)) or 1.0
        half_sizes = 3 * np.sqrt(np.maximum(values, 0))[None]
        quaternion = se3.quat_xyzw_from_matrix(axes)[None]
        shape = rr.Ellipsoids3D.from_fields(half_sizes=half_sizes, quaternions=quaternion)
        self._stream.log(layout.ELLIPSOID, shape)

    def _inertia(self, inertial: InertialEstimate | None) -> None:
        """Log gravity, and the distance travelled in half a second, as arrows at the camera."""
        if inertial is None and not self._has_inertia:
            return
        self._has_inertia = inertial is not None
        arrows: dict[str, Array] = dict.fromkeys((layout.GRAVITY, layout.VELOCITY), np.empty((0, 3)))
        if inertial is not None:
            down = inertial.gravity / np.linalg.norm(inertial.gravity)
            arrows[layout.GRAVITY] = self._image_distance * down[None]
            arrows[layout.VELOCITY] = inertial.velocity[None] / 2
        for path, vectors in arrows.items():
            shown = rr.Arrows3D.from_fields(vectors=vectors.astype(np.float32), origins=np.zeros_like(vectors))
            self._stream.log(path, shown)

    def _tracks(self, estimate: FrameEstimate, colours: NDArray[np.uint32]) -> None:
        """Log the points in the images."""
        points = [se3.transform(from_left, estimate.points_in_cam) for from_left in self._cams_from_left]
        front = np.all([p[:, 2] > 0 for p in points], axis=0)
        for side, camera, in_cam in zip(self._sides, self._cameras, points, strict=True):
            now = project_into_image(camera, in_cam[front]) + 0.5
            shown = rr.Points2D.from_fields(positions=now.astype(np.float32), colors=colours[front])
            self._stream.log(f"{side}/tracks", shown)

    def _series(self, estimate: FrameEstimate) -> None:
        log = self._stream.log
        values = [float(np.sqrt(max(np.trace(estimate.cov_pose[:3, :3]), 0.0)))]
        if self._truth is not None:
            values.append(self._error_m(estimate, self._truth))
        log(layout.DRIFT, rr.Scalars(values))
        log(layout.TRACKS, rr.Scalars([float(estimate.counts.get(name, 0)) for name in layout.TRACK_SERIES]))
        stages = tuple(estimate.timings_ms)
        if stages != self._stages:
            self._stages = stages
            colours = layout.SERIES_COLOURS[: len(stages)]
            log(layout.TIMING, rr.SeriesLines(names=stages, colors=colours), static=True)
        log(layout.TIMING, rr.Scalars(list(estimate.timings_ms.values())))

    def _error_m(self, estimate: FrameEstimate, truth: Trajectory) -> float:
        """Return the distance to the ground truth at this stamp, NaN without one; the first is aligned and drawn."""
        off_ns = np.abs(truth.stamps_ns - estimate.stamp_ns)
        nearest = int(off_ns.argmin())
        if off_ns[nearest] > SETTINGS.max_gap_ns / 2:
            return float("nan")
        pose = truth.world_from_cam[nearest]
        if self._world_from_truth is None:
            self._world_from_truth = estimate.world_from_cam @ se3.inverse(pose)
            path = se3.transform(self._world_from_truth, truth.world_from_cam[:, :3, 3])
            strip = rr.LineStrips3D(
                path[None].astype(np.float32), colors=layout.TRUTH_COLOUR, radii=rr.Radius.ui_points(1.0)
            )
            self._stream.log(layout.TRUTH, strip, static=True)
        placed = self._world_from_truth @ pose
        return float(np.linalg.norm(placed[:3, 3] - estimate.world_from_cam[:3, 3]))

    def _log_status(self, estimate: FrameEstimate) -> None:
        """Log a new status, but not a new reason, whose numbers change with every frame."""
        if estimate.status != self._status:
            self._status = estimate.status
            text = ": ".join(filter(None, (f"frame {estimate.frame_index}", estimate.status, estimate.reason)))
            self._stream.log(layout.STATUS, rr.TextLog(text, level=_LEVELS[estimate.status]))


def _picture(picture: Picture) -> rr.EncodedImage | rr.Image:
    """Return an image to show: as compressed before, or else as JPEG, a tenth of its size."""
    if isinstance(picture, bytes):
        kind = image_format(picture)
        return rr.EncodedImage(contents=picture, media_type=kind and f"image/{kind}")
    shown = picture[..., :3] if picture.ndim == 3 else picture
    if picture.dtype == np.uint8:
        return rr.EncodedImage(contents=cv2.imencode(".jpg", shown, _JPEG)[1].tobytes(), media_type="image/jpeg")
    if shown.shape[2:] == (3,):
        return rr.Image(shown, color_model="BGR")
    return rr.Image(shown.reshape(shown.shape[:2]), color_model="L")


def _transform(parent_from_child: Array) -> rr.Transform3D:
    return rr.Transform3D(translation=parent_from_child[:3, 3], mat3x3=parent_from_child[:3, :3])
