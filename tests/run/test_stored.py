"""Observations on disk come back unchanged, or without the rig errors."""

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.logs.recording.stereo_log import open_log
from stream_sfm.pipeline.observer import Observed, Observer
from stream_sfm.run.lane import Lane
from stream_sfm.run.loop import run
from stream_sfm.run.stored import StoredObservations
from stream_sfm.system.interrupts import Interruption
from stream_sfm.types import FrameEstimate
from tests.helpers.places import DEMO

FRAMES = 12
pytestmark = pytest.mark.slow


class Kept:
    """A check that keeps what it is given, in memory."""

    def __init__(self) -> None:
        self.observed: list[Observed] = []

    def add(self, observed: Observed, estimates: dict[str, FrameEstimate]) -> None:
        self.observed.append(observed)


@pytest.fixture(scope="module")
def stored():
    log, config, kept = open_log(DEMO), sfm.Config(), Kept()
    lane = Lane(config, Observer(log.rig, config), None, None)
    stored = StoredObservations(lane)
    run(log, lane, (), (stored, kept), selection=sfm.Selection(max_frames=FRAMES), interruption=Interruption())
    yield lane, stored, kept.observed
    stored.close()


def test_they_come_back_as_they_were(stored) -> None:
    """More than once, with all that an estimator and an estimate take from them."""
    lane, stored, kept = stored
    assert len(stored) == len(kept) == FRAMES
    for _ in range(2):
        for back, was in zip(stored, kept, strict=True):
            for name in ("track_ids", "z_px", "cov_px"):
                assert np.array_equal(getattr(back.observations, name), getattr(was.observations, name), equal_nan=True)
            assert back.observations.rig.model is lane.observer._frontend.rig and back.timings_ms == was.timings_ms
            assert np.array_equal(back.observations.lasting.inflation, was.observations.lasting.inflation)
            ids = was.observations.track_ids
            assert np.array_equal(back.errors.std_disparity_px(ids), was.errors.std_disparity_px(ids))


def test_the_errors_of_the_rig_are_those_known_at_the_end(stored) -> None:
    """In every frame the same, the first one, too: the demo's disparity is a quarter of a pixel off."""
    lane, stored, kept = stored
    for exact, was in zip(stored.calibrated(lane.observer), kept, strict=True):
        assert exact.observations.rig is None
        change_px = was.observations.z_px - exact.observations.z_px
        assert 0.1 < abs(np.nanmedian(change_px[:, 0] - change_px[:, 2])) < 0.5
