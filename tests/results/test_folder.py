"""The result folder is created with the first estimate, and completed whatever fails."""

from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from evo.tools import file_interface
from rosbags.rosbag2 import Reader

import stream_sfm as sfm
from stream_sfm.config import RosConfig
from stream_sfm.logs.sources.recognise import is_recording
from stream_sfm.results.folder import ResultFolder, close_all, new_run_folder, point_latest_to
from tests.helpers.wall import Wall, camera_path, rig


@pytest.fixture(scope="module")
def steps() -> list[tuple[sfm.FrameEstimate, sfm.StereoFrame]]:
    engine = sfm.Engine(rig())
    frames = Wall(5).frames(rig(), camera_path(3))
    return [(engine.step(frame), frame) for frame in frames]


def write(path: Path, steps: list, config: sfm.Config | None = None) -> None:
    with ResultFolder(path, rig(), config or sfm.Config()) as folder:
        for step in steps:
            folder.write(*step)


def test_a_program_that_fails_keeps_what_it_has_written(steps, tmp_path: Path) -> None:
    with pytest.raises(ConnectionError), ResultFolder(tmp_path / "run", rig(), sfm.Config()) as folder:
        for step in steps:
            folder.write(*step)
        raise ConnectionError
    assert len(sfm.read_results(tmp_path / "run").stamps_ns) == len(steps)
    assert not list((tmp_path / "run").glob("*.part"))
    with pytest.raises(sfm.OutputError, match="is closed; write to a new ResultFolder"):
        folder.write(*steps[0])
    with pytest.raises(sfm.OutputError, match=r"of type StereoFrame cannot be written; give write\(estimate, frame\)"):
        folder.write(*reversed(steps[0]))


def test_without_an_estimate_nothing_is_written(tmp_path: Path) -> None:
    folder = ResultFolder(tmp_path / "run", rig(), sfm.Config())
    folder.close()
    folder.write_summary({"frames": 0})
    assert list(tmp_path.iterdir()) == []


def test_every_sink_is_closed_and_the_first_failure_is_raised() -> None:
    fails, closes = (mock.Mock(**{"close.side_effect": error}) for error in (sfm.OutputError("full"), None))
    with pytest.raises(sfm.OutputError, match="full"):
        close_all([fails, closes, fails])
    assert fails.close.call_count == 2 and closes.close.call_count == 1


def test_run_folders_are_never_used_twice(tmp_path: Path):
    first = new_run_folder("some/where/log.mcap", tmp_path / "runs")
    assert first.name.startswith("log-") and not first.exists()
    first.mkdir(parents=True)
    second = new_run_folder("some/where/log.mcap", tmp_path / "runs")
    assert second != first
    second.mkdir()
    for folder in (first, second):
        point_latest_to(folder)
        assert (tmp_path / "runs" / "latest").resolve() == folder.resolve()


@pytest.mark.parametrize("base_frame", ["", "base_link"])
def test_the_folder_is_a_bag(steps, tmp_path: Path, base_frame: str) -> None:
    """Read by rosbags, and by evo as users call it."""
    path = tmp_path / "run"
    write(path, steps, sfm.Config(ros=RosConfig(base_frame=base_frame)))
    with Reader(path) as bag, Reader(path / "estimates.mcap") as file:
        assert bag.message_count == file.message_count == len(list(bag.messages()))
        assert (bag.start_time, bag.end_time) == (file.start_time, file.end_time)
        assert {c.topic: (c.msgtype, c.msgcount) for c in bag.connections} == {
            c.topic: (c.msgtype, c.msgcount) for c in file.connections
        }
        durabilities = {c.topic: [q.durability.name for q in c.ext.offered_qos_profiles] for c in bag.connections}
        assert durabilities.get("/tf_static", []) == (["TRANSIENT_LOCAL"] if base_frame else [])
        read = file_interface.read_bag_trajectory(bag, "/stream_sfm/pose")
    if not base_frame:
        assert np.allclose(read.poses_se3, [e.world_from_cam for e, _ in steps], atol=1e-12)
    assert not is_recording(path)  # a batch over a folder with results does not replay them


def test_the_metadata_of_another_bag_is_left_as_it_is(steps, tmp_path: Path) -> None:
    for text in ("rosbag2_bagfile_information:\n  relative_file_paths: [mine.db3]\n", "not yaml", "{}"):
        (tmp_path / "metadata.yaml").write_text(text)
        write(tmp_path, steps[:1])
        assert (tmp_path / "metadata.yaml").read_text() == text
    (tmp_path / "metadata.yaml").unlink()
    for frames in (1, 2):  # that of an earlier run is replaced
        (tmp_path / "trajectory_map.tum").touch()
        write(tmp_path, steps[:frames])
        with Reader(tmp_path) as bag:
            assert next(c.msgcount for c in bag.connections if c.topic == "/tf") == frames
        assert not (tmp_path / "trajectory_map.tum").exists()
