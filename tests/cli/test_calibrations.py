"""Calibrations on the command line: of other tools as TOML, and the files of left and right wherever they stand."""

from pathlib import Path

import numpy as np
import pytest

from stream_sfm import StereoRig, open_log
from stream_sfm.cli.app import build_app
from stream_sfm.cli.usage import rewritten
from tests.helpers.data_sets import RIGHT_FROM_LEFT, write_euroc, write_kitti


def test_two_files_are_converted_as_their_folder_is_and_import_takes_them(tmp_path: Path, cli) -> None:
    write_euroc(tmp_path / "MH")
    out, again, log = (tmp_path / name for name in ("rig.toml", "again.toml", "o.mcap"))
    assert "baseline 0.11" in cli("convert-calibration", tmp_path / "MH", "--out", out).out
    np.testing.assert_allclose(StereoRig.from_calibration(out).right_from_left, RIGHT_FROM_LEFT, atol=1e-9)
    sensors = [tmp_path / "MH" / "mav0" / cam / "sensor.yaml" for cam in ("cam0", "cam1")]
    assert cli("convert-calibration", *sensors, "--out", again, "--json").json["width"] == 64
    assert again.read_bytes() == out.read_bytes()
    left, right = (sensor.parent / "data" for sensor in sensors)
    cli("import", "images", "--left", left, "--right", right, "--calibration", *sensors, log)
    np.testing.assert_allclose(open_log(log).stereo_rig.right_from_left, RIGHT_FROM_LEFT, atol=1e-9)
    sensors[0] = tmp_path / "nowhere.yaml"
    assert "cannot read calibration" in cli("inspect", log, "--calibration", *sensors, code=2).err


def test_the_size_is_given_where_the_format_has_none(tmp_path: Path, cli) -> None:
    write_kitti(tmp_path / "00")
    command = ["convert-calibration", str(tmp_path / "00" / "calib.txt"), "--out", str(tmp_path / "rig.toml")]
    assert "does not contain the size of the images" in cli(*command, code=2).err
    assert "give width and height in pixels, such as 640x480" in cli(*command, "--size", "64 by 48", code=2).err
    cli(*command, "--size", "64x48")
    rig = StereoRig.from_calibration(tmp_path / "rig.toml")
    assert (rig.left.width, rig.left.height) == (64, 48)


def test_what_cannot_be_right_is_said_and_still_converted(tmp_path: Path, cli) -> None:
    """So that it can be corrected in the file that was written."""
    matrix = "[[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]]"
    camera = f"width = 320\nheight = 240\nK = {matrix}\n"
    for x, says in ((-110.0, "are these millimetres?"), (0.11, "exchange left and right"), (-0.11, "")):
        given = tmp_path / "given.toml"
        pose = f"[right_from_left]\ntranslation_m = [{x}, 0, 0]\n"
        given.write_text(f"[left]\n{camera}[right]\n{camera}{pose}")
        errors = cli("convert-calibration", given, "--out", tmp_path / "out.toml").err
        assert says in errors and bool(says) == bool(errors)
        assert f"[{x}, 0.0, 0.0]" in (tmp_path / "out.toml").read_text()


def test_the_input_is_never_overwritten(tmp_path: Path, cli) -> None:
    write_kitti(tmp_path / "00")
    path = tmp_path / "00" / "calib.txt"
    before = path.read_bytes()
    said = cli("convert-calibration", path, "--out", path, "--size", "64x48", code=3)
    assert "it is an input of this run" in said.err and path.read_bytes() == before


@pytest.mark.parametrize(
    "arguments, calibration",
    [
        (["LOG", "--calibration", "l.yaml", "r.yaml"], ["l.yaml", "r.yaml"]),
        (["LOG", "--calibration", "l.yaml", "--calibration", "r.yaml"], ["l.yaml", "r.yaml"]),
        (["--calibration", "l.yaml", "r.yaml", "LOG"], ["l.yaml", "r.yaml"]),
        (["--calibration", "l.yaml", "LOG"], "l.yaml"),
        (["--calibration", "c.toml", "log.mcap", "-q"], "c.toml"),
        (["--calibration=l.yaml", "LOG"], "l.yaml"),
        (["LOG", "--calibration", "folder", "-q"], "folder"),
    ],
)
def test_the_log_stays_the_log(arguments: list[str], calibration: object) -> None:
    _, bound, _ = build_app().parse_args(rewritten(["replay", *arguments]))
    assert bound.args[0] in ("LOG", "log.mcap")
    assert bound.kwargs["cameras"].chosen["calibration"] == calibration
