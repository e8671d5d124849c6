"""Exact stereo images of a textured wall: one homography a camera, detail at all scales. Shared by the tests."""

import copy
from functools import lru_cache

import cv2
import numpy as np

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3
from stream_sfm.types import StereoFrame

PERIOD_NS = 50_000_000


def rig(vergence_rad: float = 0.0, width: int = 320, height: int = 240) -> StereoRig:
    """A small pair, baseline 0.2 m, the right camera turned inwards by `vergence_rad`."""
    k = np.array([[260.0, 0, (width - 1) / 2], [0, 260.0, (height - 1) / 2], [0, 0, 1]])
    camera = Camera(width, height, k)
    left_from_right = np.eye(4)
    left_from_right[:3, :3] = se3.exp_so3([0, -vergence_rad, 0])
    left_from_right[0, 3] = 0.2
    return StereoRig(camera, camera, se3.inverse(left_from_right))


@lru_cache(maxsize=8)  # half a second each
def _texture(seed: int, size: int) -> tuple[np.ndarray, np.random.Generator]:
    """A texture (size, size) uint8, read-only, and the state of the generator that has drawn it."""
    rng = np.random.default_rng(seed)
    texture = np.zeros((size, size), np.float32)
    for octave in range(3, 10):
        noise = rng.normal(size=(size >> octave, size >> octave)).astype(np.float32)
        texture += cv2.resize(noise, (size, size), interpolation=cv2.INTER_CUBIC) * 0.75 ** (9 - octave)
    texture -= texture.mean()
    grey = np.clip(128 + 45 * texture / texture.std(), 0, 255).astype(np.uint8)
    grey.flags.writeable = False
    return grey, rng


class Wall:
    """A wall 3 m in front of the first camera, slanted by 0.3 rad; 8 m wide and high, 2.5 mm a texel."""

    SIZE = 3200
    TEXEL_M = 0.0025

    def __init__(self, seed: int = 0) -> None:
        self.texture, drawn = _texture(seed, self.SIZE)
        self.rng = copy.deepcopy(drawn)
        self.world_from_wall = se3.exp([0, 0, 3.0, 0, 0, 0]) @ se3.exp([0, 0, 0, 0, 0.3, 0])

    def image(self, camera: Camera, world_from_cam: np.ndarray, noise: float = 1.0) -> np.ndarray:
        """What the camera sees of the wall (h, w) uint8, with grey noise of that deviation."""
        cam_from_wall = se3.inverse(world_from_cam) @ self.world_from_wall
        half = (self.SIZE - 1) / 2
        wall_from_texel = np.array(
            [[self.TEXEL_M, 0, -half * self.TEXEL_M], [0, self.TEXEL_M, -half * self.TEXEL_M], [0, 0, 1]]
        )
        pixel_from_texel = camera.K @ cam_from_wall[:3, [0, 1, 3]] @ wall_from_texel
        # twice the size, then averaged: no aliasing
        scale = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
        size = (2 * camera.width, 2 * camera.height)
        big = cv2.warpPerspective(self.texture, scale @ pixel_from_texel, size, flags=cv2.INTER_AREA)
        small = cv2.resize(big, (camera.width, camera.height), interpolation=cv2.INTER_AREA).astype(float)
        if noise:
            small += self.rng.normal(size=small.shape) * noise
        return np.clip(np.rint(small), 0, 255).astype(np.uint8)

    def frame(self, stereo: StereoRig, world_from_cam: np.ndarray, index: int) -> StereoFrame:
        """The stereo frame of that index from that pose of the left camera."""
        world_from_right = world_from_cam @ se3.inverse(stereo.right_from_left)
        left, right = self.image(stereo.left, world_from_cam), self.image(stereo.right, world_from_right)
        return StereoFrame(index * PERIOD_NS, left, right)

    def frames(self, stereo: StereoRig, poses: np.ndarray) -> list[StereoFrame]:
        """The stereo frames from those poses (n, 4, 4), one every `PERIOD_NS`."""
        return [self.frame(stereo, pose, index) for index, pose in enumerate(poses)]


def camera_path(n: int) -> np.ndarray:
    """A gentle path (n, 4, 4) sideways and forward with some turning; the first pose is the world."""
    step = se3.exp([0.02, 0.004, 0.015, 0.002, -0.004, 0.003])
    poses = [np.eye(4)]
    for _ in range(n - 1):
        poses.append(se3.orthonormalise(poses[-1] @ step))
    return np.stack(poses)


def blotches(seed: int) -> np.ndarray:
    """A texture (700, 900) of blotches of some pixels."""
    noise = np.random.default_rng(seed).integers(0, 256, (700, 900)).astype(np.float32)
    texture = cv2.GaussianBlur(noise, (0, 0), 2)
    return (128 + 60 * (texture - texture.mean()) / texture.std()).clip(0, 255)
