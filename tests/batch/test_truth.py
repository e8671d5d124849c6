"""Each log of a batch is compared with the file that is named after the log, or all with one."""

import json
from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.batch.logs import truth_files
from stream_sfm.cli.main import main
from stream_sfm.results.trajectory_files import tum_line
from tests.helpers.places import ROOM


def test_files_are_found_by_the_name_of_the_log_or_of_its_results(tmp_path: Path) -> None:
    a, b, c = (tmp_path / name for name in ("x/a.mcap", "y/a.mcap", "c.bag"))
    names = {a: "x-a", b: "y-a", c: "c"}
    folder = tmp_path / "truth"
    folder.mkdir()
    for name in ("a.txt", "y-a.tum", "other.csv", "c.png"):
        (folder / name).touch()
    assert truth_files(folder, names) == {a: folder / "a.txt", b: folder / "y-a.tum"}
    assert truth_files(folder / "a.txt", names) == dict.fromkeys(names, folder / "a.txt")
    for given, others, said in (
        (folder / "none.txt", names, "the file or folder does not exist"),
        (folder, {tmp_path / "d.mcap": "d"}, r"such as d\.txt; it holds a\.txt"),
        (tmp_path / "x", names, r"such as x-a\.txt; it holds no \.txt"),
    ):
        (tmp_path / "x").mkdir(exist_ok=True)
        with pytest.raises(sfm.ConfigError, match=said):
            truth_files(given, others)


@pytest.mark.slow
def test_a_batch_is_compared_with_the_files(tmp_path: Path) -> None:
    """The truth of the room, twice as large: every figure must say so, and a second run must notice the file."""
    truth = sfm.open_log(ROOM).ground_truth()
    assert truth is not None
    doubled = truth.world_from_cam.copy()
    doubled[:, :3, 3] *= 2
    folder = tmp_path / "truth"
    folder.mkdir()
    lines = [tum_line(stamp, pose) for stamp, pose in zip(truth.stamps_ns.tolist(), doubled, strict=True)]
    (folder / "room.txt").write_text("\n".join(lines))
    command = ["batch", str(ROOM), "--out", str(tmp_path / "out"), "--max-frames", "12", "-q"]
    errors, reused = [], []
    for more in ([], ["--ground-truth", str(folder)], ["--ground-truth", str(folder / "room.txt")]):
        assert main([*command, *more]) == 0
        (log,) = json.loads((tmp_path / "out" / "batch.json").read_text())["logs"]
        reused.append(log["reused"])
        errors.append(log["summary"]["ground_truth"]["scale_error_percent"])
    assert reused == [False, False, True]  # the last one has the same file as the one before
    assert abs(errors[0]) < 1
    assert np.allclose(errors[1:], -50, atol=1)
