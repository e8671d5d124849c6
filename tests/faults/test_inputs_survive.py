"""No run harms its inputs, files of the user, or the results of another run."""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

import stream_sfm as sfm
from stream_sfm.results.folder import ResultFolder
from stream_sfm.system.files import PartFile, write_whole
from stream_sfm.system.outputs import only_writer, refuse_overwriting
from tests.helpers.stereo_logs import write_log
from tests.helpers.wall import Wall, camera_path, rig

FAST = ("--method", "frame-to-frame", "-q")


def everything(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


ATTACKS = {
    "replay, its recording for the viewer": ("a/estimates.mcap", "replay {log} --out {d}/new --rrd {there}"),
    "replay, its results": ("a/estimates.mcap", "replay {log} --out {d}/a"),
    "replay, its part": ("a/estimates.mcap.part", "replay {log} --out {d}/a"),
    "compare, its results": ("a/frame_to_frame/estimates.mcap", "compare {log} --methods frame-to-frame --out {d}/a"),
    "compare, its page": ("a/report.html", "compare {log} --out {d}/a"),
    "batch, its results": ("estimates/estimates.mcap", "batch {there} --out {d}"),  # whose name makes the folder
    "batch, its page": ("report.html", "batch {log} --out {d}"),
    "recover, its log": ("x.mcap", "recover {there} {there} --force"),
    "surface, its mesh": ("x.ply", "surface {there} --out {there}"),
}  # fmt: skip


@pytest.mark.parametrize("attack", ATTACKS)
@pytest.mark.parametrize("through", ["itself", "a symbolic link", "a hard link"])
def test_an_output_that_is_an_input_is_refused(attack, through, tmp_path, cli):
    name, command = ATTACKS[attack]
    there = tmp_path / name
    there.parent.mkdir(exist_ok=True, parents=True)
    log = write_log(there if through == "itself" else tmp_path / "log.mcap")
    if through != "itself":
        there.symlink_to(log) if through == "a symbolic link" else os.link(log, there)
    before = everything(tmp_path)
    words = command.format(log=log, there=there, d=tmp_path).split()
    assert "it is an input of this run" in cli(*words, "-q", code=3).err
    assert everything(tmp_path) == before


@pytest.mark.parametrize(
    "words",
    [
        "--save-map {out}/estimates.mcap", "--save-map {out}/../out/trajectory_map.tum",
        "--save-map {out}/summary.json.part", "--rrd {out}/config.toml", "--rrd {out}/x --save-map {out}/x",
    ],
)  # fmt: skip
def test_two_results_of_a_run_are_two_files(words, tmp_path, cli):
    log, out = write_log(tmp_path / "log.mcap"), tmp_path / "out"
    out.mkdir()
    said = cli("replay", log, "--out", out, *words.format(out=out).split(), *FAST, code=3).err
    assert "two results of this run would be this file" in said
    assert not list(out.iterdir())


def test_a_map_is_not_a_result_of_its_run(tmp_path):
    with pytest.raises(sfm.OutputError, match="two results"):
        sfm.replay(write_log(tmp_path / "log.mcap"), tmp_path, save_map=tmp_path / "estimates.mcap")


def test_settings_are_not_replaced_by_others(tmp_path, cli):
    log, out = write_log(tmp_path / "log.mcap"), tmp_path / "out"
    out.mkdir()
    mine = out / "config.toml"
    mine.write_text("# tuned for the tunnel\n[window]\nframes = 7\n")
    assert "config.toml: it is an input" in cli("replay", log, "--out", out, "--config", mine, *FAST, code=3).err
    assert "tunnel" in mine.read_text()
    cli("replay", log, "--out", tmp_path / "b", "--config", mine, *FAST)
    same = tmp_path / "b" / "config.toml"
    cli("replay", log, "--out", tmp_path / "b", "--config", same, "-q")  # the same settings: nothing of it is lost


def test_the_files_of_a_folder_are_inputs_but_not_results_in_it(tmp_path):
    for name in ("image_0/000.png", "out/summary.json", "out/estimates.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_whole(tmp_path / name, b"content")
    refuse_overwriting([tmp_path / "out/estimates.mcap", tmp_path / "new.ply"], [tmp_path])
    with pytest.raises(sfm.OutputError, match=r"000\.png"):
        refuse_overwriting([tmp_path / "image_0/000.png"], [tmp_path])


def test_a_folder_is_not_replaced(tmp_path):
    with pytest.raises(sfm.OutputError, match=f"{tmp_path}: it is a folder"):
        refuse_overwriting([tmp_path], [])


def test_a_temporary_file_is_a_new_one(tmp_path):
    """A link that lies in its place was followed, and the file behind it written over."""
    precious = tmp_path / "precious"
    precious.write_bytes(b"years of work")
    (tmp_path / "x.part").symlink_to(precious)
    write_whole(tmp_path / "x", b"result")
    os.link(precious, tmp_path / "y.part")
    write_whole(tmp_path / "y", b"result")
    assert precious.read_bytes() == b"years of work"
    assert (tmp_path / "x").read_bytes() == (tmp_path / "y").read_bytes() == b"result"


def test_a_temporary_file_has_one_writer_and_is_not_exchanged(tmp_path):
    first = PartFile(tmp_path / "x")
    with pytest.raises(sfm.OutputError, match=r"another run is writing .*x\.part"):
        PartFile(tmp_path / "x")
    first.close()
    second = PartFile(tmp_path / "x")
    (tmp_path / "x.part").unlink()
    (tmp_path / "x.part").write_bytes(b"of somebody else")
    with pytest.raises(sfm.OutputError, match="replaced by another process"):
        second.close()
    assert (tmp_path / "x").read_bytes() == b""


def test_a_folder_has_one_writer(tmp_path):
    """Two at once left a fifth of the frames, and said that all was well."""
    engine = sfm.Engine(rig())
    frame = next(iter(Wall(5).frames(rig(), camera_path(1))))
    estimate = engine.step(frame)
    first, second = (ResultFolder(tmp_path, rig(), sfm.Config()) for _ in range(2))
    first.write(estimate, frame)
    with pytest.raises(sfm.OutputError, match=f"{tmp_path}: another run is writing there"):
        second.write(estimate, frame)
    second.close()
    second.write_summary({})
    first.close()
    first.write_summary({"frames": 1})
    assert len(list(sfm.read_estimates(tmp_path / "estimates.mcap"))) == 1
    assert not list(tmp_path.glob("*.part"))
    second.write(estimate, frame)  # the folder is free again
    second.close()


def test_a_process_that_dies_gives_its_folder_back(tmp_path):
    code = "import sys, time; from pathlib import Path; from stream_sfm.system.outputs import only_writer\n"
    code += "with only_writer(Path(sys.argv[1])): print('locked', flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"locked\n"
        with pytest.raises(sfm.OutputError, match="another run"), only_writer(tmp_path):
            pass
        process.kill()
    with only_writer(tmp_path):
        pass


def test_a_file_system_without_locks_is_written_to(tmp_path, monkeypatch):
    def refused(*_: object) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refused)
    with only_writer(tmp_path):
        write_whole(tmp_path / "x", b"content")


def test_a_batch_removes_no_file_that_is_not_its_own(tmp_path, cli):
    log, out = write_log(tmp_path / "log.mcap"), tmp_path / "out"
    (out / "log").mkdir(parents=True)
    (out / "stop").write_text("mine")
    (out / "log" / "config.toml").write_text("mine too")
    assert "no batch wrote (config.toml)" in cli("batch", log, "--out", out, *FAST, code=3).err
    assert (out / "stop").read_text() == "mine"
    assert everything(out / "log") == {"config.toml": b"mine too"}
