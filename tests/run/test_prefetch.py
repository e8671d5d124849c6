"""Frames prepared ahead: each with its own images, in order, and none lost if the log or a frame is damaged."""

from collections.abc import Generator
from typing import Any

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.errors import LogError
from stream_sfm.geometry import se3
from stream_sfm.run.loop import prepared_ahead

SIZE = (32, 48)


def frame(grey: int) -> Any:
    image = np.full(SIZE, grey, np.uint8)
    return sfm.StereoFrame(grey * 10**6, image, image)


@pytest.fixture
def engine() -> sfm.Engine:
    camera = sfm.Camera(SIZE[1], SIZE[0], np.array([[40.0, 0, 24], [0, 40, 16], [0, 0, 1]]))
    return sfm.Engine(sfm.StereoRig(camera, camera, se3.exp([-0.1, 0, 0, 0, 0, 0])))


def test_a_log_that_ends_in_an_error_gives_all_its_frames_first(engine: sfm.Engine) -> None:
    def breaking() -> Generator[Any, None, None]:
        yield from (frame(grey) for grey in (10, 20, 30))
        raise LogError("cut off")

    seen = []
    with pytest.raises(LogError, match="cut off"):
        for now, pair, _ in prepared_ahead(engine.observer, breaking()):
            assert pair is not None
            seen.append((now.stamp_ns // 10**6, int(pair.left[0, 0])))
    assert seen == [(10, 10), (20, 20), (30, 30)]


def test_a_frame_that_cannot_be_prepared_is_left_to_the_step(engine: sfm.Engine) -> None:
    bad: Any = sfm.StereoFrame(20 * 10**6, "no image", "none")  # type: ignore[arg-type]
    frames = (f for f in (frame(10), bad, frame(30)))
    found = list(prepared_ahead(engine.observer, frames))
    assert [pair is None for _, pair, _ in found] == [False, True, False]
    engine.step(*found[0][:2])
    with pytest.raises(sfm.FrameError, match="frame 1 "):
        engine.step(*found[1][:2])
    assert engine.step(*found[2][:2]).frame_index == 1
