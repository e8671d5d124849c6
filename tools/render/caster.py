"""From a scene, a camera and its motion to an image, and to depth.

Rays leave each raw pixel through the exact inverse of the lens distortion. Nine rays a pixel (or four, for images that
must be quick), on a rotated grid whose centroid is the pixel's centre, look up trilinearly filtered textures; the
picture is their mean (box filter), so edges and textures are free of aliasing and nothing is shifted. Depth belongs to
the pixel's centre alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stream_sfm.camera.models import Camera
from stream_sfm.geometry import se3

from .scene import FACE_AXES, LEVELS, Box, Scene

Array = NDArray[np.floating[Any]]


@dataclass(frozen=True, slots=True)
class Sampling:
    """Rooks on a grid within each pixel, symmetric about its centre: as many columns and rows as rays.

    `rows`: of the ray in each column. `groups`: rays with their centroid at the pixel's centre, too; the instants of an
    open shutter take them in turn. `band_rows`: rendered at once, so that their rays fit into the processor's cache.
    """

    rows: tuple[int, ...]
    groups: tuple[tuple[int, ...], ...]
    band_rows: int

    @property
    def offsets_px(self) -> NDArray[np.float64]:
        """(n, 2): where in a pixel its rays are, from its centre."""
        n = len(self.rows)
        return np.stack([np.arange(n), self.rows], axis=1) / n - (n - 1) / (2 * n)


NINE_RAYS = Sampling((0, 3, 6, 1, 4, 7, 2, 5, 8), ((0, 4, 8), (1, 7), (2, 6), (3, 5)), band_rows=8)
FOUR_RAYS = Sampling((1, 3, 0, 2), ((0, 3), (1, 2)), band_rows=16)

BLUR_MOMENTS = 8  # instants of an open shutter: their images lie a pixel apart at 8 px of blur
MIRROR_SHARE = 0.85  # of the light that a mirror throws back: a clean one at home


@dataclass(frozen=True, slots=True)
class Sensor:
    """Grey levels out of light: gain a camera, then noise of variance read² + shot·grey, then rounding."""

    read_noise: float = 1.4
    shot_noise: float = 0.02
    gain_left: float = 1.0
    gain_right: float = 1.0


CLEAN = Sensor(read_noise=0.0, shot_noise=0.0)


def pixel_rays(camera: Camera, pixels: Array) -> NDArray[np.float64]:
    """Rays (…, 3) with z = 1 through raw pixels (…, 2); plumb_bob is inverted by iteration, to 1e-12."""
    if camera.distortion_model not in ("plumb_bob", "none"):
        raise NotImplementedError(f"the renderer knows plumb_bob lenses, not {camera.distortion_model}")
    k1, k2, p1, p2, k3 = (*camera.D, *([0.0] * 5))[:5]
    k = np.asarray(camera.K)
    yd = (np.asarray(pixels[..., 1], dtype=float) - k[1, 2]) / k[1, 1]
    xd = (np.asarray(pixels[..., 0], dtype=float) - k[0, 2] - k[0, 1] * yd) / k[0, 0]
    x, y = xd, yd
    for _ in range(60):
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x_next = (xd - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial
        y_next = (yd - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial
        change = max(np.abs(x_next - x).max(), np.abs(y_next - y).max())
        x, y = x_next, y_next
        if change < 1e-13:
            break
    return np.stack([x, y, np.ones_like(x)], axis=-1)


@lru_cache(maxsize=4)
def _sampling_rays(key: tuple[int, int, bytes, tuple[float, ...], str], sampling: Sampling) -> NDArray[np.float32]:
    """Rays (h, 3, n, w) of all sub-pixels of a camera: exact at pixel centres, linear within a pixel (1e-4 px)."""
    width, height, k, d, model = key
    camera = Camera(width, height, np.frombuffer(k).reshape(3, 3), d, model)
    rays = _central_rays(camera)
    by_row, by_column = np.gradient(rays, axis=(0, 3), edge_order=2)
    du, dv = sampling.offsets_px.T[..., None]
    return (rays + du * by_column + dv * by_row).astype(np.float32)


def _central_rays(camera: Camera) -> NDArray[np.float64]:
    """Rays (h, 3, 1, w) of the pixel centres."""
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).astype(float)
    return np.moveaxis(pixel_rays(camera, pixels), -1, 1)[:, :, None]


@dataclass(slots=True)
class _Hits:
    """What the rays (s, h, w) met: depth along the ray, and the face, 6 · box + its number; −1 where nothing."""

    depth: Array
    face: NDArray[np.int32]


@lru_cache(maxsize=8)
def _placed(boxes: tuple[Box, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """box_from_room (n, 4, 4) and the corners in the room (n, 8, 3) of boxes."""
    box_from_room = np.array([box.box_from_room for box in boxes])
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    corners = signs * np.array([box.size_m for box in boxes])[:, None] / 2
    return box_from_room, se3.transform(se3.inverse(box_from_room), corners)


def _columns(boxes: tuple[Box, ...], camera: Camera, room_from_cam: Array, rows: slice) -> list[slice]:
    """For each box the columns that can see it in these rows; all of them when part of it is beside the camera."""
    cam_from_room = se3.inverse(room_from_cam)
    corners = se3.transform(cam_from_room, _placed(boxes)[1])
    z = corners[..., 2]
    wide = np.array([box.inside for box in boxes]) | (z.min(axis=1) < 0.2)
    x, y = corners[..., 0] / np.maximum(z, 0.2), corners[..., 1] / np.maximum(z, 0.2)
    # Straight edges bow under distortion: where the mild lens moves the corners by δ, keep 3δ and 4 px around.
    k = np.asarray(camera.K)
    u, v = k[0, 0] * x + k[0, 2], k[1, 1] * y + k[1, 2]
    reach = np.clip(x * x + y * y, 0.0, 1.0).max(axis=1) ** 1.5
    margin = 4 + 3 * k[0, 0] * np.abs(np.asarray(camera.D[:2] or (0.0,))).sum() * reach
    seen = (v.min(axis=1) - margin < rows.stop) & (v.max(axis=1) + margin > rows.start - 1)
    low = np.where(wide, 0, np.clip(np.floor(u.min(axis=1) - margin), 0, camera.width)).astype(int)
    high = np.where(wide, camera.width, np.clip(np.ceil(u.max(axis=1) + margin), 0, camera.width)).astype(int)
    high = np.where((seen | wide) & (z.max(axis=1) > 0), high, low)
    return [slice(*ends) for ends in np.stack([low, high], axis=1).tolist()]


@dataclass(slots=True)
class _Beams:
    """Rays in the room: `origins` (3, h), one for each row, and `directions` (3, s, h, w), of depth 1 in the camera."""

    origins: NDArray[np.float64]
    directions: Array

    def moved(self, pose: Array) -> "_Beams":
        """The rays in other axes, or mirrored."""
        rotation = pose[:3, :3].astype(self.directions.dtype)
        origins = pose[:3, :3] @ self.origins + pose[:3, 3:]
        return _Beams(origins, np.tensordot(rotation, self.directions, axes=1))


def _beams(room_from_cam: Array, rays: Array) -> _Beams:
    """The rays (h, 3, s, w) of rows whose poses are (h, 4, 4)."""
    rotations = room_from_cam[:, :3, :3].astype(rays.dtype)
    directions = (rotations @ rays.reshape(len(rays), 3, -1)).reshape(rays.shape)
    return _Beams(room_from_cam[:, :3, 3].T, np.ascontiguousarray(np.moveaxis(directions, 0, 2)))


def _cast(
    scene: Scene, beams: _Beams, columns: Sequence[slice], beyond: Array | None = None, without: int | None = None
) -> _Hits:
    """Nearest hits of rays; slab test against each box in its columns, in single or double precision as they are.

    For reflections: hits must lie `beyond` (s, h, w) these depths, and the box `without` is not there.
    """
    shape, kind = beams.directions.shape[1:], beams.directions.dtype
    hits = _Hits(np.full(shape, np.inf, kind), np.full(shape, -1, np.int32))
    for b, (box_from_room, seen) in enumerate(zip(_placed(scene.boxes)[0], columns, strict=True)):
        if b == without or seen.start >= seen.stop:
            continue
        in_box = _Beams(beams.origins, beams.directions[..., seen]).moved(box_from_room)
        t, face, met = _slab_test(scene.boxes[b], in_box)
        met &= t < hits.depth[..., seen]
        if beyond is not None:
            met &= t > beyond[..., seen]
        np.copyto(hits.depth[..., seen], t, where=met)
        np.copyto(hits.face[..., seen], 6 * b + face, where=met)
    return hits


def _slab_test(box: Box, in_box: _Beams) -> tuple[Array, Array, Array]:
    """Depth and face (s, h, w) that each ray meets, and whether it meets the box."""
    directions = in_box.directions
    origin = in_box.origins.astype(directions.dtype)[:, None, :, None]
    half = (np.array(box.size_m) / 2).astype(directions.dtype)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / directions
        centre = inverse * -origin
        reach = np.abs(inverse) * half[:, None, None, None]
        enter, leave = centre - reach, centre + reach
    ends = leave if box.inside else enter
    t = ends.min(axis=0) if box.inside else ends.max(axis=0)
    # A ray running towards +axis enters through the − face and leaves through the + face.
    side = (directions > 0) == box.inside
    face = np.zeros(t.shape, np.int16)
    for axis in range(3):
        np.copyto(face, 2 * axis + side[axis], where=t == ends[axis], casting="same_kind")
    return t, face, (t > 0) if box.inside else (t > 0) & (t < leave.min(axis=0))


def _bilinear(scene: Scene, face: int, level: Array, u: Array, v: Array) -> Array:
    """Texels of a face, each from its own level of the pyramid, interpolated; edges are repeated."""
    columns, rows = scene.size_px[face].astype(np.int32).T
    n, m = columns[level], rows[level]
    x = np.clip(u * n - np.float32(0.5), 0, n - 1).astype(np.float32)
    y = np.clip(v * m - np.float32(0.5), 0, m - 1).astype(np.float32)
    x0 = np.minimum(x.astype(np.int32), np.maximum(n - 2, 0))
    y0 = np.minimum(y.astype(np.int32), np.maximum(m - 2, 0))
    x -= x0
    y -= y0
    corner = scene.offset[face].astype(np.int32)[level] + y0 * n + x0
    right, below = np.minimum(n - 1, 1), np.where(m > 1, n, 0)
    texels = scene.texels
    upper = texels[corner] * (1 - x) + texels[corner + right] * x
    lower = texels[corner + below] * (1 - x) + texels[corner + below + right] * x
    return upper * (1 - y) + lower * y


def _shaded(scene: Scene, rays_per_rad: float, beams: _Beams, hits: _Hits) -> NDArray[np.float32]:
    """Grey levels (s, h, w) of what the rays met, black where nothing."""
    grey = np.zeros(hits.face.size, np.float32)
    faces, directions = hits.face.ravel(), beams.directions.reshape(3, -1)
    _, height, width = hits.face.shape
    for face in np.flatnonzero(np.bincount(faces + 1)[1:]).tolist():
        where = np.flatnonzero(faces == face)
        box, box_from_room, number = scene.boxes[face // 6], _placed(scene.boxes)[0][face // 6], face % 6
        in_box = _Beams(beams.origins, directions[:, where]).moved(box_from_room)
        along, depth = in_box.directions, hits.depth.ravel()[where]
        origins = in_box.origins.astype(np.float32)[:, where // width % height]
        u, v = (
            np.float32(0.5) + np.float32(sign / box.size_m[axis]) * (origins[axis] + depth * along[axis])
            for axis, sign in FACE_AXES[number ^ 1 if box.inside else number]
        )
        cosine = np.abs(along[number // 2]) / np.sqrt((along * along).sum(axis=0))
        spacing_m = depth / np.float32(rays_per_rad) / np.maximum(cosine, np.float32(0.12))
        lod = np.clip(np.log2(spacing_m / np.float32(scene.texel_m)), 0, np.float32(LEVELS - 1.001))
        level = lod.astype(np.int32)
        fine, coarse = (_bilinear(scene, face, number, u, v) for number in (level, level + 1))
        grey[where] = fine + (lod - level) * (coarse - fine)
    return grey.reshape(hits.face.shape)


def _light(
    scene: Scene, camera: Camera, room_from_cam: Array, rays: Array, rows: slice, rays_per_rad: float
) -> NDArray[np.float32]:
    """Rows (h, w) of the image before the sensor, in grey levels, from their poses (h, 4, 4) and rays (h, 3, s, w)."""
    beams = _beams(room_from_cam, rays)
    hits = _cast(scene, beams, _columns(scene.boxes, camera, room_from_cam[0], rows))
    grey = _shaded(scene, rays_per_rad, beams, hits)
    for box, face in scene.mirrors:
        glass = hits.face == 6 * box + face
        if glass.any():
            # all reflected rays of a row seem to come from one point behind the glass: the mirrored camera
            reflection = scene.reflection(box, face)
            mirrored = beams.moved(reflection)
            columns = _columns(scene.boxes, camera, reflection @ room_from_cam[0], rows)
            behind = _cast(scene, mirrored, columns, beyond=hits.depth, without=box)
            grey = np.where(glass, MIRROR_SHARE * _shaded(scene, rays_per_rad, mirrored, behind), grey)
    return grey.mean(axis=0)


def image_of(
    camera: Camera,
    moment: Callable[[float], tuple[Scene, Array]],
    stamp_s: float,
    shutter_s: float = 0.0,
    readout_s: float = 0.0,
    sampling: Sampling = NINE_RAYS,
) -> NDArray[np.float32]:
    """The raw image (h, w) before the sensor, in grey levels; `moment(t)` is the scene and its room_from_cam.

    The shutter is open for `shutter_s` around the time of a row. That time is the stamp where `readout_s` is 0; a
    rolling shutter exposes row r at stamp_s + readout_s · (r − (h − 1)/2) / h, the middle row at the stamp. The camera
    moves on from row to row, bodies from band to band.
    """
    key = (camera.width, camera.height, np.asarray(camera.K, float).tobytes(), camera.D, camera.distortion_model)
    all_rays = _sampling_rays(key, sampling)
    rays_per_rad = float(np.sqrt(len(sampling.rows)) * camera.K[0, 0])
    row_s = stamp_s + readout_s * (np.arange(camera.height) - (camera.height - 1) / 2) / camera.height
    groups = [tuple(range(len(sampling.rows)))]
    if shutter_s:
        groups = [sampling.groups[k % len(sampling.groups)] for k in range(BLUR_MOMENTS)]
    image = np.zeros((camera.height, camera.width), np.float32)
    for top in range(0, camera.height, sampling.band_rows):
        rows = slice(top, min(top + sampling.band_rows, camera.height))
        for k, group in enumerate(groups):
            times = row_s[rows] + shutter_s * ((k + 0.5) / len(groups) - 0.5)
            scene, room_from_cam = moment(times[len(times) // 2])
            poses = np.array([moment(t)[1] for t in times]) if readout_s else np.array(len(times) * [room_from_cam])
            rays = all_rays[rows][:, :, group]
            image[rows] += _light(scene, camera, poses, rays, rows, rays_per_rad) / np.float32(len(groups))
    return image


def exposed(light: Array, gain: float, sensor: Sensor, seed: tuple[int, ...]) -> NDArray[np.uint8]:
    """The picture that the sensor makes of light; `seed` fixes its noise: give each image its own."""
    grey = light * gain
    sigma = np.sqrt(sensor.read_noise**2 + sensor.shot_noise * grey)
    noise = np.random.default_rng(seed).standard_normal(grey.shape)
    return np.clip(np.rint(grey + sigma * noise), 0, 255).astype(np.uint8)


def depth_of(scene: Scene, camera: Camera, room_from_cam: Array) -> NDArray[np.float64]:
    """z-depth (h, w), metres, at the pixel centres of a raw image."""
    beams = _beams(np.broadcast_to(room_from_cam, (camera.height, 4, 4)), _central_rays(camera))
    columns = _columns(scene.boxes, camera, room_from_cam, slice(0, camera.height))
    return np.asarray(_cast(scene, beams, columns).depth[0], dtype=float)
