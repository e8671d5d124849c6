"""Calibrations of other tools become TOML that gives the same rig."""

from pathlib import Path

import numpy as np

from stream_sfm import StereoRig
from tests.helpers.data_sets import RIGHT_FROM_LEFT, write_euroc, write_kitti


def test_a_calibration_is_converted(tmp_path: Path, cli) -> None:
    write_euroc(tmp_path / "MH")
    out = tmp_path / "rig.toml"
    assert "baseline 0.11" in cli("convert-calibration", tmp_path / "MH", "--out", out).out
    np.testing.assert_allclose(StereoRig.from_calibration(out).right_from_left, RIGHT_FROM_LEFT, atol=1e-9)
    sensors = [str(tmp_path / "MH" / "mav0" / cam / "sensor.yaml") for cam in ("cam0", "cam1")]
    again = tmp_path / "again.toml"
    assert cli("convert-calibration", *sensors, "--out", again, "--json").json["width"] == 64
    assert again.read_bytes() == out.read_bytes()


def test_the_size_is_given_where_the_format_has_none(tmp_path: Path, cli) -> None:
    write_kitti(tmp_path / "00")
    command = ["convert-calibration", str(tmp_path / "00" / "calib.txt"), "--out", str(tmp_path / "rig.toml")]
    assert "does not tell the size of the images" in cli(*command, code=2).err
    assert "write it as 1241x376" in cli(*command, "--size", "64 by 48", code=2).err
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
