"""The hard scenes that tools/render makes: what moves, mirrors and blurs does so in pictures, depth and truth."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from render import RECORDINGS, Recording, Sensor
from render.scene import Box, build_scene
from render.textures import Image, crate, ground

from stream_sfm.geometry import se3

SMALL = {"width": 96, "frames": 8, "texel_m": 0.05}


@pytest.mark.parametrize("name", RECORDINGS)
def test_every_scene_can_be_rendered(name: str) -> None:
    recording = RECORDINGS[name](**SMALL)
    shot = recording.shot(recording.frames - 1, seed=1)
    assert shot.left.shape == shot.right.shape == shot.depth_m.shape == (72, 96)
    assert shot.left.std() > 3  # grey levels: the scene is there, not a plain grey
    assert np.isfinite(shot.depth_m).all() and shot.depth_m.min() > 0.1
    assert np.allclose(recording.pose(0), np.eye(4), atol=1e-12)
    again = recording.shot(recording.frames - 1, seed=1)
    assert np.array_equal(shot.left, again.left) and np.array_equal(shot.right, again.right)


def test_bodies_move_and_the_room_stays() -> None:
    crowd = RECORDINGS["crowd"](**SMALL)
    still = Recording(crowd.scene, crowd.rig, 2, 1.0, lambda _: crowd.path(0.0), crowd.bodies)
    changed = np.abs(still.shot(1, 0).depth_m - still.shot(0, 0).depth_m) > 0.05
    assert 0.05 < changed.mean() < 0.95


def _striped(rng: np.random.Generator, width_m: float, height_m: float, texel_m: float) -> Image:
    """Half dark, half bright, so that left and right can be told apart in a mirror."""
    image = np.full((round(height_m / texel_m), round(width_m / texel_m)), 60, np.float32)
    image[:, image.shape[1] // 2 :] = 200
    return image


def test_a_mirror_shows_what_the_mirrored_camera_sees_and_has_the_depth_of_the_glass() -> None:
    plain, grey = ground(120, 0.0), ground(200, 0.0)
    room = Box((3, 3, 1.5), (6, 6, 3), (_striped, plain, plain, plain, plain, plain), inside=True)
    glass = Box((5.99, 3, 1.5), (0.02, 5.9, 2.9), grey, mirror=0)
    scene = build_scene((room, glass), 1, 0.02)
    look = RECORDINGS["spin"](**SMALL)
    pose = se3.from_rotation_translation(np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]), np.array([3.0, 3.0, 1.5]))
    shot = Recording(scene, look.rig, 1, 1.0, lambda _: pose, sensor=Sensor(0, 0)).shot(0, 0)
    middle = shot.depth_m[30:42, 40:56]
    assert np.allclose(middle, 2.98, atol=1e-6)  # the glass, 3 m less its thickness
    # whoever faces the wall behind the camera has its bright half, at +y, on the right; in the mirror +y is on the left
    left, right = shot.left[36, 20:44].mean(), shot.left[36, 52:76].mean()
    assert right < 0.6 * left


def test_an_open_shutter_blurs_along_the_motion_without_a_shift() -> None:
    wall = Box((3, 3, 1.5), (6, 6, 3), crate, inside=True)
    scene = build_scene((wall,), 2, 0.01)
    rig = RECORDINGS["spin"](**SMALL).rig
    start = se3.from_rotation_translation(
        np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]), np.array([3.0, 3.0, 1.5])
    )

    def path(t: float) -> np.ndarray:
        return start @ se3.exp(np.array([0, 0, 0, 0, 2.0 * t, 0]))

    sharp = Recording(scene, rig, 1, 1.0, path, sensor=Sensor(0, 0)).shot(0, 0).left.astype(float)
    open_s = 0.05  # 0.1 rad: six pixels
    blurred = (
        Recording(scene, rig, 1, 1.0, path, shutter_s=open_s, sensor=Sensor(0, 0)).shot(0, 0).left.astype(float)
    )
    assert np.abs(np.diff(blurred, axis=1)).mean() < 0.7 * np.abs(np.diff(sharp, axis=1)).mean()
    errors = [np.abs(blurred[:, 8:-8] - np.roll(sharp, k, axis=1)[:, 8:-8]).mean() for k in (-3, 0, 3)]
    assert errors[1] < min(errors[0], errors[2])
