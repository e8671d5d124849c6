"""Interlaced images, and no others, are reported by `inspect`, and no frame of them is ok for long."""

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.inspection.overview import inspect_log
from stream_sfm.pictures.interlacing import combed, is_interlaced
from tests.helpers.places import DEMO, ROOM
from tests.helpers.stereo_logs import START_NS, LogWriter, infos_of, write_image, write_info
from tests.helpers.wall import Wall, blotches, camera_path, rig


def woven(at_px: int, before_px: int, seed: int = 0, std_grey: float = 2.0, odd_grey: float = 0.0) -> np.ndarray:
    """A wall seen from one place in even rows, and from another one in odd rows, which may be brighter."""
    wall = blotches(seed)
    image = wall[100:400, 100 + at_px : 500 + at_px].copy()
    image[1::2] = wall[101:400:2, 100 + before_px : 500 + before_px] + odd_grey
    image += std_grey * np.random.default_rng(seed).normal(size=image.shape)
    return np.rint(image).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("step_px", [1, 2, 5, 20])
def test_rows_of_a_moving_camera_are_combed(step_px: int) -> None:
    assert all(is_interlaced(woven(step_px, 0, seed)) for seed in range(4))


@pytest.mark.parametrize("zoom", [0.992, 1.008])
def test_rows_of_a_camera_that_moves_straight_ahead_are_combed(zoom: float) -> None:
    """Columns in the middle of the image hardly move."""
    for seed in range(4):
        wall = blotches(seed)
        image = woven(0, 0, seed)
        about = cv2.getRotationMatrix2D((100 + 199.5, 100 + 149.5), 0, zoom)
        nearer = cv2.warpAffine(wall.astype(np.float32), about, wall.shape[::-1])[100:400, 100:500]
        image[1::2] = np.rint(nearer[1::2]).clip(0, 255)
        assert is_interlaced(image)


@pytest.mark.parametrize("odd_grey", [0.0, 4.0])
@pytest.mark.parametrize("std_grey", [0.0, 2.0, 10.0])
def test_whole_frames_are_not_combed(std_grey: float, odd_grey: float) -> None:
    """Noise adds the same to all differences, and the means of rows show a different brightness."""
    assert all(-0.06 < combed(woven(0, 0, seed, std_grey, odd_grey)) < 0.02 for seed in range(6))


def test_lines_across_the_image_and_images_without_content_are_not_combed() -> None:
    image = woven(0, 0)
    image[[3, 4, 5, -6, -5, -4]] = 255
    assert combed(image) < 0.02
    assert combed(np.full((300, 400), 90, np.uint8)) == combed(np.zeros((8, 8), np.uint8)) == 0


@pytest.mark.parametrize("log", [DEMO, ROOM])
def test_sample_logs_are_not_interlaced(log) -> None:
    for frame in sfm.open_log(log).frames(sfm.Selection(max_frames=3, stride=20)):
        assert not any(is_interlaced(np.asarray(image, np.uint8)) for image in frame.images)


def test_moving_frames_of_interlaced_video_are_degraded() -> None:
    """Fields of two moments in each image: the second moving frame tells."""
    log, before = sfm.open_log(ROOM), None
    engine, found = sfm.Engine(log.rig), []
    for frame in log.frames(sfm.Selection(max_frames=12)):
        images = [image.copy() for image in (frame.left, frame.right)]
        for image, earlier in zip(images, before or images, strict=True):
            image[1::2] = earlier[1::2]
        before = frame.left, frame.right
        found.append(engine.step(sfm.StereoFrame(frame.stamp_ns, *images)))
    assert all(e.status is sfm.Status.DEGRADED and "interlaced" in e.reason for e in found[4:])


@pytest.mark.parametrize("interlaced", [True, False])
def test_inspect_reports_interlaced_video(path, interlaced: bool) -> None:
    stereo, log, before = rig(), LogWriter(path), None
    for i, frame in enumerate(Wall(5).frames(stereo, camera_path(24)[::3])):
        time = START_NS + i * 100_000_000
        images = [frame.left.copy(), frame.right.copy()]
        if interlaced and before is not None:
            for image, earlier in zip(images, (before.left, before.right), strict=True):
                image[1::2] = earlier[1::2]
        before = frame
        for side, image in enumerate(images):
            topic = f"/camera/{('left', 'right')[side]}/"
            write_info(log, "foxglove", topic + "camera_info", time, infos_of(stereo)[side], "camera")
            write_image(log, "foxglove", topic + "image", time, image, "png")
    log.close()
    problems = inspect_log(path)["problems"]
    assert any("are interlaced" in problem for problem in problems) == interlaced
