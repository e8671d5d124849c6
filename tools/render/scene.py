"""Scenes of textured boxes: a room seen from inside and the oriented boxes that stand in it.

The scene's own frame, `room`, has z up. Every face carries a texture with its whole mip pyramid; all pyramids
lie in one flat array, so that the rays of an image look up their texels in one go.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from .textures import Image, Painter

# The six faces in order −x, +x, −y, +y, −z, +z: directions of the texture's columns and rows, in the axes of the
# box, for a viewer outside who sees the texture upright.
FACE_AXES = (((1, -1), (2, -1)), ((1, 1), (2, -1)), ((0, 1), (2, -1)), ((0, -1), (2, -1)), ((0, 1), (1, 1)),
             ((0, 1), (1, -1)))  # fmt: skip
FACE_LIGHT = (0.86, 0.94, 1.0, 0.80, 0.70, 1.06)  # mild and the same from every viewpoint
LEVELS = 7


@dataclass(frozen=True, slots=True)
class Box:
    """A box standing in the room: `centre_m`, `size_m`, turned by `yaw_deg` about z; one painter or six."""

    centre_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    paint: Painter | tuple[Painter, ...]
    yaw_deg: float = 0.0
    inside: bool = False  # seen from within: the room itself
    mirror: int | None = None  # the face, in the order of FACE_AXES, that is a mirror

    @property
    def box_from_room(self) -> NDArray[np.float64]:
        """(4, 4) pose of the room in the axes of the box."""
        c, s = np.cos(np.deg2rad(self.yaw_deg)), np.sin(np.deg2rad(self.yaw_deg))
        pose = np.eye(4)
        pose[:3, :3] = [[c, s, 0], [-s, c, 0], [0, 0, 1]]
        pose[:3, 3] = -pose[:3, :3] @ np.array(self.centre_m)
        return pose


@dataclass(frozen=True, slots=True)
class Scene:
    """Boxes with their textures. `room_from_world` says where the world frame of the poses lies.

    Texture tables are indexed by [face, level]: `offset` into `texels`, and `size_px` (columns, rows).
    """

    boxes: tuple[Box, ...]
    texels: Image
    offset: NDArray[np.int64]
    size_px: NDArray[np.int64]
    texel_m: float
    room_from_world: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    @property
    def mirrors(self) -> list[tuple[int, int]]:
        """(box, face) of all mirrors."""
        return [(b, box.mirror) for b, box in enumerate(self.boxes) if box.mirror is not None]

    def reflection(self, box: int, face: int) -> NDArray[np.float64]:
        """(4, 4): mirrors points of the room at the plane of a face."""
        b = self.boxes[box]
        axis, sign = face // 2, 2 * (face % 2) - 1
        in_box = np.eye(4)
        in_box[axis, axis], in_box[axis, 3] = -1.0, sign * b.size_m[axis]
        return np.linalg.inv(b.box_from_room) @ in_box @ b.box_from_room

    def with_boxes_at(self, places: Mapping[int, tuple[tuple[float, float, float], float]]) -> "Scene":
        """The scene with some boxes elsewhere: index -> (centre_m, yaw_deg). Contact shadows stay behind."""
        if not places:
            return self
        boxes = list(self.boxes)
        for index, (centre_m, yaw_deg) in places.items():
            boxes[index] = replace(boxes[index], centre_m=centre_m, yaw_deg=yaw_deg)
        return replace(self, boxes=tuple(boxes))


def build_scene(
    boxes: tuple[Box, ...],
    seed: int,
    texel_m: float = 0.0025,
    room_from_world: NDArray[np.float64] | None = None,
) -> Scene:
    """Paint all faces, with contact shadows on the floor of the first box (the room), and build the pyramids."""
    pool: list[Image] = []
    offset = np.zeros((6 * len(boxes), LEVELS), np.int64)
    size_px = np.ones((6 * len(boxes), LEVELS, 2), np.int64)
    used = 0
    for b, box in enumerate(boxes):
        for f, ((ua, _), (va, _)) in enumerate(FACE_AXES):
            w, h = box.size_m[ua], box.size_m[va]
            paint = box.paint[f] if isinstance(box.paint, tuple) else box.paint
            image = paint(np.random.default_rng((seed, b, f)), w, h, texel_m)
            if box.inside:
                image = _corners_darkened(image, w, h)
                if f == 4:
                    image = _contact_shadows(image, box, boxes)
            image = np.clip(image * FACE_LIGHT[f ^ 1 if box.inside else f], 4, 250).astype(np.float32)
            for level in range(LEVELS):
                offset[6 * b + f, level] = used
                size_px[6 * b + f, level] = image.shape[1], image.shape[0]
                pool.append(image.ravel())
                used += image.size
                half = (max(1, image.shape[1] // 2), max(1, image.shape[0] // 2))
                image = cv2.resize(image, half, interpolation=cv2.INTER_AREA)
    pose = np.eye(4) if room_from_world is None else room_from_world
    return Scene(boxes, np.concatenate(pool), offset, size_px, texel_m, pose)


def _corners_darkened(image: Image, w: float, h: float) -> Image:
    """Light falls off towards the edges of walls, floor and ceiling."""
    x = np.linspace(0, w, image.shape[1], dtype=np.float32)
    y = np.linspace(0, h, image.shape[0], dtype=np.float32)
    fall_x = np.exp(-np.minimum(x, w - x) / 0.25)
    fall_y = np.exp(-np.minimum(y, h - y) / 0.25)
    return image * ((1 - 0.22 * fall_x)[None, :] * (1 - 0.22 * fall_y)[:, None])


def _contact_shadows(image: Image, room: Box, boxes: tuple[Box, ...]) -> Image:
    """Darken the floor under and around whatever stands on it."""
    per_m = np.array([image.shape[1] / room.size_m[0], -image.shape[0] / room.size_m[1]])  # row 0 lies at +y
    corner = np.array(room.centre_m[:2]) + np.array([-0.5, 0.5]) * np.array(room.size_m[:2])
    shade = np.zeros_like(image)
    for box in boxes:
        if box.inside or box.centre_m[2] - box.size_m[2] / 2 > 0.05:
            continue
        half = np.array(box.size_m[:2]) / 2
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half
        in_room = corners @ box.box_from_room[:2, :2] + np.array(box.centre_m[:2])
        cv2.fillPoly(shade, [np.round((in_room - corner) * per_m).astype(np.int32)], 1.0)
    small = cv2.resize(shade, None, fx=0.1, fy=0.1, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), max(0.1, 0.008 * per_m[0]))
    return image * (1 - 0.5 * cv2.resize(small, (image.shape[1], image.shape[0])))
