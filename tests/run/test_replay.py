"""A replay writes all estimates of the engine, however the run ends."""

import json
import os
import signal
import subprocess
import sys
from itertools import islice
from pathlib import Path
from unittest import mock

import pytest

import stream_sfm as sfm
from stream_sfm.config import read_config
from stream_sfm.logs.recording.stereo_log import StereoLog, open_log
from stream_sfm.results.estimates_writer import EstimatesWriter
from stream_sfm.run.replay import ReplayInterrupted, replay
from tests.helpers.places import ROOM
from tests.helpers.same_results import assert_same_results, estimate_messages
from tests.helpers.wall_log import write_wall_log

FILES = {"estimates.mcap", "summary.json", "config.toml", "metadata.yaml"}
FILES |= {f"trajectory.{kind}" for kind in ("tum", "kitti", "csv")}
FAST = sfm.Config(method="frame-to-frame")


@pytest.fixture(scope="module")
def replayed(wall_log: Path, tmp_path_factory):
    return replay(wall_log, tmp_path_factory.mktemp("out") / "first")


def test_a_replay_writes_its_files_and_nothing_else(replayed):
    assert {p.name for p in replayed.out_dir.iterdir()} == FILES
    summary = json.loads((replayed.out_dir / "summary.json").read_text())
    assert summary == json.loads(json.dumps(replayed.summary))
    assert summary["frames"] == dict(read=12, paired=12, estimated=12, degraded=0, lost=0, dropped=0)
    assert summary["complete"] and summary["warnings"] == summary["problems"] == replayed.problems == []
    assert read_config(replayed.out_dir / "config.toml") == sfm.Config()


def test_replay_is_repeatable_and_equal_to_live_to_the_byte(replayed, wall_log: Path, tmp_path: Path):
    again = replay(wall_log, tmp_path / "again")
    assert_same_results(again.out_dir, replayed.out_dir)

    opened = open_log(wall_log)
    engine = sfm.Engine(opened.rig, sfm.Config())
    writer = EstimatesWriter(tmp_path / "live.mcap", opened.rig, sfm.Config())
    for frame in opened.frames():
        live = sfm.StereoFrame(frame.stamp_ns, frame.left.copy(), frame.right.copy())
        writer.write(engine.step(live))
    writer.close()
    live_messages = estimate_messages(tmp_path / "live.mcap")
    assert live_messages == estimate_messages(replayed.out_dir / "estimates.mcap")


def test_a_selection_is_counted_as_such(wall_log: Path):
    result = replay(wall_log, None, FAST, sfm.Selection(0.1, 0.4, stride=2))
    frames = result.summary["frames"]
    assert len(result.trajectory) == frames["paired"] == frames["estimated"] == 4
    assert result.out_dir is None and result.summary["complete"]


def test_missing_right_images_are_counted_and_not_fatal(tmp_path: Path):
    summary = replay(write_wall_log(tmp_path / "gap.mcap", without_right=(4, 5, 6)), None, FAST).summary
    assert (summary["frames"]["read"], summary["frames"]["estimated"]) == (12, 9)
    assert summary["complete"] and any("no partner" in w for w in summary["warnings"])


@pytest.mark.parametrize("error", [RuntimeError("the caller's own"), sfm.OutputError("no space left on device")])
def test_a_failing_sink_loses_nothing_and_does_not_take_the_others_with_it(
    error: Exception, wall_log: Path, tmp_path: Path
):
    failing = mock.Mock(**{"write.side_effect": [None, None, error], "close.side_effect": error})
    other = mock.Mock()
    with pytest.raises(type(error), match=str(error)):
        replay(wall_log, tmp_path / "out", FAST, sinks=[failing, other])
    assert {p.name for p in (tmp_path / "out").iterdir()} == FILES and other.close.call_count == 1
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["complete"] is False and summary["frames"]["estimated"] == 3
    assert any(str(error) in w for w in summary["warnings"])
    written = sfm.read_results(tmp_path / "out")
    assert len(written) == 3 and not written.warnings


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_run_after_the_frame_in_hand(number, wall_log: Path, tmp_path: Path):
    def interrupt(estimate, _):
        if estimate.frame_index == 4:
            os.kill(os.getpid(), number)

    before = signal.getsignal(number)
    with pytest.raises(ReplayInterrupted) as caught:
        replay(wall_log, tmp_path / "out", FAST, sinks=[mock.Mock(write=interrupt)])
    assert signal.getsignal(number) == before
    assert len(caught.value.result.trajectory) == 5
    assert {p.name for p in (tmp_path / "out").iterdir()} == FILES
    assert caught.value.result.summary["complete"] is False
    assert any("interrupted after 5 frames" in w for w in caught.value.result.summary["warnings"])


def test_memory_does_not_grow_with_the_length_of_the_log(tmp_path: Path):
    """A log, then one of six times as many frames that is one long motion."""
    logs = [str(write_wall_log(tmp_path / f"{times}.mcap", n=16, times=times, truth=False)) for times in (2, 12)]
    script = "import sys; from stream_sfm import read_config; from stream_sfm.run.replay import replay\n"
    script += "exact = read_config(None, ['rig.exact=true'])  # what is learnt about a rig grows by itself, once\n"
    script += "for log in sys.argv[1:]: s = replay(log, log + '.out', config=exact).summary; f = s['frames']; "
    script += "print(f['estimated'], f['lost'], s['peak_rss_mib'])"
    done = subprocess.run([sys.executable, "-c", script, *logs], capture_output=True, text=True, check=True)
    (few, _, small), (many, lost, large) = ([float(x) for x in line.split()] for line in done.stdout.splitlines())
    assert (few, many, lost) == (30, 180, 0)
    assert large - small < 15  # MiB; the images of 150 frames would be 22 more


def test_a_sink_gets_each_estimate_with_its_frame_after_the_files(tmp_path: Path) -> None:
    written, lines, sink = tmp_path / "trajectory.tum.part", [], mock.Mock()
    sink.write.side_effect = lambda estimate, frame: lines.append(written.read_text().count("\n"))
    result = replay(ROOM, tmp_path, FAST, sfm.Selection(max_frames=3), sinks=[sink])
    assert lines == [1, 2, 3] and sink.close.call_count == 1
    for call, pose in zip(sink.write.call_args_list, result.trajectory.world_from_cam, strict=True):
        estimate, frame = call.args
        assert estimate.stamp_ns == frame.stamp_ns and (estimate.world_from_cam == pose).all()
        assert frame.pictures == (frame.recorded.left.data, frame.recorded.right.data)


def test_depth_that_cannot_be_read_costs_its_figures_only(wall_log: Path, monkeypatch) -> None:
    depths = StereoLog.depths

    def fails_later(self):
        yield from islice(depths(self), 3)
        raise sfm.LogError("the chunk is damaged")

    monkeypatch.setattr(StereoLog, "depths", fails_later)
    summary = replay(wall_log, None, FAST).summary
    assert summary["warnings"] == ["ground-truth depth is not compared: the chunk is damaged"]
    assert summary["ground_truth"]["local_structure_rms_m"] is None
    assert summary["frames"]["estimated"] == 12 and summary["complete"]
    assert summary["ground_truth"]["ate_rmse_m"] > 0


def test_a_replay_says_where_it_ends_and_what_its_covariances_are_worth(wall_log) -> None:
    summary = replay(wall_log, self_test=True, std_truth=(1e-5, 1e-6)).summary
    assert summary["end"]["std_position_m"] > 0 and summary["end"]["std_heading_deg"] > 0
    assert set(summary["self_test"]) == {"tracks", "image", "tracks_calibrated", "image_calibrated"}
    assert all([s["frames"] for s in spans][:3] == [1, 2, 5] for spans in summary["self_test"].values())
    assert summary["ground_truth"]["std_truth"] == [1e-5, 1e-6]
