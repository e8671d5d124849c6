"""Files, folders and patterns stand for the right logs, and results get the right names."""

from pathlib import Path

import pytest

from stream_sfm.batch.logs import find_logs, names_for, truth_files
from stream_sfm.errors import ConfigError, LogError


def touch(folder: Path, names: str) -> None:
    """Make these files, whose names stand between blanks."""
    for name in names.split():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    touch(tmp_path, "a/run.mcap a/second.mcap b/run.mcap b/deep/run.mcap b/.cache/x.mcap b/notes.txt")
    touch(tmp_path, "out/a-run/estimates.mcap")
    (tmp_path / "none").mkdir()
    return tmp_path


def test_a_folder_is_its_logs_but_not_results_or_hidden_files(tree: Path):
    found = find_logs([str(tree)])
    names = ["a/run.mcap", "a/second.mcap", "b/deep/run.mcap", "b/run.mcap"]
    assert list(found) == [tree / name for name in names]
    assert list(names_for(found).values()) == ["a-run", "a-second", "b-deep-run", "b-run"]


def test_a_recording_that_is_a_folder_is_one_log(tmp_path: Path):
    touch(tmp_path, "bags/walk/metadata.yaml bags/walk/walk_0.db3 bags/old.bag bags/single.db3 notes/readme.txt")
    touch(tmp_path, "bags/crashed/crashed_0.mcap bags/crashed/crashed_1.mcap")
    touch(tmp_path, "seq/00/calib.txt seq/00/image_0/000000.png seq/00/image_1/000000.png")
    touch(tmp_path, "MH/mav0/cam0/data.csv MH/mav0/cam1/data.csv")
    (tmp_path / "linked").symlink_to(tmp_path / "seq", target_is_directory=True)
    skipped: list[str] = []
    names = ["MH", "bags/crashed", "bags/old.bag", "bags/single.db3", "bags/walk", "seq/00"]
    assert list(find_logs([str(tmp_path)], skipped)) == [tmp_path / name for name in names]
    assert len(skipped) == 1 and "linked is a link to a folder" in skipped[0]
    assert list(find_logs([str(tmp_path / "bags/walk")])) == [tmp_path / "bags/walk"]


def test_names_stay_when_a_folder_grows(tree: Path):
    before = names_for(find_logs([str(tree / "b")]))
    touch(tree, "b/new/run.mcap")
    after = names_for(find_logs([str(tree / "b")]))
    assert before.items() < after.items()


def test_patterns_are_expanded_where_no_shell_has_done_it(tree: Path):
    assert list(find_logs([f"{tree}/*/run.mcap"])) == [tree / "a/run.mcap", tree / "b/run.mcap"]
    assert len(find_logs([f"{tree}/b/**/run.mcap"])) == 2


@pytest.mark.parametrize("pattern", ["**/*.mcap", "**/**/*.mcap", "**/*/run.mcap", "**", "**/run*"])
def test_patterns_follow_no_links(pattern: str, tree: Path):
    """Two links that lead back make endless paths, of which glob tries all."""
    before = find_logs([f"{tree}/{pattern}"])
    for name in ("a/loop", "b/back"):
        (tree / name).symlink_to(tree, target_is_directory=True)
    skipped: list[str] = []
    assert find_logs([f"{tree}/{pattern}"], skipped) == before
    assert skipped == [] or "is a link to a folder" in skipped[0]


def test_each_log_once_and_missing_ones_kept(tree: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tree / "a")
    found = find_logs(["run.mcap", "../a/run.mcap", str(tree / "a"), "gone.mcap"])
    assert list(found) == [tree / "a/run.mcap", tree / "a/second.mcap", tree / "a/gone.mcap"]


def test_a_folder_without_logs_is_an_error(tree: Path):
    with pytest.raises(LogError, match=r"none holds no log \(an MCAP file"):
        find_logs([str(tree / "none")])


@pytest.mark.parametrize(
    ("logs", "names"),
    [
        (["/x/run.mcap", "/x/other.mcap"], ["run", "other"]),
        (["/x/a/run.mcap", "/x/b/run.mcap"], ["a-run", "b-run"]),
        (["/x/a/run.mcap", "/y/a/run.mcap", "/y/b.mcap"], ["x-a-run", "y-a-run", "b"]),
        (["/x/a/Run.mcap", "/x/b/run.mcap"], ["a-Run", "b-run"]),
        (["/x/run.mcap", "/x/run.bag"], ["x-run", "x-run-2"]),
        (["/x/a-b/c.mcap", "/x/a/b-c.mcap", "/x/c.mcap"], ["a-b-c", "b-c", "x-c"]),
        (["/x/report.html.mcap", "/x/stop"], ["report.html-2", "stop-2"]),
    ],
)
def test_no_two_logs_have_one_name(logs: list[str], names: list[str]):
    found = names_for({Path(log): 1 for log in logs}, reserved=("report.html", "stop"))
    assert list(found.values()) == names


def test_truth_is_found_by_the_name_of_the_log_or_of_its_results(tmp_path: Path) -> None:
    a, b, c = (tmp_path / name for name in ("x/a.mcap", "y/a.mcap", "c.bag"))
    names, folder, empty = {a: "x-a", b: "y-a", c: "c"}, tmp_path / "truth", tmp_path / "x"
    empty.mkdir()
    touch(folder, "a.txt y-a.tum other.csv c.png")
    assert truth_files(folder, names) == {a: folder / "a.txt", b: folder / "y-a.tum"}
    assert truth_files(folder / "a.txt", names) == dict.fromkeys(names, folder / "a.txt")
    for given, others, said in (
        (folder / "none.txt", names, "the file or folder does not exist"),
        (folder, {tmp_path / "d.mcap": "d"}, r"such as d\.txt; it holds a\.txt"),
        (empty, names, r"such as x-a\.txt; it holds no \.txt"),
    ):
        with pytest.raises(ConfigError, match=said):
            truth_files(given, others)
