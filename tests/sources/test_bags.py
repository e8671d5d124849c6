"""Bags on disk give the frames of the MCAP log with the same messages."""

import os
import shutil
import sqlite3
from contextlib import closing
from itertools import product

import numpy as np
import pytest

from stream_sfm import LogError, open_log
from stream_sfm.inspection.overview import inspect_log
from tests.helpers.bags import messages_of, write_bag1, write_bag2
from tests.helpers.stereo_logs import Spec, write_log


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """The same stereo log in both encodings of ROS: profile -> path."""
    folder = tmp_path_factory.mktemp("logs")
    return {profile: write_log(folder / f"{profile}.mcap", Spec(profile=profile)) for profile in ("ros1", "ros2")}


def frames(path):
    log = open_log(path)
    return list(log.frames()), log


def check_same(path, reference, complete=True):
    expected, by_mcap = frames(reference)
    found, log = frames(path)
    assert [f.stamp_ns for f in found] == [f.stamp_ns for f in expected]
    for frame, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(frame.left, other.left)
        np.testing.assert_array_equal(frame.right, other.right)
    np.testing.assert_array_equal(log.rig.right_from_left, by_mcap.rig.right_from_left)
    assert log.stats.complete == complete and log.path == path
    return log


FORMATS = {"ros1": "ROS 1 bag", "sqlite3": "ROS 2 bag (SQLite)", "mcap": "MCAP"}


@pytest.mark.parametrize(
    ("storage", "compression"),
    [*product(["ros1"], ["none", "bz2", "lz4"]), *product(["sqlite3", "mcap"], [None, "message", "file"])],
)
def test_a_bag_is_its_folder_its_file_or_its_metadata(tmp_path, logs, storage, compression):
    messages, places = messages_of(logs["ros1" if storage == "ros1" else "ros2"]), []
    if storage == "ros1":
        bag = write_bag1(tmp_path / "walk.bag", messages, compression)
    else:
        bag = write_bag2(tmp_path / "walk", messages, storage, compression)
        places = [p for p in bag.iterdir() if compression is None or p.suffix == ".yaml"]
    log = check_same(bag, logs["ros1" if storage == "ros1" else "ros2"])
    assert log.expected_frames == 12 and not log.stats.warnings
    assert log.duration_s == pytest.approx(1.1)
    report = inspect_log(bag)
    assert (report["format"], report["problems"]) == (FORMATS[storage], [])
    for place in places:
        assert len(frames(place)[0]) == 12 and open_log(place).path == (bag if place.suffix == ".yaml" else place)


def split(folder, messages, storage, parts=3):
    """One bag in several files, as `ros2 bag record --max-bag-duration` leaves it; returns the files."""
    folder.mkdir()
    suffix = {"sqlite3": ".db3", "mcap": ".mcap"}[storage]
    files = []
    for n in range(parts):
        share = messages[n * len(messages) // parts : (n + 1) * len(messages) // parts]
        part = write_bag2(folder.parent / f"part_{n}", share, storage)
        files.append(folder / f"walk_{n}{suffix}")
        shutil.move(next(p for p in part.iterdir() if p.suffix == suffix), files[-1])
    return files


def metadata(folder, files, storage):
    names = "\n".join(f"    - {f.name}" for f in files)
    (folder / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: {storage}\n"
        f"  relative_file_paths:\n{names}\n  compression_format: ''\n  compression_mode: ''\n"
    )


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("with_metadata", [True, False])
def test_the_splits_of_a_bag_are_one_recording(tmp_path, logs, storage, with_metadata):
    files = split(tmp_path / "walk", messages_of(logs["ros2"]), storage)
    if with_metadata:
        metadata(tmp_path / "walk", files, storage)
    log = check_same(tmp_path / "walk", logs["ros2"])
    assert log.expected_frames == 12
    assert inspect_log(tmp_path / "walk")["files"] == 3


def test_files_recorded_side_by_side_are_merged_by_time(tmp_path, logs):
    messages = messages_of(logs["ros2"])
    (tmp_path / "walk").mkdir()
    for n, side in enumerate(("left", "right")):
        part = write_bag2(tmp_path / side, [m for m in messages if side in m.channel.topic], "mcap")
        shutil.move(part / f"{side}.mcap", tmp_path / "walk" / f"walk_{n}.mcap")
    check_same(tmp_path / "walk", logs["ros2"])


def test_a_split_that_is_missing_empty_or_a_pipe_costs_its_frames_and_is_reported(tmp_path, logs):
    files = split(tmp_path / "walk", messages_of(logs["ros2"]), "mcap")
    metadata(tmp_path / "walk", files, "mcap")
    for spoil, said in (
        (lambda: files[2].write_bytes(b""), "walk_2.mcap is empty"),
        (files[2].unlink, "cannot read"),
        (lambda: os.mkfifo(files[2]), "a pipe"),
    ):
        spoil()
        found, log = frames(tmp_path / "walk")
        assert 6 <= len(found) < 12 and not log.stats.complete  # some frames of the last third begin in the second
        assert any(said in w and "walk_2.mcap" in w for w in log.stats.warnings)


def test_bags_before_iron_carry_no_definitions(tmp_path, logs):
    bag = write_bag2(tmp_path / "walk", messages_of(logs["ros2"]))
    with closing(sqlite3.connect(bag / "walk.db3")) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("DROP TABLE schema")
        database.commit()
    check_same(bag, logs["ros2"])


def test_a_database_that_is_cut_off_gives_what_comes_before(tmp_path, logs):
    file = write_bag2(tmp_path / "walk", messages_of(logs["ros2"])) / "walk.db3"
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    found, log = frames(file)
    assert 0 < len(found) < 12 and not log.stats.complete
    assert any("reading failed after" in w for w in log.stats.warnings)
    file.write_bytes(data[:3000])
    with pytest.raises(LogError, match=r"walk\.db3 is not a ROS 2 bag, or is damaged"):
        open_log(file)


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_a_bag_that_is_cut_off_gives_what_comes_before(tmp_path, logs, compression):
    """As a recorder leaves it that was killed: no index, and the last chunk not whole."""
    path = write_bag1(tmp_path / "walk.bag", messages_of(logs["ros1"]), compression)
    data = path.read_bytes()
    index_at = int.from_bytes(data.split(b"index_pos=")[1][:8], "little")
    unindexed = data.replace(b"index_pos=" + index_at.to_bytes(8, "little"), b"index_pos=" + bytes(8))
    path.write_bytes(unindexed[:index_at])
    log = check_same(path, logs["ros1"], complete=False)
    assert "has no index" in log.stats.warnings[0]
    path.write_bytes(unindexed[: index_at // 2])
    try:
        found, log = frames(path)
    except LogError as error:  # of a compressed chunk nothing may come before the cut
        assert compression != "none" and str(path) in str(error)
    else:
        assert 0 < len(found) < 12 and not log.stats.complete
        assert any("cut off or damaged at byte" in w for w in log.stats.warnings)


def test_a_damaged_bag_is_read_on_at_the_next_chunk(tmp_path, logs):
    path = write_bag1(tmp_path / "walk.bag", messages_of(logs["ros1"]), chunk_bytes=1 << 12)
    data = bytearray(path.read_bytes())
    chunk = data.index(b"op=\x05", data.index(b"op=\x05") + 1)
    data[chunk - 20 : chunk + 8] = bytes(28)
    path.write_bytes(data)
    found, log = frames(path)
    assert 8 <= len(found) < 12 and not log.stats.complete  # one of some dozen chunks is lost
    assert any("read on at byte" in w for w in log.stats.warnings)


def test_a_folder_without_one_recording_says_what_is_wanted(tmp_path, logs):
    with pytest.raises(LogError, match=r"without a recording \(an MCAP file, a ROS 1 bag, a ROS 2 bag"):
        open_log(tmp_path)
    for name in ("lab.mcap", "yard.mcap"):
        shutil.copy(logs["ros2"], tmp_path / name)
    with pytest.raises(LogError, match=r"several recordings \(lab\.mcap, yard\.mcap"):
        open_log(tmp_path)
