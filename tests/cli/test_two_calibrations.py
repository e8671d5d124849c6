"""`--calibration` takes the files of left and right, wherever it stands, and never the log."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.cli.main import build_app, main
from stream_sfm.cli.usage import rewritten
from stream_sfm.mcap_file.damage import Damage
from stream_sfm.mcap_file.log_file import LogFile
from tests.helpers.places import ROOM


def ros_yaml(camera: sfm.Camera, shift: float) -> str:
    """camera_info of one of a parallel pair as ROS's camera_calibration writes it; `shift` is P[0, 3]."""
    (fx, _, cx), (_, fy, cy) = camera.K[:2].tolist()
    return f"""image_width: {camera.width}
image_height: {camera.height}
camera_name: camera
camera_matrix: {{rows: 3, cols: 3, data: [{fx}, 0, {cx}, 0, {fy}, {cy}, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [{fx}, 0, {cx}, {shift}, 0, {fy}, {cy}, 0, 0, 0, 1, 0]}}
"""


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    rig = sfm.open_log(ROOM).stereo_rig
    for name, camera, shift in (("l", rig.left, 0.0), ("r", rig.right, -float(rig.right.K[0, 0]) * rig.baseline_m)):
        (tmp_path / f"{name}.yaml").write_text(ros_yaml(camera, shift))
    return [str(tmp_path / "l.yaml"), str(tmp_path / "r.yaml")]


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
    assert bound.kwargs["cameras"].chosen[2] == calibration


def test_three_are_refused(cli) -> None:
    said = cli("replay", "LOG", *(3 * ["--calibration", "a.yaml"]), code=2)
    assert "give one file, or two: left and right" in said.err


def test_a_pair_of_camera_info_files_is_the_calibration(files: list[str], tmp_path: Path, cli) -> None:
    out = tmp_path / "out"
    command = ["replay", str(ROOM), "--calibration", *files, "--max-frames", "3", "--out", str(out), "-q"]
    main(command)  # the room's cameras converge and those of the files do not, which it may say
    used = next(a for a in LogFile(out / "estimates.mcap").attachments(Damage()) if a.name == "calibration.toml")
    rig = sfm.StereoRig.parse_calibration(used.data, "used")
    assert abs(rig.right_from_left[:3, :3] - np.eye(3)).max() < 1e-9
    # P has the digits of a float in text
    assert rig.baseline_m == pytest.approx(sfm.open_log(ROOM).stereo_rig.baseline_m, rel=1e-6)
    files[0] = files[0].replace("l.yaml", "nowhere.yaml")
    assert "cannot read calibration" in cli("inspect", ROOM, "--calibration", *files, code=2).err


def test_a_pair_is_the_calibration_of_imported_images(files: list[str], tmp_path: Path, cli) -> None:
    for frame in sfm.open_log(ROOM).frames(sfm.Selection(max_frames=2)):
        for side, image in zip("lr", frame.images, strict=True):
            (tmp_path / side).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / side / f"{frame.stamp_ns}.png"), image)
    out = tmp_path / "o.mcap"
    images = ["--left", str(tmp_path / "l"), "--right", str(tmp_path / "r")]
    cli("import", "images", *images, "--calibration", *files, out)
    rig = sfm.open_log(ROOM).stereo_rig
    assert sfm.open_log(out).stereo_rig.baseline_m == pytest.approx(rig.baseline_m, rel=1e-6)  # as in the file
