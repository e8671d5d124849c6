"""Lenses, vergence and rectified images: their description in the log leads to the true path, in every profile."""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest

from stream_sfm import Camera, StereoRig, open_log, read_config, replay
from stream_sfm.geometry import se3
from tests.helpers.stereo_logs import PERIOD_NS, START_NS, LogWriter, calibration_of, write_pair, write_transform
from tests.helpers.wall import Wall, camera_path, rig

SIZE, FRAMES = (320, 240), 4
PROFILES = ("foxglove", "json", "ros2", "ros2idl", "ros1")
RAW_TOPICS, RECTIFIED_TOPICS, INFO_TOPICS = (
    [f"/stereo/{side}/{name}" for side in ("left", "right")] for name in ("image_raw", "image_rect", "camera_info")
)
RATIONAL = (0.25, 0.05, 0.002, -0.001, 0.01, 0.55, 0.12, 0.02)
FISHEYE = (0.04, -0.02, 0.01, -0.003)


def lens(model: str, d: tuple[float, ...]) -> StereoRig:
    """A pair that converges by 0.06 rad, both through one kind of lens."""
    stereo = rig(0.06)
    left = Camera(*SIZE, stereo.left.K, d, model)
    right = Camera(*SIZE, stereo.right.K + np.array([[3.0, 0, -4], [0, 2, 3], [0, 0, 0]]), d, model)
    return StereoRig(left, right, stereo.right_from_left)


@lru_cache
def rays_of(camera: Camera) -> np.ndarray:
    """Four rays (x, y, 1) to a pixel, row by row; half a second each."""
    offsets = np.array([-0.25, 0.25])
    u, v = ((np.arange(n)[:, None] + offsets).ravel() for n in SIZE)
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2)
    if camera.distortion_model == "equidistant":
        flat = cv2.fisheye.undistortPoints(pixels, camera.K, np.array(camera.D))
    else:
        flat = cv2.undistortPoints(
            pixels, camera.K, np.array(camera.D or (0.0,) * 4), None, None, None,
            (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10),
        )  # fmt: skip
    return np.concatenate([flat[:, 0], np.ones((len(flat), 1))], axis=1)


def through(wall: Wall, camera: Camera, world_from_cam: np.ndarray) -> np.ndarray:
    """What the camera sees of the wall through its lens: where its rays meet the texture."""
    wall_from_cam = se3.inverse(wall.world_from_wall) @ world_from_cam
    directions = rays_of(camera) @ wall_from_cam[:3, :3].T
    points = wall_from_cam[:3, 3] - directions * (wall_from_cam[2, 3] / directions[:, 2:])
    texels = (points[:, :2] / wall.TEXEL_M + (wall.SIZE - 1) / 2).astype(np.float32)
    big = cv2.remap(wall.texture, *texels.T.reshape(2, 2 * SIZE[1], 2 * SIZE[0]), cv2.INTER_LINEAR)
    small = cv2.resize(big, SIZE, interpolation=cv2.INTER_AREA).astype(float)
    return np.clip(np.rint(small + wall.rng.normal(size=small.shape)), 0, 255).astype(np.uint8)


def write(file, profile, images, infos, topics=RAW_TOPICS, transform=None):
    log = LogWriter(file)
    for i, pair in enumerate(images):
        time = START_NS + i * PERIOD_NS
        write_pair(log, profile, time, pair, infos if i == 0 else None, topics=topics, info_topics=INFO_TOPICS)
    if transform is not None:
        body_from_left = se3.exp([0.3, -0.2, 0.1, 0.4, -0.5, 0.6])
        write_transform(log, profile, START_NS, "body", "left", body_from_left)
        write_transform(log, profile, START_NS, "body", "right", body_from_left @ se3.inverse(transform))
    log.close()
    return file


def views(stereo: StereoRig) -> list[tuple[np.ndarray, np.ndarray]]:
    wall, left_from_right = Wall(5), se3.inverse(stereo.right_from_left)
    return [
        (through(wall, stereo.left, p), through(wall, stereo.right, p @ left_from_right)) for p in camera_path(FRAMES)
    ]


RIGS = {
    "none": lens("none", ()),
    "plumb_bob": lens("plumb_bob", (-0.25, 0.08, 0.001, -0.002)),
    "rational_polynomial": lens("rational_polynomial", RATIONAL),
    "equidistant": lens("equidistant", FISHEYE),
    "equidistant, all zero": lens("equidistant", (0.0,) * 4),
}

STRAIGHT = Camera(*SIZE, np.array([[250.0, 0, 165], [0, 250, 118], [0, 0, 1]]))
PARALLEL = StereoRig(STRAIGHT, STRAIGHT, se3.exp([-0.2, 0, 0, 0, 0, 0]))


@pytest.fixture(scope="module")
def seen():
    """kind -> the images that its cameras deliver."""
    return {kind: views(stereo) for kind, stereo in (RIGS | {"parallel": PARALLEL}).items()}


EXACT = read_config(None, ["rig.exact=true"])  # by a window that may not calibrate the lens that it was given


def error_m(file) -> float:
    result = replay(file, config=EXACT)
    return float(np.abs(result.trajectory.world_from_cam - camera_path(FRAMES)).max())


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("kind", RIGS)
def test_every_lens_gives_the_true_path(tmp_path, seen, profile, kind):
    stereo = RIGS[kind]
    name = {"none": "", "equidistant": "kannala_brandt" if profile in ("foxglove", "json") else "equidistant"}
    infos = calibration_of(stereo, name.get(kind.split(",")[0], kind))
    file = write(tmp_path / "log.mcap", profile, seen[kind], infos)
    log = open_log(file)
    np.testing.assert_allclose(log.rig.right_from_left, stereo.right_from_left, atol=1e-9)
    assert (log.rig.left.distortion_model, log.rig.left.D) == (stereo.left.distortion_model, stereo.left.D)
    if profile == "ros2":  # what comes after the rig is the same for all
        assert error_m(log) < 0.001  # m of 0.08; the path is known exactly


def test_a_lens_that_is_ignored_costs_more_than_the_tolerance(tmp_path, seen):
    """So the figure above can fail: the same images, read as those of a pinhole."""
    for kind in ("plumb_bob", "rational_polynomial", "equidistant", "equidistant, all zero"):
        file = write(tmp_path / "log.mcap", "ros2", seen[kind], calibration_of(RIGS["none"], ""))
        assert error_m(file) > 0.008  # eight times the tolerance above


@pytest.mark.parametrize("profile", PROFILES)
def test_the_pose_of_the_right_camera_by_transforms(tmp_path, seen, profile):
    """P gives no baseline, as with cameras calibrated one by one; two transforms to the body do."""
    stereo = RIGS["plumb_bob"]
    mono = [replace(c, R=np.eye(3), P=np.c_[c.K, np.zeros(3)]) for c in calibration_of(stereo, "plumb_bob")]
    log = open_log(write(tmp_path / "log.mcap", profile, seen["plumb_bob"], mono, transform=stereo.right_from_left))
    np.testing.assert_allclose(log.rig.right_from_left, stereo.right_from_left, atol=1e-9)
    assert error_m(log) < 0.001  # m of 0.08; the path is known exactly


@pytest.mark.parametrize("profile", PROFILES)
def test_images_that_are_rectified_already(tmp_path, seen, profile):
    """K, D and R are of the raw images then; only P counts, by the name of the topic."""
    k = PARALLEL.left.K
    raw = calibration_of(RIGS["plumb_bob"], "plumb_bob")
    infos = [replace(c, P=np.c_[k, [x, 0, 0]]) for c, x in zip(raw, (0, -50.0), strict=True)]
    log = open_log(write(tmp_path / "log.mcap", profile, seen["parallel"], infos, RECTIFIED_TOPICS))
    assert log.rig.left.distortion_model == "none"
    np.testing.assert_allclose(log.rig.left.K, k)
    assert error_m(log) < 0.001  # m of 0.08; the path is known exactly
