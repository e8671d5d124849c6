"""There and back: the distance of its ends is drift, its σ is right, and the results of the run do not change."""

import json

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.run import there_and_back
from stream_sfm.system.interrupts import Interruption
from tests.helpers.places import ROOM
from tests.helpers.wall_log import write_wall_log

SHORT = sfm.Selection(max_frames=20)


@pytest.fixture(scope="module")
def alone():
    return sfm.replay(ROOM, selection=SHORT)


def test_the_way_back_ends_at_the_beginning_within_its_covariance(alone):
    done = sfm.replay(ROOM, selection=SHORT, there_and_back=True)
    back = done.summary["there_and_back"]
    assert np.array_equal(done.trajectory.world_from_cam, alone.trajectory.world_from_cam)
    assert done.summary["frames"] == alone.summary["frames"] and "there_and_back" not in alone.summary
    assert 0 < back["apart_m"] < 0.01 * done.summary["path_length_m"] and back["lost"] == 0
    assert 0.05 < back["over_sigma"] < 2
    assert back["apart_percent"] == 50 * back["apart_m"] / done.summary["path_length_m"]


def test_a_way_there_that_turned_too_far_is_reported_in_degrees(alone):
    log, there = sfm.open_log(ROOM), alone.trajectory
    turned = there.world_from_cam.copy()
    turned[-1] = turned[-1] @ se3.exp([0, 0, 0, 0, 0.02, 0])
    wrong = sfm.Trajectory(there.stamps_ns, turned, there.cov_pose)
    back = there_and_back.drift_there_and_back(log, sfm.Config(), SHORT, wrong, Interruption())
    assert abs(back["apart_deg"] - np.degrees(0.02)) < 0.1 and back["over_sigma"] > 5


def test_frames_that_do_not_fit_into_memory_are_reported_and_lose_nothing(monkeypatch, tmp_path, cli):
    monkeypatch.setattr(there_and_back, "_MOST_BYTES", 100_000)
    said = cli("replay", ROOM, "--max-frames", "20", "--there-and-back", "--json", "--out", tmp_path)
    summary = json.loads(said.out)
    assert summary["there_and_back"] is None and summary["frames"]["estimated"] == 20
    assert any("choose fewer of them" in warning for warning in summary["warnings"])


def test_the_command_prints_it(tmp_path, cli):
    path = tmp_path / "wall.mcap"
    write_wall_log(path, 6)
    assert "there and back" in cli("replay", path, "--there-and-back", "--out", tmp_path / "o").out
