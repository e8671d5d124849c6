"""Preparing a frame is pure: the number, the order and the frames of such calls change no estimate."""

from collections.abc import Callable
from functools import lru_cache

import pytest

import stream_sfm as sfm
from stream_sfm.pictures.prepared import PreparedImages
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig

N = 9
QUICK = sfm.read_config(None, ['method="frame-to-frame"'])
Prepare = Callable[[sfm.Engine, int], PreparedImages | None]


@lru_cache
def frames() -> list[sfm.StereoFrame]:
    return Wall(6).frames(rig(), camera_path(N))


def estimates(prepare: Prepare) -> list[bytes]:
    """The estimates of the engine, with each frame passed to `step` as `prepare` returned it."""
    engine = sfm.Engine(rig(), QUICK)
    done = [engine.step(frame, prepare(engine, n)) for n, frame in enumerate(frames())]
    assert sum(e.counts["new"] for e in done[1:]) > 0  # new points are sought in some frames, not in all
    assert any(e.counts["new"] == 0 for e in done[1:])
    return [e.world_from_cam.tobytes() + e.track_ids.tobytes() + e.cov_points.tobytes() for e in done]


@pytest.fixture(scope="module")
def plain() -> list[bytes]:
    return estimates(lambda engine, n: None)


def twice(engine: sfm.Engine, n: int) -> PreparedImages:
    engine.prepare(frames()[n], n)
    return engine.prepare(frames()[n])


def prepared_and_refused(engine: sfm.Engine, n: int) -> PreparedImages:
    if n % 3 == 1:
        late = sfm.StereoFrame(frames()[n].stamp_ns - PERIOD_NS, frames()[n].left, frames()[n].right)
        with pytest.raises(sfm.FrameError, match="stamps"):
            engine.step(late, engine.prepare(late, n))
    return engine.prepare(frames()[n], n)


def backwards(engine: sfm.Engine, n: int) -> PreparedImages:
    return [engine.prepare(frames()[m], m) for m in range(N - 1, n - 1, -1)][-1]


def with_a_wrong_index(engine: sfm.Engine, n: int) -> PreparedImages:
    return engine.prepare(frames()[n], n + 1)


def every_second(engine: sfm.Engine, n: int) -> PreparedImages | None:
    return engine.prepare(frames()[n], n) if n % 2 else None


@pytest.mark.parametrize("prepare", [twice, prepared_and_refused, backwards, with_a_wrong_index, every_second])
def test_estimates_do_not_depend_on_how_frames_are_prepared(plain: list[bytes], prepare: Prepare) -> None:
    assert estimates(prepare) == plain


def test_corners_are_computed_ahead_if_a_frame_of_this_index_needs_them() -> None:
    engine = sfm.Engine(rig())
    computed = ["corner_strength" in vars(engine.prepare(frames()[0], index)) for index in (0, 1, 2, None)]
    assert computed == [True, False, True, False]
