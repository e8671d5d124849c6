"""Data sets in the manner of KITTI: KITTI-360 and Virtual KITTI 2."""

from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.logs.importers import import_kitti, recover
from tests.helpers.data_sets import (
    HEIGHT,
    KITTI_K,
    RNG,
    WIDTH,
    kitti_projection,
    numbers,
    write_euroc,
    write_image_folders,
    write_kitti,
)


def test_kitti_360(tmp_path: Path) -> None:
    """Rectified images in data_rect; the calibration is beside the folder of all drives."""
    drive = tmp_path / "data_2d_raw/2013_05_28_drive_0000_sync"
    write_image_folders(drive, ["0000000000.png", "0000000001.png"], ("image_00/data_rect", "image_01/data_rect"))
    for n in (0, 1):
        text = "2013-05-28 08:46:02.904204000\n2013-05-28 08:46:03.006889000\n"
        (drive / f"image_0{n}/timestamps.txt").write_text(text)
    (tmp_path / "calibration").mkdir()
    size, d = f"{WIDTH} {HEIGHT}", numbers(np.array([-0.3, 0.1, 0, 0, 0]))
    rows = [
        f"S_0{n}: {size}\nK_0{n}: {numbers(KITTI_K)}\nD_0{n}: {d}\nR_0{n}: {numbers(np.eye(3))}\nT_0{n}: 0 0 0\n"
        f"S_rect_0{n}: {size}\nR_rect_0{n}: {numbers(np.eye(3))}\nP_rect_0{n}: {kitti_projection((x, 0, 0))}\n"
        for n, x in ((0, 0.0), (1, -0.594))
    ]
    (tmp_path / "calibration/perspective.txt").write_text("calib_time: 09-Jan-2012\n" + "".join(rows))
    log = sfm.open_log(tmp_path)
    assert log.stereo_rig.baseline_m == pytest.approx(0.594) and log.rig.left.distortion_model == "none"
    stamps = [pair.stamp_ns for pair in log.pairs()]
    assert stamps == [1369730762904204000, 1369730763006889000]


def test_virtual_kitti_2(tmp_path: Path) -> None:
    """Parallel cameras 0.532725 m apart; poses are camera from world, of each camera in its own line."""
    variant, names = tmp_path / "Scene01/clone", [f"rgb_{n:05d}.png" for n in range(3)]
    write_image_folders(variant, names, ("frames/rgb/Camera_0", "frames/rgb/Camera_1"))
    lines = [f"{n} {side} 725.0 724.0 32.5 24.5" for n in range(3) for side in (0, 1)]
    (variant / "intrinsic.txt").write_text("\n".join(["frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]", *lines]))
    poses = se3.exp(RNG.normal(size=(3, 6)) * 0.2)
    lines = [
        f"{n} {side} {numbers(pose if side == 0 else np.eye(4))}" for n, pose in enumerate(poses) for side in (0, 1)
    ]
    (variant / "extrinsic.txt").write_text("\n".join(["frame cameraID r1,1 r1,2 …", *lines]))
    log = sfm.open_log(tmp_path)
    assert log.stereo_rig.baseline_m == pytest.approx(0.532725)
    assert log.rig.left.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist() == [725.0, 724.0, 32.5, 24.5]
    truth = log.ground_truth()
    assert truth is not None and len(list(log.pairs())) == 3
    np.testing.assert_allclose(truth.world_from_cam, se3.inverse(poses), atol=1e-9)
    (variant / "intrinsic.txt").write_text("frame cameraID\n0 0 a b c d\n")
    with pytest.raises(sfm.LogError, match="no line `frame cameraID fx fy cx cy`"):
        sfm.open_log(tmp_path)


def test_a_data_set_brings_the_errors_of_its_ground_truth(tmp_path: Path) -> None:
    write_kitti(tmp_path / "06")
    write_euroc(tmp_path / "mh")
    assert sfm.open_log(tmp_path / "06").std_truth == (0.02, 0.0045)
    assert sfm.open_log(tmp_path / "mh").std_truth == (0.001, 0.002)
    import_kitti(tmp_path / "06", tmp_path / "06.mcap")
    recover(tmp_path / "06.mcap", tmp_path / "copy.mcap")
    for copy in ("06.mcap", "copy.mcap"):  # a log carries them
        assert sfm.open_log(tmp_path / copy).std_truth == (0.02, 0.0045)
    given = sfm.Trajectory(np.zeros(1, np.int64), np.eye(4)[None])
    assert sfm.open_log(tmp_path / "06", ground_truth=given).std_truth == (0, 0)  # it is another truth
