"""Rows of two moments, as in interlaced video, are reported if something moves, and never in whole frames."""

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config.image_rules import FieldRules, StillRules
from stream_sfm.frontend.field_check import FieldCheck, combed
from stream_sfm.frontend.still_check import Lines
from tests.helpers.places import ROOM
from tests.helpers.wall import blotches


def lines(at_px: int, before_px: int, seed: int = 0, std_grey: float = 2.0, odd_grey: float = 0.0) -> Lines:
    """Lines of a wall seen from one place in even rows, and from another one in odd rows, which may be brighter."""
    wall = blotches(seed)
    image = wall[100:400, 100 + at_px : 500 + at_px].copy()
    image[1::2] = wall[101:400:2, 100 + before_px : 500 + before_px] + odd_grey
    image += std_grey * np.random.default_rng(seed).normal(size=image.shape)
    return Lines.of(np.rint(image).clip(0, 255).astype(np.uint8), StillRules())


@pytest.mark.parametrize("step_px", [1, 2, 5, 20])
def test_rows_of_a_moving_camera_are_combed(step_px: int) -> None:
    check = FieldCheck()
    for n in range(3):
        check = check.after(*(lines((n + 1) * step_px, n * step_px, seed) for seed in (0, 1)))
    assert "interlaced" in check.problem


@pytest.mark.parametrize("odd_grey", [0.0, 4.0])
@pytest.mark.parametrize("std_grey", [0.0, 2.0, 10.0])
def test_whole_frames_are_not_combed(std_grey: float, odd_grey: float) -> None:
    """Noise adds the same to all differences, and the means of rows show a different brightness."""
    assert all(
        -0.06 < combed(lines(0, 0, seed, std_grey, odd_grey).columns, FieldRules()) < 0.02 for seed in range(6)
    )


def test_lines_across_the_image_are_not_combed() -> None:
    """They are like those of a frame that is drawn over it."""
    columns = lines(0, 0).columns
    columns[:, [3, 4, 5, -6, -5, -4]] = 255
    assert combed(columns, FieldRules()) < 0.02


def test_masked_pixels_do_not_count() -> None:
    whole, part = lines(3, 0).columns, lines(3, 0).columns.copy()
    part[:, 200:] = -1
    part[:5] = -1
    assert combed(part, FieldRules()) == pytest.approx(combed(whole, FieldRules()), rel=0.3)
    assert combed(np.full_like(part, -1), FieldRules()) == 0


def test_a_suspicion_ends() -> None:
    check = FieldCheck()
    for _ in range(3):
        check = check.after(lines(5, 0), lines(5, 0))
    assert check.problem
    for _ in range(150):
        check = check.after(lines(0, 0), lines(0, 0))
    assert not check.problem


def test_interlaced_frames_are_not_ok() -> None:
    log = sfm.open_log(ROOM)
    fields, whole = sfm.Engine(log.rig), sfm.Engine(log.rig)
    last: list[np.ndarray] = []
    for n, frame in enumerate(log.frames(sfm.Selection(max_frames=8))):
        new = [frame.left, frame.right]
        woven = [image.copy() for image in new]
        for image, before in zip(woven, last, strict=n > 0):
            image[1::2] = before[1::2]
        last = new
        estimate, sound = fields.step(sfm.StereoFrame(frame.stamp_ns, *woven)), whole.step(frame)
        if n > 3:  # before that it hardly moves
            assert sound.status is sfm.Status.OK
            assert estimate.status is sfm.Status.DEGRADED and "rows of two moments" in estimate.reason
