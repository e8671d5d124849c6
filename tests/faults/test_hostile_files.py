"""Endless files, texts that crash parsers, and numbers beyond all types: each gives a sentence and an exit code."""

import contextlib
import os
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.camera.calibration.document import load
from stream_sfm.logs.sources.pose_files import read_tum
from stream_sfm.system.inputs import check_text, check_values, open_regular
from tests.helpers.stereo_logs import write_log
from tests.helpers.wall import rig

MANY = 100_000


def make_odd(kind: str, odd: Path) -> None:
    """What is no file that can be read: special, a folder, a link to nothing or to itself, noise."""
    if kind == "a pipe":
        os.mkfifo(odd)
    elif kind == "a socket":
        with socket.socket(socket.AF_UNIX) as s, contextlib.chdir(odd.parent):  # names of sockets are short
            s.bind(odd.name)
    elif kind == "a folder":
        (odd / "sub").mkdir(parents=True)
    elif kind == "noise":
        odd.write_bytes(np.random.default_rng(0).bytes(5000))
    else:
        odd.symlink_to({"a device": Path("/dev/zero"), "a loop": odd, "a dangling link": odd.parent / "none"}[kind])


SPECIAL = ("a pipe", "a socket", "a device")
# Commands that would read {odd}, and what the error says of a special file.
READING: list[tuple[str, int, str]] = [
    *((f"{words}", 3, "it is {kind}: give a file") for words in (
        "replay {odd} --out {d}/out", "inspect {odd}", "surface {odd} --out {d}/o.ply", "recover {odd} {d}/r.mcap",
        "batch {odd} --out {d}/out", "replay {log} --ground-truth {odd} --out {d}/out",
    )),
    *((f"{words}", 2, "it is {kind}: give a file") for words in (
        "replay {log} --config {odd} --out {d}/out", "replay {log} --calibration {odd} --out {d}/out",
        "convert-calibration {odd} --out {d}/c.toml",
        "import images --left {odd} --right {odd} --calibration {odd} {d}/i.mcap",
    )),
    ("import kitti {odd} {d}/i.mcap", 3, "is not laid out like KITTI"),
    ("import euroc {odd} {d}/i.mcap", 3, "is not laid out like EuRoC"),
]  # fmt: skip


@pytest.mark.parametrize("kind", [*SPECIAL, "a folder", "a dangling link", "a loop", "noise"])
def test_special_files_are_not_read(kind, tmp_path, cli):
    odd, log = tmp_path / "odd", write_log(tmp_path / "log.mcap")
    make_odd(kind, odd)
    for words, code, says in READING:
        given = words.format(odd=odd, log=log, d=tmp_path).split()
        if kind in SPECIAL:
            assert says.format(kind=kind) in cli(*given, code=code).err, words
        else:
            assert str(odd) in cli(*given, code=(2, 3)).err, words
        assert not list(tmp_path.rglob("estimates*"))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("replay {log} --out {odd}", "cannot make the folder"),
        ("replay {log} --out {d}/out --rrd {odd}", "it is a device, pipe or socket; choose another name"),
        ("surface {log} --out {odd}", "the name must end in .ply"),
        ("recover {log} {odd}", "exists already"),
    ],
)
def test_nothing_is_written_to_a_special_file(words, says, tmp_path, cli):
    log = write_log(tmp_path / "log.mcap")
    for kind in SPECIAL:
        make_odd(kind, odd := tmp_path / kind.replace(" ", "_"))
        before = odd.lstat()
        assert says in cli(*words.format(odd=odd, log=log, d=tmp_path).split(), code=(2, 3)).err
        assert odd.lstat().st_ino == before.st_ino and odd.lstat().st_mode == before.st_mode


@pytest.mark.parametrize(("path", "says"), [("-", "standard input is not read: give a file"), ("a\0b", "NUL")])
def test_names_of_no_file(path, says):
    with pytest.raises(sfm.LogError, match=says):
        sfm.open_log(path)
    with pytest.raises(OSError, match=says):
        open_regular(path)


HOSTILE: dict[str, Callable[[], str]] = {
    "arrays in arrays": lambda: "x = " + "[" * MANY,
    "tables in tables": lambda: "x = " + "{a = " * MANY,
    "a key of many parts": lambda: ".".join("a" * 30_000) + " = 1",  # took 12 s and 3.9 GB
    "a quoted key of many parts": lambda: ".".join(['"a"'] * 20_000) + " = 1",
    "an integer of many digits": lambda: "x = " + "9" * 10_000,
    "an integer of many hexadecimal digits": lambda: "x = 0x" + "f" * 10_000,
    "a whole number beyond 64 bits": lambda: "x = 9223372036854775808",
    "bytes that are not text": lambda: "x = \udcff",
    "a comment of megabytes": lambda: "#" * 2**24,
}


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("option", ["--config", "--calibration"])
def test_hostile_toml_is_refused(name, option, tmp_path, cli):
    (tmp_path / "x.toml").write_bytes(HOSTILE[name]().encode("utf-8", "surrogateescape"))
    log = write_log(tmp_path / "log.mcap")
    error = cli("replay", log, option, tmp_path / "x.toml", "--out", tmp_path / "out", code=2).err
    assert "x.toml" in error and ("is not TOML: " in error or "it is larger" in error) and len(error) < 500


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
def test_hostile_calibrations_are_refused(name):
    with pytest.raises(sfm.ConfigError, match=r"calibration c\.yaml") as refused:
        load(NO_CALIBRATION[name].encode(), "c.yaml")
    assert len(str(refused.value)) < 500  # a sentence, not the file


def test_keys_that_are_no_names_are_passed_over(tmp_path):
    (tmp_path / "c.yaml").write_text("1: 2\nnull: 3\n2.5: 4\n")
    with pytest.raises(sfm.ConfigError, match="its keys are of no known format"):
        sfm.StereoRig.from_calibration(tmp_path / "c.yaml")


def test_texts_that_people_write_pass():
    check_text(rig().to_toml())
    check_text("a:\n" + " " * 12 + "- [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]\n" + "# ... and so on ...\n")
    check_values({"K": [[1.0, 2, 3]] * 3, "n": -(2**63)})


@pytest.mark.parametrize(
    ("size", "f_px", "says"),
    [
        ((999_000, 32), 300, "camera size"),
        ((640, 2**40), 300, "camera size"),
        ((4096, 3052), 300, r"at most 12\.5 megapixels; reduce larger images"),
        ((640, 480), 1e30, "camera matrix K"),
    ],
)
def test_impossible_cameras_are_refused(size, f_px, says, tmp_path):
    camera = f"width = {size[0]}\nheight = {size[1]}\nfx = {f_px}\nfy = {f_px}\ncx = 320\ncy = 240\n"
    text = f"[left]\n{camera}[right]\n{camera}[right_from_left]\ntranslation_m = [-0.1, 0, 0]\n"
    (tmp_path / "c.toml").write_text(text)
    with pytest.raises(sfm.ConfigError, match=says):
        sfm.StereoRig.from_calibration(tmp_path / "c.toml")


@pytest.mark.parametrize("length", [300, 5000])
def test_names_that_no_file_can_have(length, tmp_path, cli):
    log, name = write_log(tmp_path / "log.mcap"), tmp_path / ("x" * length)
    outputs = ("batch {log} --out {odd}", "replay {log} --out {odd}", "surface {log} --out {odd}.ply",
               "replay {log} --rrd {odd}.rrd --out {d}/out")  # fmt: skip
    for words in (*(words for words, _, _ in READING), *outputs):
        cli(*words.format(odd=name, log=log, d=tmp_path).split(), code=(2, 3))


@pytest.mark.parametrize("stamp", [2**63, -(2**63) - 1, 10**300])
def test_frames_of_stamps_beyond_64_bits_are_refused(stamp):
    image = np.zeros((rig().left.height, rig().left.width), np.uint8)
    with pytest.raises(sfm.FrameError, match="64 bits"):
        sfm.Engine(rig()).step(sfm.StereoFrame(stamp, image, image))


@pytest.mark.parametrize(
    "text", ["1e999999999", "-1e99999", "9" * 4000, "nan", "inf", "9223372036854775808", "9223372036.854775808"]
)
def test_times_beyond_64_bits_are_refused(text, tmp_path):
    (tmp_path / "t.tum").write_text(f"{text} 0 0 0 0 0 0 1\n")
    with pytest.raises(sfm.LogError, match=r"line 1: .* is not a time"):
        read_tum(tmp_path / "t.tum")
