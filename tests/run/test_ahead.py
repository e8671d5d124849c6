"""Frames observed ahead: in order, none lost if a log or a frame is damaged, the same bytes whatever is in time."""

import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.errors import LogError
from stream_sfm.geometry import se3
from stream_sfm.pipeline.lane import BareLane
from stream_sfm.pipeline.observer import Observed
from stream_sfm.run.ahead import observed_ahead
from tests.helpers.estimates import bytes_of
from tests.helpers.imu_log import write_imu_log

SIZE = (32, 48)


def frame(grey: int) -> Any:
    image = np.full(SIZE, grey, np.uint8)
    return sfm.StereoFrame(grey * 10**6, image, image)


@pytest.fixture
def lane() -> BareLane:
    camera = sfm.Camera(SIZE[1], SIZE[0], np.array([[40.0, 0, 24], [0, 40, 16], [0, 0, 1]]))
    return sfm.Engine(sfm.StereoRig(camera, camera, se3.exp([-0.1, 0, 0, 0, 0, 0]))).lane


def test_a_log_that_ends_in_an_error_gives_all_its_frames_first(lane: BareLane) -> None:
    def breaking() -> Generator[Any, None, None]:
        yield from (frame(grey) for grey in (10, 20, 30))
        raise LogError("cut off")

    seen = []
    with pytest.raises(LogError, match="cut off"):
        for now, observed in observed_ahead(lane, breaking()):
            assert isinstance(observed, Observed)
            seen.append((now.stamp_ns, observed.observations.stamp_ns, observed.observations.frame_index))
    assert seen == [(n * 10**7, n * 10**7, n - 1) for n in (1, 2, 3)]


def test_a_refused_frame_has_its_reason_and_the_others_their_numbers(lane: BareLane) -> None:
    bad: Any = sfm.StereoFrame(20 * 10**6, "no image", "none")  # type: ignore[arg-type]
    first, refused, last = (observed for _, observed in observed_ahead(lane, iter((frame(10), bad, frame(30)))))
    assert isinstance(refused, sfm.FrameError) and "frame 1 " in str(refused)
    assert isinstance(first, Observed) and first.observations.frame_index == 0
    assert isinstance(last, Observed) and last.observations.frame_index == 1


@pytest.mark.parametrize("here", [True, False])
def test_a_live_frame_does_not_wait_for_another_one(lane: BareLane, here: bool) -> None:
    """With a frame in hand, the next one is read only if that takes no time."""
    read = []

    def coming() -> Generator[Any, None, None]:
        for grey in (10, 20, 30, 40, 50):
            read.append(grey)
            yield frame(grey)

    ahead = [len(read) for _ in observed_ahead(lane, coming(), lambda: here)]
    assert ahead == ([3, 4, 5, 5, 5] if here else [1, 2, 3, 4, 5])


@pytest.fixture(scope="module")
def with_samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_imu_log(tmp_path_factory.mktemp("imu"))[0]


@pytest.mark.parametrize("inertial", [False, True])
def test_estimates_do_not_depend_on_what_is_in_time(inertial: bool, wall_log: Path, with_samples: Path) -> None:
    """A run with slow sinks and without, a pipeline and single steps give the same bytes; one frame of all is bad."""
    path = with_samples if inertial else wall_log

    def engine_and_frames() -> tuple[sfm.Engine, list[Any]]:
        log = sfm.open_log(path)
        frames: list[Any] = list(log.frames())
        frames.insert(5, sfm.StereoFrame(frames[4].stamp_ns, frames[4].left, frames[4].right))
        return sfm.Engine(log.rig), frames

    engine, frames = engine_and_frames()
    expected = []
    for n, each in enumerate(frames):
        if n == 5:
            with pytest.raises(sfm.FrameError):
                engine.step(each)
        else:
            expected.append(bytes_of(engine.step(each)))
    assert engine.lane.rig is not None  # the front-end has learnt something

    for delay_s in (0.0, 0.03):
        engine, frames = engine_and_frames()
        found = []
        for _, observed in observed_ahead(engine.lane, iter(frames)):
            if isinstance(observed, Observed):
                found.append(bytes_of(engine.lane.estimate(observed)))
                time.sleep(delay_s * (len(found) % 3))
        assert found == expected

    engine, frames = engine_and_frames()
    estimates = []
    with sfm.Pipeline(engine) as pipeline:
        for n, each in enumerate(frames):
            if n == 5:
                with pytest.raises(sfm.FrameError):
                    pipeline.push(each)
            else:
                estimates.append(pipeline.push(each))
        with pytest.raises(sfm.EngineBusyError):
            engine.step(frames[-1])
        estimates.append(pipeline.finish())
        assert pipeline.finish() is None
    assert estimates[0] is None and [bytes_of(e) for e in estimates[1:] if e is not None] == expected
    assert engine.observations is not None and engine.observations.frame_index == len(expected) - 1
