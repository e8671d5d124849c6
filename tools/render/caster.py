"""From a scene, a rig and a pose to a pair of images with depth.

Rays leave each raw pixel through the exact inverse of the lens distortion. Nine rays a pixel, on a rotated grid
whose centroid is the pixel's centre, look up trilinearly filtered textures; the picture is their mean (box filter),
so edges and textures are free of aliasing and nothing is shifted. Depth belongs to the pixel's centre alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

from .scene import FACE_AXES, LEVELS, Box, Scene

Array = NDArray[np.floating[Any]]

# Nine rooks: nine different columns and rows of a 9×9 grid, symmetric about the pixel's centre.
# Each group of rays below has its centroid there too: the instants of an open shutter take them in turn.
RAY_GROUPS = ((0, 4, 8), (1, 7), (2, 6), (3, 5))
SUBPIXELS = np.stack([np.arange(9), [0, 3, 6, 1, 4, 7, 2, 5, 8]], axis=1) / 9 - 4 / 9

MIRROR_SHARE = 0.85  # of the light that a mirror throws back: a clean one at home


@dataclass(frozen=True, slots=True)
class Sensor:
    """Grey levels out of light: gain a camera, then noise of variance read² + shot·grey, then rounding."""

    read_noise: float = 1.4
    shot_noise: float = 0.02
    gain_left: float = 1.0
    gain_right: float = 1.0


CLEAN = Sensor(read_noise=0.0, shot_noise=0.0)


@dataclass(frozen=True, slots=True)
class Shot:
    """Raw images (h, w) uint8, and z-depth (h, w) float64, metres, at the pixel centres of the raw left image."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    depth_m: NDArray[np.float64]


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
def _sampling_rays(key: tuple[int, int, bytes, tuple[float, ...], str]) -> NDArray[np.float32]:
    """Rays (3, 9, h, w) of all sub-pixels of a camera."""
    width, height, k, d, model = key
    camera = Camera(width, height, np.frombuffer(k).reshape(3, 3), d, model)
    u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    rays = [pixel_rays(camera, np.stack([u + du, v + dv], axis=-1)) for du, dv in SUBPIXELS]
    return np.ascontiguousarray(np.moveaxis(np.stack(rays), -1, 0), dtype=np.float32)


@dataclass(slots=True)
class _Hits:
    """What the rays (…,) met: depth along the ray, face, texture coordinates in [0, 1], cosine of incidence."""

    depth: Array
    face: NDArray[np.int32]
    u: Array
    v: Array
    cosine: Array


def _region(scene: Scene, box_index: int, cam_from_room: Array, camera: Camera) -> tuple[slice, slice]:
    """Rows and columns that can see a box; the whole image when part of it is beside or behind the camera."""
    box = scene.boxes[box_index]
    everything = slice(0, camera.height), slice(0, camera.width)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    corners = se3.transform(se3.inverse(box.box_from_room), signs * np.array(box.size_m) / 2)
    corners = se3.transform(cam_from_room, corners)
    if box.inside or corners[:, 2].min() < 0.2:
        return (slice(0, 0), slice(0, 0)) if corners[:, 2].max() < 0 else everything
    x, y = corners[:, 0] / corners[:, 2], corners[:, 1] / corners[:, 2]
    # Straight edges bow under distortion: where the mild lens moves the corners by δ, keep 3δ and 4 px around.
    k = np.asarray(camera.K)
    u, v = k[0, 0] * x + k[0, 2], k[1, 1] * y + k[1, 2]
    reach = np.minimum(np.maximum(x * x + y * y, 0.0), 1.0)
    margin = 4 + 3 * k[0, 0] * np.abs(np.asarray(camera.D[:2] or (0.0,))).sum() * reach.max() * np.sqrt(reach.max())
    low = np.clip(np.floor([v.min() - margin, u.min() - margin]), 0, None).astype(int)
    high = np.ceil([v.max() + margin, u.max() + margin]).astype(int)
    high = np.clip(high, low, np.maximum(low, (camera.height, camera.width)))
    return slice(low[0], high[0]), slice(low[1], high[1])


def _cast(
    scene: Scene,
    camera: Camera,
    room_from_cam: Array,
    rays: Array,
    beyond: Array | None = None,
    without: int | None = None,
) -> _Hits:
    """Nearest hits of rays (3, s, h, w) given in the camera; slab test against each box, in the type of `rays`.

    For reflections: hits must lie `beyond` (s, h, w) these depths, and the box `without` is not there.
    """
    kind = rays.dtype.type
    shape = rays.shape[1:]
    hits = _Hits(
        np.full(shape, np.inf, kind),
        np.zeros(shape, np.int32),
        *(np.zeros(shape, kind) for _ in range(3)),
    )
    cam_from_room = se3.inverse(room_from_cam)
    for b, box in enumerate(scene.boxes):
        rows, columns = _region(scene, b, cam_from_room, camera)
        block = rays[:, :, rows, columns]
        if b == without or block.size == 0:
            continue
        box_from_cam = box.box_from_room @ room_from_cam
        directions = np.tensordot(box_from_cam[:3, :3].astype(kind), block, axes=1)
        origin = box_from_cam[:3, 3].astype(kind)
        t, axis, met = _slab_test(box, origin, directions)
        if not box.inside:
            met &= t < hits.depth[:, rows, columns]
        if beyond is not None:
            met &= t > beyond[:, rows, columns]
        where = np.nonzero(met)
        if len(where[0]):
            place = (where[0], where[1] + rows.start, where[2] + columns.start)
            _record(hits, place, b, box, origin, directions[(slice(None), *where)], t[where], axis[where])
    return hits


def _slab_test(box: Box, origin: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Depth and axis of the face that each ray (3, s, h, w) meets, and whether it meets the box, in the box's axes."""
    half = (np.array(box.size_m) / 2).astype(origin.dtype)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / directions
        centre = inverse * -origin[:, None, None, None]
        reach = np.abs(inverse) * half[:, None, None, None]
        enter, leave = centre - reach, centre + reach
    if box.inside:
        t = leave.min(axis=0)
        return t, leave.argmin(axis=0), t > 0
    t = enter.max(axis=0)
    return t, enter.argmax(axis=0), (t > 0) & (t < leave.min(axis=0))


def _record(
    hits: _Hits,
    place: tuple[Array, Array, Array],
    index: int,
    box: Box,
    origin: Array,
    directions: Array,
    t: Array,
    axis: Array,
) -> None:
    """Write the hits at `place` on the box with this index: depth, face, texture coordinates, cosine."""
    kind = origin.dtype.type
    along = np.take_along_axis(directions, axis[None], axis=0)[0]
    # A ray running towards +axis enters through the − face and leaves through the + face.
    face = 2 * axis + ((along > 0) == box.inside)
    seen_as = face ^ 1 if box.inside else face
    point = origin[:, None] + t * directions
    fraction = point / np.array(box.size_m).astype(kind)[:, None] + kind(0.5)
    table = np.array(FACE_AXES)  # (face, column or row, (axis, sign))
    for row_or_column, out in ((0, hits.u), (1, hits.v)):
        picked, sign = table[seen_as, row_or_column].T
        value = np.take_along_axis(fraction, picked[None], axis=0)[0]
        out[place] = np.where(sign > 0, value, 1 - value)
    hits.depth[place] = t
    hits.face[place] = 6 * index + face
    hits.cosine[place] = np.abs(along) / np.sqrt((directions * directions).sum(axis=0))


def _bilinear(scene: Scene, face: Array, level: Array, u: Array, v: Array) -> Array:
    """Texels of one level of the pyramid, interpolated; level edges are repeated."""
    flat = face * LEVELS + level
    columns, rows = scene.size_px.reshape(-1, 2).astype(np.int32).T
    n, m = columns[flat], rows[flat]
    x = np.clip(u * n - 0.5, 0, n - 1).astype(np.float32)
    y = np.clip(v * m - 0.5, 0, m - 1).astype(np.float32)
    x0, y0 = (
        np.minimum(x.astype(np.int32), np.maximum(n - 2, 0)),
        np.minimum(y.astype(np.int32), np.maximum(m - 2, 0)),
    )
    x -= x0
    y -= y0
    corner = scene.offset.ravel().astype(np.int32)[flat] + y0 * n + x0
    right, below = np.minimum(n - 1, 1), np.where(m > 1, n, 0)
    texels = scene.texels
    upper = texels[corner] * (1 - x) + texels[corner + right] * x
    lower = texels[corner + below] * (1 - x) + texels[corner + below + right] * x
    return upper * (1 - y) + lower * y


def _shaded(scene: Scene, camera: Camera, hits: _Hits) -> NDArray[np.float32]:
    """Grey levels (s, h, w) of what the rays met."""
    spacing_m = hits.depth / np.float32(3 * camera.K[0, 0]) / np.maximum(hits.cosine, np.float32(0.12))
    lod = np.clip(np.log2(spacing_m / np.float32(scene.texel_m)), 0, LEVELS - 1.001)
    level = lod.astype(np.int32)
    fine = _bilinear(scene, hits.face, level, hits.u, hits.v)
    coarse = _bilinear(scene, hits.face, level + 1, hits.u, hits.v)
    lod -= level
    return fine + lod * (coarse - fine)


def _light(
    scene: Scene, camera: Camera, room_from_cam: Array, group: tuple[int, ...] | None = None
) -> NDArray[np.float32]:
    """The image (h, w) before the sensor, in grey levels, from all rays or from a group of them."""
    key = (camera.width, camera.height, np.asarray(camera.K, float).tobytes(), camera.D, camera.distortion_model)
    rays = _sampling_rays(key)
    if group is not None:
        rays = rays[:, list(group)]
    hits = _cast(scene, camera, room_from_cam, rays)
    grey = _shaded(scene, camera, hits)
    for box, face in scene.mirrors:
        glass = hits.face == 6 * box + face
        if glass.any():
            # all reflected rays seem to come from one point behind the glass: the mirrored camera
            mirrored = scene.reflection(box, face) @ room_from_cam
            behind = _cast(scene, camera, mirrored, rays, beyond=hits.depth, without=box)
            grey = np.where(glass, MIRROR_SHARE * _shaded(scene, camera, behind), grey)
    return grey.mean(axis=0)


def _expose(light: Array, gain: float, sensor: Sensor, rng: np.random.Generator) -> NDArray[np.uint8]:
    grey = light * gain
    sigma = np.sqrt(sensor.read_noise**2 + sensor.shot_noise * grey)
    return np.clip(np.rint(grey + sigma * rng.standard_normal(grey.shape)), 0, 255).astype(np.uint8)


def depth_of(scene: Scene, camera: Camera, room_from_cam: Array) -> NDArray[np.float64]:
    """z-depth (h, w), metres, at the pixel centres of a raw image."""
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    rays = np.moveaxis(pixel_rays(camera, np.stack([u, v], axis=-1)), -1, 0)[:, None]
    return np.asarray(_cast(scene, camera, room_from_cam, rays).depth[0], dtype=float)


def render_stereo(
    scene: Scene,
    rig: StereoRig,
    world_from_cam: Array,
    sensor: Sensor = CLEAN,
    seed: int | tuple[int, ...] = 0,
) -> Shot:
    """Both raw images and the left depth for the left camera at `world_from_cam` (4, 4).

    `seed` fixes the sensor noise: give each frame its own.
    """
    return render_exposure([(scene, world_from_cam)], (scene, world_from_cam), rig, sensor, seed)


def render_exposure(
    moments: Sequence[tuple[Scene, Array]],
    middle: tuple[Scene, Array],
    rig: StereoRig,
    sensor: Sensor = CLEAN,
    seed: int | tuple[int, ...] = 0,
) -> Shot:
    """Both raw images of a shutter that is open for some time, and the left depth in the middle of it.

    `moments`: the scene and the pose `world_from_cam` (4, 4) at evenly spaced times while it is open, a multiple of
    four or just one; the image is the mean of their light, clipped after the mean, as on a sensor.
    """
    rng = np.random.default_rng(seed)
    groups: list[tuple[int, ...] | None] = [None]
    if len(moments) > 1:
        groups = [RAY_GROUPS[k % len(RAY_GROUPS)] for k in range(len(moments))]
    images = []
    for camera, gain in ((rig.left, sensor.gain_left), (rig.right, sensor.gain_right)):
        left_from_camera = np.eye(4) if camera is rig.left else se3.inverse(rig.right_from_left)
        light = [
            _light(scene, camera, scene.room_from_world @ pose @ left_from_camera, group)
            for (scene, pose), group in zip(moments, groups, strict=True)
        ]
        images.append(_expose(light[0] if len(light) == 1 else np.mean(light, axis=0), gain, sensor, rng))
    scene, world_from_cam = middle
    return Shot(images[0], images[1], depth_of(scene, rig.left, scene.room_from_world @ world_from_cam))
