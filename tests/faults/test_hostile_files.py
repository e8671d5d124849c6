"""Files that never end, texts that end a parser, and numbers that nothing holds: a sentence and an exit code each."""

import os
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.camera.calibration.document import load
from stream_sfm.cli.main import main
from stream_sfm.inputs import check_text, check_values, open_regular, read_small
from stream_sfm.results.trajectory_files import read_tum
from stream_sfm.sources.text_files import stamp_ns
from tests.helpers.stereo_logs import write_log
from tests.helpers.wall import rig

MANY = 100_000


@pytest.fixture(autouse=True)
def _deadline() -> Iterator[None]:
    """What hangs fails."""

    def late(*_: Any) -> None:
        raise TimeoutError("this hangs")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def special_file(kind: str, folder: Path) -> Path:
    path = folder / "odd"
    if kind == "a pipe":
        os.mkfifo(path)
    elif kind == "a socket":
        with socket.socket(socket.AF_UNIX) as s:
            before = Path.cwd()
            os.chdir(folder)  # names of sockets are short
            s.bind("odd")
            os.chdir(before)
    else:
        path = Path("/dev/zero")
    return path


def said(arguments: list[Any], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    code = main([str(word) for word in arguments])
    error = capsys.readouterr().err
    assert "Traceback" not in error and "defect" not in error, error
    return code, error


@pytest.mark.parametrize("kind", ["a pipe", "a socket", "a device"])
def test_only_regular_files_are_read(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    odd, log, out = special_file(kind, tmp_path), write_log(tmp_path / "log.mcap"), tmp_path / "out"
    for arguments, expected in (
        (["replay", odd, "--out", out], 3),
        (["inspect", odd], 3),
        (["replay", log, "--config", odd, "--out", out], 2),
        (["replay", log, "--calibration", odd, "--out", out], 2),
        (["batch", odd, "--out", out], 3),
    ):
        code, error = said(arguments, capsys)
        assert code == expected and f"it is {kind}: give a file" in error, arguments
        assert not list(out.glob("*/estimates*"))


def test_standard_input_is_not_a_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, error = said(["replay", "-", "--out", tmp_path / "out"], capsys)
    assert code == 2 and "standard input is not read: give a file" in error
    with pytest.raises(sfm.LogError, match="standard input is not read: give a file"):
        sfm.open_log("-")
    with pytest.raises(OSError, match="standard input is not read"):
        open_regular("-")


def test_a_pipe_in_the_folder_of_a_bag_does_not_hold_it_up(tmp_path: Path) -> None:
    write_log(tmp_path / "walk_0.mcap")
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  relative_file_paths:\n  - walk_0.mcap\n  - walk_1.mcap\n"
    )
    os.mkfifo(tmp_path / "walk_1.mcap")
    log = sfm.open_log(tmp_path)
    assert len(list(log.pairs())) > 1 and any("a pipe" in note for note in log.stats.warnings)


def test_small_files_are_read_up_to_their_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "large.toml").write_bytes(b"#" * 2**24)
    with pytest.raises(OSError, match="larger than 1048576 bytes"):
        read_small(tmp_path / "large.toml", 2**20)
    for option in ("--config", "--calibration"):
        code, error = said(["replay", write_log(tmp_path / "log.mcap"), option, tmp_path / "large.toml"], capsys)
        assert code == 2 and "larger than" in error


HOSTILE: dict[str, Callable[[], str]] = {
    "arrays in arrays": lambda: "x = " + "[" * MANY,
    "tables in tables": lambda: "x = " + "{a = " * MANY,
    "a key of many parts": lambda: ".".join("a" * 30_000) + " = 1",  # took 12 s and 3.9 GB
    "a quoted key of many parts": lambda: ".".join(['"a"'] * 20_000) + " = 1",
    "an integer of many digits": lambda: "x = " + "9" * 10_000,
    "an integer of many hexadecimal digits": lambda: "x = 0x" + "f" * 10_000,
    "a whole number beyond 64 bits": lambda: "x = 9223372036854775808",
    "bytes that are not text": lambda: "x = \udcff",
}


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("option", ["--config", "--calibration"])
def test_hostile_toml_is_refused(
    name: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.toml").write_bytes(HOSTILE[name]().encode("utf-8", "surrogateescape"))
    log = write_log(tmp_path / "log.mcap")
    code, error = said(["replay", log, option, tmp_path / "x.toml", "--out", tmp_path / "out"], capsys)
    assert (
        code == 2
        and "x.toml" in error
        and ("is not TOML: " in error or "it is larger" in error)
        and len(error) < 500
    )


@pytest.mark.parametrize("text", ["x=" + "[" * 50_000, "window.frames=0x" + "f" * 9_000, "." * 100_000 + "=1"])
def test_hostile_settings_are_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert said(["config", "--set", text], capsys)[0] == 2


ALIASES = "a0: &a0 [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"a{n}: &a{n} [{','.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12)
)
NO_CALIBRATION = {
    "brackets": "a: " + "[" * MANY,
    "dashes": "- " * MANY + "1",
    "indents": "".join(" " * n + "a:\n" for n in range(700)),
    "aliases": "cam0: {intrinsics: *a11}\n".join([ALIASES, ""]),
    "merges": "a0: &a0 {b: 1}\n" + "".join(f"a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}]}}\n" for n in range(1, 40)),
    "digits": "a: " + "9" * 10_000,
    "empty lines": "x = " + "\n" * 500_000,  # took an hour
    "white lines": (" " * 130 + "\n") * 7_000,
    "dashes on white lines": ("- " * 20 + "\n\n") * 20_000,
    "OpenCV, brackets": "%YAML:1.0\n---\na: " + "[" * MANY,  # ended the process
    "OpenCV, maps": "%YAML:1.0\n---\na: " + "{a:" * MANY,
    "OpenCV, tags": '<?xml version="1.0"?><opencv_storage>' + "<a>" * MANY + "</opencv_storage>",
    "OpenCV, dashes": "%YAML:1.0\n---\na:\n" + "- " * MANY + "1\n",
    "OpenCV, gigabytes": "%YAML:1.0\n---\na: !!opencv-matrix\n   rows: 99999\n   cols: 99999\n   dt: d\n   data: [1]\n",
}


@pytest.mark.parametrize("name", NO_CALIBRATION)
def test_hostile_calibrations_are_refused(name: str) -> None:
    with pytest.raises(sfm.ConfigError, match=r"calibration c\.yaml") as refused:
        load(NO_CALIBRATION[name].encode(), "c.yaml")
    assert len(str(refused.value)) < 500


def test_keys_that_are_no_names_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("1: 2\nnull: 3\n2.5: 4\n")
    with pytest.raises(sfm.ConfigError, match="its keys are of no known format"):
        sfm.StereoRig.from_calibration(tmp_path / "c.yaml")


def test_what_people_write_passes() -> None:
    check_text(rig().to_toml())
    check_text("a:\n" + " " * 12 + "- [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]\n" + "# ... and so on ...\n")
    check_values({"K": [[1.0, 2, 3]] * 3, "n": -(2**63)})


@pytest.mark.parametrize(
    ("size", "f_px", "said_of"),
    [
        ((999_000, 32), 300, "camera size"),
        ((640, 2**40), 300, "camera size"),
        ((640, 480), 1e30, "camera matrix K"),
    ],
)
def test_impossible_cameras_are_refused(
    size: tuple[int, int], f_px: float, said_of: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = f"width = {size[0]}\nheight = {size[1]}\nfx = {f_px}\nfy = {f_px}\ncx = 320\ncy = 240\n"
    text = f"[left]\n{camera}[right]\n{camera}[right_from_left]\ntranslation_m = [-0.1, 0, 0]\n"
    (tmp_path / "c.toml").write_text(text)
    log = write_log(tmp_path / "log.mcap")
    code, error = said(["replay", log, "--calibration", tmp_path / "c.toml", "--out", tmp_path / "out"], capsys)
    assert code == 2 and said_of in error


@pytest.mark.parametrize("length", [300, 5000])
def test_names_that_no_file_can_have(length: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, name = write_log(tmp_path / "log.mcap"), tmp_path / ("x" * length)
    for arguments, expected in (
        (["replay", name], 3),
        (["inspect", name], 3),
        (["batch", name, "--out", tmp_path / "b"], 3),
        (["batch", log, "--out", name], 3),
        (["replay", log, "--config", name], 2),
        (["replay", log, "--calibration", name], 2),
        (["replay", log, "--out", name], 3),
        (["replay", log, "--rrd", f"{name}.rrd", "--out", tmp_path / "out"], 3),
        (["surface", log, "--out", f"{name}.ply"], 3),
        (["import", "images", "--left", name, "--right", name, "--calibration", name, f"{name}.mcap"], 2),
    ):
        assert said(arguments, capsys)[0] in (2, 3), (arguments[:2], expected)


def test_a_name_with_a_nul_is_no_file() -> None:
    with pytest.raises(OSError, match="NUL"):
        open_regular("a\0b")
    with pytest.raises(sfm.LogError, match="NUL"):
        sfm.open_log("a\0b")


@pytest.mark.parametrize("stamp", [2**63, -(2**63) - 1, 10**300])
def test_stamps_beyond_64_bits_are_refused(stamp: int, tmp_path: Path) -> None:
    engine = sfm.Engine(rig())
    image = np.zeros((rig().left.height, rig().left.width), np.uint8)
    with pytest.raises(sfm.FrameError, match="64 bits"):
        engine.step(sfm.StereoFrame(stamp, image, image))
    whole, ns = divmod(abs(stamp), 10**9)
    (tmp_path / "t.tum").write_text(f"{'-' * (stamp < 0)}{whole}.{ns:09d} 0 0 0 0 0 0 1\n")
    with pytest.raises(sfm.InputError, match="line 1"):
        read_tum(tmp_path / "t.tum")


@pytest.mark.parametrize("text", ["1e999999999", "-1e99999", "9" * 10_000, "nan", "inf", "9223372036854775808"])
def test_times_beyond_64_bits_are_refused(text: str) -> None:
    with pytest.raises(sfm.LogError, match="not a time"):
        stamp_ns(text, "times.txt, line 1")
