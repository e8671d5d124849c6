"""The commands as a user types them: exit codes, messages, one JSON object and nothing else."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from stream_sfm import estimators
from stream_sfm.cli.app import build_app
from stream_sfm.cli.main import main
from stream_sfm.cli.options import Method
from stream_sfm.cli.tables import COMMANDS
from stream_sfm.cli.usage import COMMANDS as HINTED_COMMANDS
from stream_sfm.config import Config, FrontendConfig, WindowConfig, read_config
from stream_sfm.geometry.robust_rules import RobustRules
from tests.helpers.stereo_logs import Spec, write_log
from tests.helpers.wall_log import write_wall_log

FAST = ["--method", "frame-to-frame"]
METHODS = get_args(Method)
LINES = [*COMMANDS, *(f"import {kind}" for kind in ("kitti", "euroc", "images"))]


def test_an_environment_that_other_packages_trip_over_is_put_right(monkeypatch, cli):
    monkeypatch.setenv("OPENCV_FOR_THREADS_NUM", "abc")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "x")
    cli("config")
    assert os.environ["OPENCV_FOR_THREADS_NUM"] == "1"
    assert "SOURCE_DATE_EPOCH" not in os.environ


@pytest.mark.parametrize(
    "error, code, says",
    [
        (OSError(errno.EMFILE, "too many"), 2, "too many open files; raise the limit, for example by ulimit"),
        (OSError(errno.ENOSPC, "full", "a.csv"), 3, "cannot write a.csv: full"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (ModuleNotFoundError(name="lz4.frame"), 2, "the package lz4.frame is missing, which stream-sfm needs"),
        (
            ModuleNotFoundError(name="scipy.special"),
            2,
            "this needs the package scipy.special: pip install",
        ),
        (ModuleNotFoundError("no such", name="stream_sfm.x"), 1, "ModuleNotFoundError: no such"),
        (ZeroDivisionError("a\nb"), 1, "ZeroDivisionError: a\nthis is a defect of stream-sfm; please report"),
    ],
)
def test_an_error_is_a_code_and_one_line_and_a_traceback_only_on_demand(error, code, says, monkeypatch, capsys):
    def refused(*_: object) -> None:
        raise error

    monkeypatch.setattr("stream_sfm.cli.main.termination_as_interrupt", refused)
    assert main(["config"]) == code
    said = capsys.readouterr().err
    assert said.startswith(f"stream-sfm: {says}") and "Traceback" not in said
    for words in (["config", "--debug"], ["--debug", "config"]):
        assert main(words) == code
        assert "Traceback" in capsys.readouterr().err or isinstance(error, KeyboardInterrupt)


@pytest.mark.parametrize("command", ["", *LINES])
def test_every_command_has_help(command, cli):
    said = cli(*command.split(), "--help").out
    assert said.startswith(f"Usage: stream-sfm {command}".rstrip())
    assert not [line for line in said.splitlines() if len(line) > 80]  # columns of a terminal
    if command == "replay":
        words = re.sub(r"[,│\]]", " ", said).split()
        assert set(METHODS) <= set(words), "--method names them all, none broken between two lines"


def test_help_imports_nothing_heavy():
    script = (
        "import sys; from stream_sfm.cli.main import main; main(['replay', '--help'])\n"
        "heavy = ('numpy', 'cv2', 'scipy', 'mcap', 'msgspec', 'matplotlib', 'rerun')\n"
        "print([m for m in heavy if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=1800, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


HINT = "hint: `stream-sfm"  # of usage errors: where to read on


@pytest.mark.parametrize(
    "words, says, hint",
    [
        ("", "Usage: stream-sfm COMMAND", ""),
        ("import", "kitti", ""),
        ("batch --out o", "LOG is missing", ""),
        ("evaluate", "RUN is missing", ""),
        ("replay x.mcap --start -1", "start_s is -1.0; give seconds from the first frame", ""),
        ("replay x.mcap --end nan", "end_s is nan; give seconds", ""),
        ("replay x.mcap --start 3 --end 2", "the end, 2 s, lies before the start, 3 s", ""),
        ("replay x.mcap --set window.frames", "window.frames", ""),
        ("replay x.mcap --set widow.frames=8", "did you mean window?", "`stream-sfm config --expert` prints every"),
        ("replay x.mcap --config missing.toml", "missing.toml", ""),
        ("config --set nonsense=1", "nonsense", ""),
        ("config --set method=foo", "unknown method 'foo'", ""),
        ("replay x.mcap --set method=ekff", "did you mean ekf?", ""),
        ("surface x.mcap --out o.ply --set method=foo", "unknown method 'foo'", ""),
        ("replya x.mcap", 'unknown command "replya". Did you mean "replay"?', HINT),
        ("replay x.mcap --max-frame=3", "unknown option: --max-frame. Did you mean --max-frames?", HINT),
        ("fly", 'unknown command "fly". Available commands: replay, live, ', HINT),
        ("import kiti d o.mcap", 'unknown command "kiti". Did you mean "kitti"?', HINT),
        ("import kitti d o.mcap --pose-s=x", "unknown option: --pose-s. Did you mean --poses?", HINT),
        ("simulate effciency", 'Did you mean "efficiency"?', HINT),
        ("replay x.mcap y.mcap", "unexpected argument: y.mcap", HINT),
        ("replay x.mcap --method crossframe", 'Did you mean "cross-frame"?', HINT),
        ("replay x.mcap --stride 0", 'invalid value "0" for --stride: give a whole number of at least 1', HINT),
        ("replay x.mcap --out=", "--out: the name is empty", HINT),  # a variable of a script that was never set
        (f"replay x.mcap {3 * '--calibration a.yaml '}", "give one file, or two: left and right", HINT),
        ("replay x.mcap --left", "--left needs a value", HINT),
        ("replay", "LOG is missing", HINT),
        ("surface x.mcap", "--out is missing", HINT),
        ("simulate rates --seed x", 'stream-sfm: invalid value for --seed: unable to convert "x" into int', HINT),
        ("compare x --ignore-ground-truth 5:3", "'5:3' is not a range of frames: give it as 0:15", HINT),
        ("compare x --ground-truth-std 1", "'1' is not a σ in metres and one in radians", HINT),
    ],
)
def test_wrong_use_is_2_with_a_message_and_the_nearest_name(words, says, hint, cli):
    said = cli(*words.split(), code=2)
    assert said.out == "" and says in said.err and hint in said.err


def test_an_unknown_method_is_2_and_names_the_known(wall_log, cli, tmp_path):
    said = cli("replay", wall_log, "--method", "magic", "--out", tmp_path / "o", code=2).err
    assert "magic" in said and "cross-frame" in said
    assert "magic" in cli("compare", wall_log, "--methods", "magic", "--out", tmp_path / "o", code=2).err
    assert not (tmp_path / "o").exists()


def test_an_error_is_followed_by_the_options_and_commands_that_help(wall_log, tmp_path, cli):
    def hint(*words: object) -> str:
        return cli(*words, code=3).err.splitlines()[-1]

    one_camera = write_log(tmp_path / "one.mcap", Spec(right=()))
    assert hint("replay", one_camera) == "hint: use --calibration FILE --mono"
    assert hint("surface", one_camera, "--out", "x.ply") == "hint: use --calibration FILE", "surface has no --mono"
    uncalibrated = write_log(tmp_path / "raw.mcap", Spec(infos=(None, None)))
    assert hint("replay", uncalibrated) == "hint: use --calibration FILE"
    assert hint("replay", wall_log, "--left", "/nowhere") == "hint: use --left TOPIC"


def test_the_shell_completes_settings_too(cli):
    said = cli("__complete", "replay", "x.mcap", "--set", "rules.robust.min").out
    assert "rules.robust.min_inliers=" in said.splitlines()
    for shell in ("bash", "zsh", "fish"):
        script = build_app().generate_completion(shell=shell)
        assert all(word in script for word in ("replay", "--max-frames", "iterated-ekf", "kitti", "__complete"))


def test_the_parser_knows_the_methods_and_hints_name_commands_that_exist():
    assert tuple(estimators.METHODS) == METHODS
    assert all(re.search(rf"stream-sfm ({'|'.join(COMMANDS)})", text) for text in HINTED_COMMANDS.values())


def test_json_is_one_object_and_nothing_else_and_tables_say_what_matters(wall_log, tmp_path, cli):
    (tmp_path / "c.toml").write_text("[window]\nframes = 5\n")
    settings = ["--config", tmp_path / "c.toml", "--set", "rules.robust.min_inliers=9", *FAST]
    summary = cli("replay", wall_log, "--out", tmp_path / "o", "--json", *settings).json
    assert summary["complete"] is True and summary["frames"]["estimated"] == 12
    assert summary["out"] == str(tmp_path / "o") and summary["method"] == "frame-to-frame"
    used = read_config(tmp_path / "o" / "config.toml")
    assert (used.window.frames, used.rules.of(RobustRules).min_inliers, used.method) == (5, 9, "frame-to-frame")
    said = cli("replay", wall_log, "--out", tmp_path / "o", "-v", *FAST)
    assert "12 estimated of 12 paired" in said.out and "final drift" in said.out
    assert "frame 0: initialising" in said.err and "frame 1: ok" in said.err


def test_a_cut_log_is_3_with_everything_written(wall_log, tmp_path, cli):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(wall_log.read_bytes()[: wall_log.stat().st_size * 2 // 3])
    said = cli("replay", cut, "--out", tmp_path / "o", "--json", *FAST, code=3)
    frames = said.json["frames"]["estimated"]
    assert said.json["complete"] is False and 7 <= frames <= 9  # two thirds of twelve
    assert "warning: " in said.err and "MB" in said.err
    assert len(np.loadtxt(tmp_path / "o" / "trajectory.kitti")) == frames


def test_strict_makes_a_warning_count(tmp_path, cli):
    log = write_wall_log(tmp_path / "gap.mcap", n=8, without_right=(2, 3, 4))
    cli("replay", log, "--out", tmp_path / "o", *FAST)
    cli("replay", log, "--out", tmp_path / "o", *FAST, "--strict", code=3)


def test_without_out_a_folder_of_its_own_and_latest_points_to_it(wall_log, tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    assert cli("replay", wall_log, "--max-frames", "2", "-q", *FAST) == ("", ""), "quiet is quiet"
    (folder,) = [p for p in Path("runs").iterdir() if not p.is_symlink()]
    assert folder.name.startswith("wall-") and Path("runs/latest").resolve() == folder.resolve()
    assert (folder / "summary.json").exists()


@pytest.mark.parametrize("extent", [[], ["--expert"]])
def test_config_prints_what_config_takes(extent, tmp_path, cli):
    printed = cli("config", *extent, "--set", "window.frames=5", "--set", "frontend.smoothing_px=2.0").out
    (tmp_path / "c.toml").write_text(printed)
    expected = Config(window=WindowConfig(frames=5), frontend=FrontendConfig(smoothing_px=2.0))
    assert read_config(tmp_path / "c.toml") == expected


def test_interrupted_is_130_with_everything_written(tmp_path):
    log = write_wall_log(tmp_path / "long.mcap", n=16, times=30, truth=False)
    out = tmp_path / "out"
    command = [sys.executable, "-m", "stream_sfm", "replay", str(log), "--out", str(out), "--json", *FAST]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not (out / "trajectory.tum.part").exists():
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        said, errors = process.communicate()
    assert process.returncode == 130 and "Traceback" not in errors, errors
    summary = json.loads(said)
    assert summary["complete"] is False
    assert len(np.loadtxt(out / "trajectory.tum", ndmin=2)) == summary["frames"]["estimated"] > 0


@pytest.mark.parametrize("command, streams", [("config", ">&3"), ("replay {log} -v --out {out}", ">&3 2>&3")])
def test_the_reader_of_our_output_may_go(command, streams, wall_log, tmp_path):
    """A pipe whose reader has gone before anything is printed: nothing is said about it, and the run is not ended."""
    ours = f"'{sys.executable}' -m stream_sfm {command.format(log=wall_log, out=tmp_path)} {streams}"
    script = f"( sleep 0.2; {ours}; echo code $? ) 3> >(true)"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=1800)
    assert done.stdout.endswith("code 0\n") and "Traceback" not in done.stderr + done.stdout
    assert command == "config" or len(np.loadtxt(tmp_path / "trajectory.tum")) == 12


@pytest.mark.parametrize(
    "streams, code, says",
    [(">/dev/full", 3, "stream-sfm: cannot write the standard output: No space left on device\n"), (">&-", 0, "")],
)
def test_an_output_that_takes_nothing_is_no_defect(streams, code, says, wall_log):
    ours = f"'{sys.executable}' -m stream_sfm inspect {wall_log} {streams}"
    done = subprocess.run(["bash", "-c", ours], capture_output=True, text=True, timeout=1800)
    assert (done.returncode, done.stderr) == (code, says)


def test_settings_are_printed_without_docstrings_too():
    done = subprocess.run([sys.executable, "-OO", "-m", "stream_sfm", "config"], capture_output=True, text=True)
    assert done.returncode == 0 and "\n[window]" in done.stdout


def test_the_program_is_called_stream_sfm(cli):
    assert cli("--version").out.startswith("stream-sfm ")
