"""Logs of tools/render: everything that moves, mirrors, blurs or is faulty does so in images, depth and truth."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from stream_sfm.geometry import se3
from tools.render import FAULTS, MOTIONS, RECORDINGS, SIDES, Recording, Sensor
from tools.render.scene import Box, build_scene
from tools.render.textures import Image, crate, ground

SEED = 1
# In the middle of a room of 6 m, looking along x.
MIDDLE = se3.from_rotation_translation(np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]), np.array([3.0, 3.0, 1.5]))
SMALL = {"width": 96, "frames": 8, "texel_m": 0.05}


@lru_cache
def small(name: str) -> Recording:
    return (RECORDINGS | MOTIONS)[name](**SMALL)


@pytest.mark.parametrize("name", [*RECORDINGS, *MOTIONS])
def test_every_scene_can_be_rendered(name: str) -> None:
    recording = small(name)
    shot = recording.shot(recording.frames - 1, seed=1)
    assert shot.left.shape == shot.right.shape == shot.depth_m.shape == (72, 96)
    assert shot.left.std() > 3  # grey levels: the scene is there, not a plain grey
    assert np.isfinite(shot.depth_m).all() and shot.depth_m.min() > 0.1
    assert np.allclose(recording.pose(0), np.eye(4), atol=1e-12)


def test_bodies_move_the_room_stays_and_a_seed_gives_the_same_noise() -> None:
    crowd = small("crowd")
    shot, again = (crowd.shot(3, seed=1) for _ in "ab")
    assert np.array_equal(shot.left, again.left) and np.array_equal(shot.right, again.right)
    still = Recording(crowd.scene, crowd.rig, 2, 1.0, lambda _: crowd.path(0.0), crowd.bodies)
    changed = np.abs(still.shot(1, 0).depth_m - still.shot(0, 0).depth_m) > 0.05
    assert 0.05 < changed.mean() < 0.95  # a share of the image, neither nothing nor all


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
    look = small("spin")
    shot = Recording(scene, look.rig, 1, 1.0, lambda _: MIDDLE, sensor=Sensor(0, 0)).shot(0, 0)
    middle = shot.depth_m[30:42, 40:56]
    assert np.allclose(middle, 2.98, atol=1e-6)  # the glass, 3 m less its thickness
    # whoever faces the wall behind the camera has its bright half, at +y, on the right; in the mirror +y is on the left
    left, right = shot.left[36, 20:44].mean(), shot.left[36, 52:76].mean()
    assert right < 0.6 * left  # grey levels of 60 and 200, less the shade


def test_an_open_shutter_blurs_along_the_motion_without_a_shift() -> None:
    wall = Box((3, 3, 1.5), (6, 6, 3), crate, inside=True)
    scene = build_scene((wall,), 2, 0.01)
    rig = small("spin").rig
    still = Recording(scene, rig, 1, 1.0, lambda t: MIDDLE @ se3.exp([0, 0, 0, 0, 2.0 * t, 0]), sensor=Sensor(0, 0))
    moving = replace(still, shutter_s=0.05)  # 0.1 rad: six pixels, which are averaged
    sharp, blurred = (recording.shot(0, 0).left.astype(float) for recording in (still, moving))
    assert np.abs(np.diff(blurred, axis=1)).mean() < 0.7 * np.abs(np.diff(sharp, axis=1)).mean()
    errors = [np.abs(blurred[:, 8:-8] - np.roll(sharp, k, axis=1)[:, 8:-8]).mean() for k in (-3, 0, 3)]
    assert errors[1] < min(errors[0], errors[2])


@pytest.fixture(scope="module")
def clean() -> Recording:
    return small("turning")


def test_rows_of_a_rolling_shutter_are_those_of_global_ones_at_their_times(clean: Recording) -> None:
    rolling, i = FAULTS["rs20"].applied(clean), 3
    for side in SIDES:
        view = rolling.view(i, side, SEED)
        image = rolling.image(view)
        height = len(image)
        for row in (0, 20, height - 1):
            row_s = i / clean.rate_hz + 0.020 * (row - (height - 1) / 2) / height
            at_once = clean.image(replace(view, stamp_s=row_s))
            # single precision may round a grey level that lies between two the other way
            assert np.abs(image[row].astype(int) - at_once[row]).max() <= 1
            assert np.count_nonzero(image[row] != at_once[row]) <= 2
    assert not np.array_equal(image, clean.image(clean.view(i, "right", SEED)))
    assert np.array_equal(rolling.pose(i), clean.pose(i))  # the truth is that of the stamp


def test_a_late_right_image_is_the_one_of_the_later_time(clean: Recording) -> None:
    frames = round(0.008 * 1000)
    slow = replace(clean, rate_hz=1000.0)  # a frame each millisecond
    late, i = FAULTS["late8"].applied(slow), 5
    shots, later = late.shot(i, SEED), slow.view(i + frames, "right", SEED)
    assert np.array_equal(shots.left, slow.shot(i, SEED).left)
    assert np.array_equal(shots.right, slow.image(replace(later, seed=(SEED, i, 1))))
    assert np.array_equal(late.pose(i), slow.pose(i))


def test_focus_and_turns_change_the_true_rig_and_not_the_calibration(clean: Recording) -> None:
    clean = replace(clean, frames=100)
    rigs = {name: [fault.applied(clean).true_rig(i) for i in range(100)] for name, fault in FAULTS.items()}
    focal = {name: np.array([rig.right.K[0, 0] for rig in of]) / clean.rig.right.K[0, 0] for name, of in rigs.items()}
    assert focal["autofocus2pct"][[0, 20, 40, 60, 99]] == pytest.approx([1, 1, 1.01, 1.02, 1.02], abs=1e-12)
    assert np.diff(focal["autofocus01"]) == pytest.approx(1e-4, abs=1e-12)
    calibrated = clean.rig.right_from_left
    for name, expected_rad in (("knock", [0, 0, 5e-4, 5e-4]), ("slowturn", [0, 49 * 2e-5, 50 * 2e-5, 99 * 2e-5])):
        assert np.array_equal(FAULTS[name].applied(clean).rig.right_from_left, calibrated)
        turns = [rigs[name][i].right_from_left @ se3.inverse(calibrated) for i in (0, 49, 50, 99)]
        angles = [np.linalg.norm(se3.log(turn)[3:]) for turn in turns]
        assert angles == pytest.approx(expected_rad, abs=1e-9)
        assert all(np.allclose(turn[:3, 3], 0, atol=1e-12) for turn in turns)  # about its own centre
