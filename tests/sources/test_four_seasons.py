"""Recordings of 4Seasons: the calibration of its rectified images, scaled poses, the inertial unit, and its cures."""

from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from tests.helpers.data_sets import (
    EUROC_CAMERA,
    HEIGHT,
    RIGHT_FROM_LEFT,
    RNG,
    WIDTH,
    kalibr,
    numbers,
    write_image_folders,
)

STAMPS_NS = [1586247720000000000 + n * 33_333_333 for n in range(4)]
CAM_FROM_IMU = se3.from_rotation_translation(
    se3.matrix_from_quat_xyzw(np.array([-0.007202, 0.708623, -0.705546, -0.002350])),
    [0.175412, 0.003689, -0.058106],
)


def write_four_seasons(root: Path) -> np.ndarray:
    """A recording and, beside it, the calibration; returns the poses of its last three frames, which are key frames."""
    recording, calibration = root / "recording_2020-04-07_10-20-32", root / "calibration"
    names = [f"{stamp}.png" for stamp in STAMPS_NS]
    write_image_folders(recording, names, ("undistorted_images/cam0", "undistorted_images/cam1"))
    (recording / "times.txt").write_text("".join(f"{s} {s / 1e9:.9f} 4.1\n" for s in STAMPS_NS))
    poses = se3.exp(RNG.normal(size=(3, 6)))
    rows = [
        f"{stamp},{','.join(map(repr, (pose[:3, 3] / 1.25).tolist()))},"
        f"{','.join(map(repr, se3.quat_xyzw_from_matrix(pose[:3, :3]).tolist()))},1.25,2"
        for stamp, pose in zip(STAMPS_NS[1:], poses, strict=True)
    ]
    header = "# frame_id, t_x, t_y, t_z, q_x, q_y, q_z, w, scale, fusion_quality"
    (recording / "GNSSPoses.txt").write_text("\n".join([header, *rows, ""]))
    (recording / "imu.txt").write_text("".join(f"{STAMPS_NS[0] + n * 500_000} 0 0.1 0 0 0 9.81\n" for n in range(200)))
    (recording / "Transformations.txt").write_text(
        "# transform_S_AS: translation vector, rotation quaternion\n0,0,0,0,0,0,1\n\n"
        "# TS_cam_imu: translation vector, rotation quaternion\n"
        "0.175412,0.003689,-0.058106,-0.007202,0.708623,-0.705546,-0.002350\n"
    )
    calibration.mkdir()
    for n in (0, 1):
        text = f"Pinhole 60.5 60.5 31.8 20.7 0.0 0.0 0.0 0.0\n{WIDTH} {HEIGHT}\ncrop\n{WIDTH} {HEIGHT}\n"
        (calibration / f"undistorted_calib_{n}.txt").write_text(text)
    pose = np.eye(4)
    pose[0, 3] = -0.3004961618953472
    (calibration / "undistorted_calib_stereo.txt").write_text("\n".join(map(numbers, pose)) + "\n")
    # that of the raw images, which have the same size
    (calibration / "camchain.yaml").write_text(kalibr((EUROC_CAMERA, EUROC_CAMERA), RIGHT_FROM_LEFT))
    return poses


def test_the_calibration_is_that_of_the_rectified_images(tmp_path: Path) -> None:
    poses = write_four_seasons(tmp_path)
    for path in (tmp_path, tmp_path / "recording_2020-04-07_10-20-32"):
        log = sfm.open_log(path)
        assert log.stereo_rig.baseline_m == pytest.approx(0.3004961618953472)
        assert log.rig.left.K.tolist() == [[60.5, 0, 31.8], [0, 60.5, 20.7], [0, 0, 1]]
        assert log.rig.right_from_left[0, 3] < 0 and log.rig.left.distortion_model == "none"
        assert [pair.stamp_ns for pair in log.pairs()] == STAMPS_NS
        truth = log.ground_truth()
        assert truth is not None and truth.stamps_ns.tolist() == STAMPS_NS[1:]
        np.testing.assert_allclose(truth.world_from_cam, poses, atol=1e-9)
    unit = log.stereo_rig.imu
    assert unit is not None
    np.testing.assert_allclose(unit.cam_from_imu, CAM_FROM_IMU, atol=1e-6)
    assert sfm.inspect(tmp_path)["format"] == "4Seasons"


def test_a_calibration_that_is_not_there_or_is_another(tmp_path: Path) -> None:
    write_four_seasons(tmp_path)
    recording, calibration = tmp_path / "recording_2020-04-07_10-20-32", tmp_path / "calibration"
    (calibration / "undistorted_calib_1.txt").write_text("Equidistant 60 60 30 20 0.1 0 0 0\n64 48\n")
    with pytest.raises(sfm.ConfigError, match=r"undistorted_calib_1\.txt is not `Pinhole"):
        sfm.open_log(recording)
    (calibration / "undistorted_calib_stereo.txt").write_text("1 0 0\n0 1 0\n")
    with pytest.raises(sfm.ConfigError, match="undistorted_calib"):
        sfm.open_log(recording)
    (calibration / "undistorted_calib_stereo.txt").unlink()
    with pytest.raises(sfm.ConfigError, match="unpack that of the data set there"):
        sfm.open_log(recording)
    log = sfm.open_log(recording, calibration=calibration / "camchain.yaml")
    assert log.rig.left.D == EUROC_CAMERA.D and log.ground_truth() is not None


def test_an_inertial_unit_without_a_mounting_is_not_used(tmp_path: Path) -> None:
    write_four_seasons(tmp_path)
    (tmp_path / "recording_2020-04-07_10-20-32/Transformations.txt").write_text("# GNSS scale\n0.97\n")
    log = sfm.open_log(tmp_path)
    list(log.pairs())
    assert log.stereo_rig.imu is None
    assert any("the IMU is not used" in warning for warning in log.stats.warnings)
