"""The commands as a user types them: exit codes, messages, one JSON object and nothing else."""

import argparse
import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from stream_sfm import estimators
from stream_sfm.cli import compare
from stream_sfm.cli.arguments import METHODS
from stream_sfm.cli.error_lines import COMMANDS as HINTED_COMMANDS
from stream_sfm.cli.error_lines import OPTIONS
from stream_sfm.cli.inspection_tables import broken_at
from stream_sfm.cli.main import COMMANDS, build_parser, main
from stream_sfm.config import Config, read_config
from stream_sfm.run.compare import COMPARED
from tests.helpers.stereo_logs import Spec, video, write_log
from tests.helpers.wall_log import write_wall_log

FAST = ["--method", "frame-to-frame"]
COMMAND_NAMES = [c.__name__.rsplit(".", 1)[1].rstrip("_") for c in COMMANDS]


def half(log: Path, to: Path) -> Path:
    to.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    return to


def options(parser: argparse.ArgumentParser | None = None) -> list[argparse.Action]:
    """All options of a parser (None: of `stream-sfm`) and of the commands in it."""
    actions: list[argparse.Action] = []
    for action in (parser or build_parser())._actions:
        if isinstance(action, argparse._SubParsersAction):
            actions += [inner for command in action.choices.values() for inner in options(command)]
        else:
            actions.append(action)
    return actions


@pytest.mark.parametrize("command", ["", *COMMAND_NAMES])
def test_every_command_has_help(command: str, capsys):
    assert main([*command.split(), "--help"]) == 0
    assert "usage: stream-sfm" in capsys.readouterr().out


def test_help_answers_at_once():
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "stream_sfm", "--help"], capture_output=True, text=True, timeout=60
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode == 0
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 0.4


def test_building_the_parser_imports_nothing_heavy():
    script = (
        "import sys; from stream_sfm.cli.main import build_parser; build_parser()\n"
        "print([m for m in ('numpy', 'cv2', 'rich', 'mcap', 'msgspec', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["replay"],
        ["replay", "x.mcap", "--max-frames", "0"],
        ["replay", "x.mcap", "--stride", "two"],
        ["replay", "x.mcap", "--start", "-1"],
        ["replay", "x.mcap", "--end", "nan"],
        ["replay", "x.mcap", "--start", "3", "--end", "2"],
        ["replay", "x.mcap", "--set", "window.frames"],
        ["replay", "x.mcap", "--set", "window.frames=0"],
        ["replay", "x.mcap", "--set", "widow.frames=8"],
        ["replay", "x.mcap", "--config", "missing.toml"],
        ["config", "--set", "nonsense=1"],
    ],
)
def test_wrong_use_is_2_with_a_message_and_no_traceback(arguments: list[str], capsys):
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err and "Traceback" not in said.err


def test_an_unknown_method_is_2_and_names_the_known(wall_log: Path, capsys, tmp_path: Path):
    assert main(["replay", str(wall_log), "--method", "magic", "--out", str(tmp_path / "o")]) == 2
    said = capsys.readouterr().err
    assert "magic" in said and "cross-frame" in said
    assert not (tmp_path / "o").exists()


def bad_logs(folder: Path, good: Path) -> dict[str, Path]:
    (folder / "text.mcap").write_text("this is no log\n" * 10)
    (folder / "empty.mcap").touch()
    (folder / "head.mcap").write_bytes(good.read_bytes()[:200])
    return {
        "missing": folder / "missing.mcap",
        "folder": folder,
        "not MCAP": folder / "text.mcap",
        "empty": folder / "empty.mcap",
        "cut in the header": folder / "head.mcap",
        "no image": write_log(folder / "a.mcap", Spec(left=(), right=())),
        "one camera": write_log(folder / "b.mcap", Spec(right=())),
        "no calibration": write_log(folder / "c.mcap", Spec(infos=(None, None))),
        "other size": write_log(folder / "d.mcap", Spec(size=(128, 64))),
        "video": video(folder / "e.mcap"),
    }


def test_logs_that_cannot_be_used_are_3_with_the_file_named_and_no_traceback(
    wall_log: Path, tmp_path: Path, capsys
):
    for what, path in bad_logs(tmp_path, wall_log).items():
        assert main(["replay", str(path), "--out", str(tmp_path / "out"), "--json"]) == 3, what
        said = capsys.readouterr()
        assert said.out == "" and path.name in said.err and "Traceback" not in said.err, what
        assert not (tmp_path / "out").exists(), what
        assert main(["inspect", str(path)]) == 3, what
        assert "Traceback" not in capsys.readouterr().err, what


def test_an_error_is_followed_by_the_options_and_commands_that_help(wall_log: Path, tmp_path: Path, capsys):
    def hint(*arguments: str) -> str:
        assert main(list(arguments)) in (2, 3)
        return capsys.readouterr().err.splitlines()[-1]

    one_camera = str(write_log(tmp_path / "one.mcap", Spec(right=())))
    assert hint("replay", one_camera) == "hint: use --mono"
    assert hint("surface", one_camera, "--out", "x.ply").startswith("stream-sfm: "), "surface has no --mono"
    uncalibrated = str(write_log(tmp_path / "raw.mcap", Spec(infos=(None, None))))
    assert hint("replay", uncalibrated) == "hint: use --calibration FILE"
    assert hint("replay", str(wall_log), "--left", "/nowhere") == "hint: use --left TOPIC"
    assert (
        hint("replay", str(wall_log), "--set", "widow.frames=8") == "hint: `stream-sfm config` prints every setting"
    )


@pytest.mark.parametrize(
    "arguments, says",
    [
        (["replya", "x.mcap"], "unknown command 'replya'; did you mean replay?"),
        (["replay", "x.mcap", "--max-frame=3", "--wieuw"], "unknown option '--wieuw'; did you mean --view?"),
        (["fly"], "unknown command 'fly'; known are replay, batch, "),
        (["import", "kiti", "d", "o.mcap"], "unknown kind 'kiti'; did you mean kitti?"),
        (["import", "kitti", "d", "o.mcap", "--pose-s=x"], "unknown option '--pose-s'; did you mean --poses?"),
        (["simulate", "effciency"], "unknown experiment 'effciency'; did you mean efficiency?"),
        (["replay", "x.mcap", "y.mcap"], "unknown argument 'y.mcap'"),
        (["replay", "x.mcap", "--method", "crossframe"], "unknown method 'crossframe'; did you mean cross-frame?"),
        (["replay", "x.mcap", "--stride", "0"], "stream-sfm: --stride: '0' is not a whole number of at least 1"),
    ],
)
def test_a_misspelt_name_is_answered_by_the_nearest(arguments: list[str], says: str, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert says in error and "hint: `stream-sfm" in error


def test_the_program_alone_prints_its_help(capsys):
    assert main([]) == 2
    assert "usage: stream-sfm COMMAND" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line, words",
    [
        ("stream-sfm rep", {"replay "}),
        ("stream-sfm replay --there", {"--there-and-back "}),
        ("stream-sfm replay --method ekf", {"ekf", "ekf-cv"}),
        ("stream-sfm import k", {"kitti "}),
        ("stream-sfm config --set robust.min_i", {"robust.min_inliers="}),
    ],
)
def test_the_shell_completes(line: str, words: set[str], tmp_path: Path):
    answer = tmp_path / "answer"
    asked = {
        "_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "COMP_LINE": line, "COMP_POINT": str(len(line)),
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer), "_ARGCOMPLETE_SUPPRESS_SPACE": "0",
    }  # fmt: skip
    command = [sys.executable, "-m", "stream_sfm"]
    subprocess.run(command, env=os.environ | asked, timeout=60, check=True)
    assert set(answer.read_text().split("\n")) == words


def test_no_name_is_broken_between_two_lines_of_help(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    for command in COMMAND_NAMES:
        assert main([command, "--help"]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert not [line for line in lines if line.endswith("-") or len(line) > 80], command
    assert main(["replay", "--help"]) == 0
    words = capsys.readouterr().out.replace(",", " ").split()
    assert set(METHODS) <= set(words), "--method names them all"


@pytest.mark.parametrize(
    "name, lines",
    [
        ("/cam0/image_raw", ["/cam0/image_raw"]),
        ("/camera/left/image_rect_color", ["/camera/left", "/image_rect_color"]),
        ("sensor_msgs/msg/CompressedImage", ["sensor_msgs/msg", "/CompressedImage"]),
        ("foxglove.CameraCalibration", ["foxglove.", "CameraCalibration"]),
        ("x" * 40, ["x" * 18, "x" * 18, "x" * 4]),
    ],
)
def test_long_names_break_between_words(name: str, lines: list[str]):
    assert broken_at(name, "/._", 18) == "\n".join(lines)


def test_the_parser_knows_the_methods():
    assert tuple(estimators.METHODS) == METHODS
    assert tuple(compare.DEFAULT_METHODS.split(",")) == COMPARED


def test_hints_name_options_that_exist():
    given = {action.option_strings[-1] for action in options() if action.option_strings}
    assert {option.split()[0] for option in OPTIONS.values()} <= given
    assert all(re.search(rf"stream-sfm ({'|'.join(COMMAND_NAMES)})", text) for text in HINTED_COMMANDS.values())


def test_a_topic_that_is_not_there_is_3_and_named(wall_log: Path, capsys):
    assert main(["replay", str(wall_log), "--left", "/nowhere", "--right", "/camera/right/image"]) == 3
    assert "/nowhere" in capsys.readouterr().err


def test_json_is_one_object_and_nothing_else(wall_log: Path, tmp_path: Path, capsys):
    assert main(["replay", str(wall_log), "--out", str(tmp_path / "o"), "--json", *FAST]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["complete"] is True and summary["frames"]["estimated"] == 12
    assert summary["out"] == str(tmp_path / "o")
    assert summary["method"] == "frame-to-frame"
    assert main(["inspect", str(wall_log), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["pair"]["left"] == "/camera/left/image"


def test_the_table_and_the_description_say_what_matters(wall_log: Path, tmp_path: Path, capsys):
    assert main(["replay", str(wall_log), "--out", str(tmp_path / "o"), "-v", *FAST]) == 0
    said = capsys.readouterr()
    assert "12 estimated of 12 paired" in said.out and "final drift" in said.out
    assert "frame 0: initialising" in said.err and "frame 1: ok" in said.err
    assert main(["inspect", str(wall_log)]) == 0
    assert "/camera/left/image" in capsys.readouterr().out


def test_quiet_is_quiet(wall_log: Path, tmp_path: Path, capsys):
    assert main(["replay", str(wall_log), "--out", str(tmp_path / "o"), "-q", *FAST]) == 0
    assert capsys.readouterr() == ("", "")


def test_a_cut_log_is_3_with_everything_written(wall_log: Path, tmp_path: Path, capsys):
    cut = half(wall_log, tmp_path / "cut.mcap")
    assert main(["replay", str(cut), "--out", str(tmp_path / "o"), "--json", *FAST]) == 3
    said = capsys.readouterr()
    summary = json.loads(said.out)
    assert summary["complete"] is False and 7 <= summary["frames"]["estimated"] <= 9
    assert "warning: " in said.err and "MB" in said.err
    assert len(np.loadtxt(tmp_path / "o" / "trajectory.kitti")) == summary["frames"]["estimated"]


def test_strict_makes_a_warning_count(tmp_path: Path):
    log = write_wall_log(tmp_path / "gap.mcap", n=8, without_right=(2, 3, 4))
    arguments = ["replay", str(log), "--out", str(tmp_path / "o"), *FAST]
    assert main(arguments) == 0
    assert main([*arguments, "--strict"]) == 3


def test_without_out_a_folder_of_its_own_and_latest_points_to_it(wall_log: Path, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["replay", str(wall_log), "--max-frames", "2", "-q", *FAST]) == 0
    (folder,) = [p for p in Path("runs").iterdir() if not p.is_symlink()]
    assert folder.name.startswith("wall-")
    assert Path("runs/latest").resolve() == folder.resolve()
    assert (folder / "summary.json").exists()


def test_settings_are_used_and_written(wall_log: Path, tmp_path: Path):
    (tmp_path / "c.toml").write_text("[window]\nframes = 5\n")
    arguments = ["--config", str(tmp_path / "c.toml"), "--set", "robust.min_inliers=9", "--max-frames", "2"]
    assert main(["replay", str(wall_log), "--out", str(tmp_path / "o"), "-q", *arguments, *FAST]) == 0
    used = read_config(tmp_path / "o" / "config.toml")
    assert (used.window.frames, used.robust.min_inliers, used.method) == (5, 9, "frame-to-frame")


def test_config_prints_what_config_takes(tmp_path: Path, capsys):
    assert main(["config"]) == 0
    (tmp_path / "c.toml").write_text(capsys.readouterr().out)
    assert read_config(tmp_path / "c.toml") == Config()


def test_a_defect_is_1_with_one_line_and_a_traceback_only_on_demand(wall_log: Path, monkeypatch, capsys):
    def broken(*_arguments, **_options):
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr("stream_sfm.inspection.inspect_log", broken, raising=False)
    assert main(["inspect", str(wall_log)]) == 1
    said = capsys.readouterr().err
    assert "ZeroDivisionError: a defect" in said and "please report" in said and "Traceback" not in said
    assert main(["inspect", str(wall_log), "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err
    assert main(["--debug", "inspect", str(wall_log)]) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_interrupted_is_130_with_everything_written(number, tmp_path: Path):
    log = write_wall_log(tmp_path / "long.mcap", n=16, times=30, truth=False)
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "stream_sfm", "replay", str(log), "--out", str(out), "--json", *FAST],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
    )
    deadline = time.monotonic() + 60
    while not (out / "trajectory.tum.part").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.3)
    process.send_signal(number)
    said, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    summary = json.loads(said)
    assert summary["complete"] is False
    assert len(np.loadtxt(out / "trajectory.tum", ndmin=2)) == summary["frames"]["estimated"] > 0


@pytest.mark.parametrize("streams", [">&3", "2>&1 >&3", ">&3 2>&3"])
def test_the_reader_of_our_output_may_go(streams: str, wall_log: Path, tmp_path: Path):
    """A pipe whose reader has gone before anything is printed: nothing is said about it, and the run is not ended."""
    for command in ("config", f"inspect {wall_log}", f"replay {wall_log} -v --method ekf --out {tmp_path}/out"):
        ours = f"'{sys.executable}' -m stream_sfm {command}"
        script = f"( sleep 0.2; {ours} {streams}; echo code $? ) 3> >(true)"
        done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=120)
        assert done.stdout.endswith("code 0\n") and "Traceback" not in done.stderr + done.stdout, command
    assert len(np.loadtxt(tmp_path / "out" / "trajectory.tum")) > 5


@pytest.mark.parametrize(
    "streams, code, says",
    [(">/dev/full", 3, "stream-sfm: cannot write the standard output: No space left on device\n"), (">&-", 0, "")],
)
def test_an_output_that_takes_nothing_is_no_defect(streams: str, code: int, says: str, wall_log: Path):
    for command in ("config", f"inspect {wall_log}", f"inspect {wall_log} --json"):
        ours = f"'{sys.executable}' -m stream_sfm {command} {streams}"
        done = subprocess.run(["bash", "-c", ours], capture_output=True, text=True, timeout=120)
        assert (done.returncode, done.stderr) == (code, says), command


def test_a_package_that_was_removed_is_named(wall_log: Path, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "filterpy", None)
    monkeypatch.setitem(sys.modules, "filterpy.kalman", None)
    monkeypatch.delitem(sys.modules, "stream_sfm.estimators.baselines.ekf", raising=False)
    assert main(["replay", str(wall_log), "--method", "ekf", "--out", str(tmp_path / "out"), "-q"]) == 2
    assert "the package filterpy.kalman is missing, which stream-sfm needs" in capsys.readouterr().err


def test_an_empty_name_is_no_place_for_results(wall_log: Path, tmp_path: Path, monkeypatch, capsys):
    """As a variable of a script that was never set: the results went to the working folder."""
    monkeypatch.chdir(tmp_path)
    assert main(["replay", str(wall_log), "--out", "", "-q"]) == 2
    assert "--out: the name is empty" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_settings_are_printed_without_docstrings_too():
    done = subprocess.run([sys.executable, "-OO", "-m", "stream_sfm", "config"], capture_output=True, text=True)
    assert done.returncode == 0 and "\n[window]" in done.stdout


def test_the_program_is_called_stream_sfm(capsys):
    assert build_parser().prog == "stream-sfm"
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("stream-sfm ")
