"""Data-set folders and folders of images open as they lie on disk, with the frames that an import of them has."""

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.importers.data_sets import import_euroc, import_kitti
from stream_sfm.inspection.overview import inspect_log
from tests.helpers.data_sets import (
    BODY_FROM_LEFT,
    EUROC_STAMPS_NS,
    RIGHT_FROM_LEFT,
    camera_pair,
    write_euroc,
    write_image_folders,
    write_kitti,
    write_kitti_raw,
    write_picture,
    write_tartanair,
    write_tum_vi,
)


def check_same(folder, imported):
    log, other = sfm.open_log(folder), sfm.open_log(imported)
    frames, expected = list(log.frames()), list(other.frames())
    assert [f.stamp_ns for f in frames] == [f.stamp_ns for f in expected] and len(frames) > 1
    for frame, one in zip(frames, expected, strict=True):
        np.testing.assert_array_equal(frame.left, one.left)
        np.testing.assert_array_equal(frame.right, one.right)
    np.testing.assert_array_equal(log.rig.right_from_left, other.rig.right_from_left)
    assert log.stats.complete and log.expected_frames == log.stats.left_read
    return log, other


@pytest.mark.parametrize("images", [("image_0", "image_1"), ("image_2", "image_3")])
def test_a_kitti_sequence(tmp_path, images):
    write_kitti(tmp_path / "00", images)
    import_kitti(tmp_path / "00", tmp_path / "00.mcap")
    log, other = check_same(tmp_path / "00", tmp_path / "00.mcap")
    np.testing.assert_array_equal(log.ground_truth().world_from_cam, other.ground_truth().world_from_cam)
    assert inspect_log(tmp_path / "00")["format"] == "KITTI odometry"


def test_an_euroc_recording(tmp_path):
    write_euroc(tmp_path / "MH")
    import_euroc(tmp_path / "MH", tmp_path / "mh.mcap")
    for folder in (tmp_path / "MH", tmp_path / "MH" / "mav0"):
        log, other = check_same(folder, tmp_path / "mh.mcap")
        np.testing.assert_array_equal(log.ground_truth().world_from_cam, other.ground_truth().world_from_cam)


def test_tum_vi_is_laid_out_like_euroc_with_one_calibration_for_all(tmp_path):
    world_from_body = write_tum_vi(tmp_path / "room1")
    log = sfm.open_log(tmp_path / "room1")
    np.testing.assert_allclose(log.rig.right_from_left, RIGHT_FROM_LEFT, atol=1e-9)
    assert log.rig.left.distortion_model == "equidistant" and len(list(log.frames())) == 2
    np.testing.assert_allclose(log.ground_truth().world_from_cam, world_from_body @ BODY_FROM_LEFT, atol=1e-9)


def test_euroc_without_any_calibration_takes_the_one_that_is_given(tmp_path):
    """And without tables, where the names are the stamps; as a sample of another system has it."""
    write_euroc(tmp_path / "MH")
    for camera in (tmp_path / "MH/mav0/cam0", tmp_path / "MH/mav0/cam1"):
        (camera / "sensor.yaml").unlink()
    with pytest.raises(sfm.LogError, match="calibration"):
        sfm.open_log(tmp_path / "MH")
    log = sfm.open_log(tmp_path / "MH", calibration=camera_pair())
    assert [f.stamp_ns for f in log.frames()] == EUROC_STAMPS_NS[:2] and log.ground_truth() is None
    assert any("is not used: no calibration says where the camera is on the body" in w for w in log.stats.warnings)
    (tmp_path / "MH/mav0/cam1/data.csv").unlink()
    again = sfm.open_log(tmp_path / "MH", calibration=camera_pair())
    assert [f.stamp_ns for f in again.frames()] == EUROC_STAMPS_NS[:2]


def test_a_drive_of_kittis_raw_data(tmp_path):
    drive = write_kitti_raw(tmp_path / "2011_09_26")
    log = sfm.open_log(drive)
    first_ns = 1317042145594360375  # 2011-09-26 13:02:25.594360375
    assert [f.stamp_ns - first_ns for f in log.frames()] == [0, 103_554_625, 207_139_625]
    assert log.rig.baseline_m == pytest.approx(0.54) and log.rig.left.K[0, 0] == 70
    assert inspect_log(drive)["format"] == "KITTI raw"
    (tmp_path / "2011_09_26/calib_cam_to_cam.txt").unlink()
    with pytest.raises(sfm.LogError, match=r"has no calib_cam_to_cam\.txt: it is a part of the data set"):
        import_kitti(drive, tmp_path / "o.mcap")


@pytest.mark.parametrize(
    "names",
    [
        ("image_left", "image_right", "pose_left.txt"),
        ("image_lcam_front", "image_rcam_front", "pose_lcam_front.txt"),
    ],
)
def test_a_trajectory_of_tartanair(tmp_path, names):
    expected = write_tartanair(tmp_path / "P001", names)
    log = sfm.open_log(tmp_path / "P001")
    assert (
        len(list(log.frames())) == 3 and log.rig.baseline_m == 0.25 and log.rig.left.K[0].tolist() == [320, 0, 32]
    )
    np.testing.assert_allclose(log.ground_truth().world_from_cam, expected, atol=1e-9)
    (tmp_path / "P001" / names[2]).write_text("0 0 0 0 0 0 1\n")
    with pytest.raises(sfm.LogError, match="has 1 poses for 3 images"):
        sfm.open_log(tmp_path / "P001")


@pytest.mark.parametrize(
    ("names", "stamps_ns"),
    [
        (("1403636579763555584", "1403636579813555456"), (1403636579763555584, 1403636579813555456)),
        (("1403636579.763555584", "1403636579.813555456"), (1403636579763555584, 1403636579813555456)),
        (("1403636579763555", "1403636579813555"), (1403636579763555000, 1403636579813555000)),
        (("1403636579763", "1403636579813"), (1403636579763000000, 1403636579813000000)),
        (("000001", "000002"), (0, 100_000_000)),
    ],
)
def test_names_that_are_times_are_the_stamps(tmp_path, names, stamps_ns):
    write_image_folders(tmp_path, [f"{name}.png" for name in names])
    log = sfm.open_log(tmp_path, calibration=camera_pair())
    assert tuple(f.stamp_ns for f in log.frames()) == stamps_ns
    assert [w for w in log.stats.warnings if "no stamps" in w] == (
        ["no stamps and no rate were given: frames are put 0.1 s apart"] if stamps_ns[0] == 0 else []
    )


def test_folders_of_images_without_a_calibration_ask_for_it(tmp_path):
    write_image_folders(tmp_path, ["1.png", "2.png"])
    with pytest.raises(sfm.LogError, match="has no calibration for topic /camera/left/image") as caught:
        sfm.open_log(tmp_path)
    assert caught.value.hint == ("calibration",)


def test_a_damaged_image_costs_its_frame_where_the_folder_is_read(tmp_path):
    write_kitti(tmp_path / "00")
    (tmp_path / "00/image_1/000001.png").write_bytes(b"no image")
    log = sfm.open_log(tmp_path / "00")
    assert len(list(log.frames())) == 2 and not log.stats.complete
    assert any("000001.png is not a PNG" in w for w in log.stats.warnings)


def test_the_missing_calibration_of_a_data_set_is_named(tmp_path):
    write_euroc(tmp_path / "MH")
    (tmp_path / "MH/mav0/cam1/sensor.yaml").unlink()
    with pytest.raises(sfm.ConfigError, match=r"cannot read calibration .*cam1/sensor\.yaml"):
        sfm.open_log(tmp_path / "MH")


def test_the_right_camera_is_where_the_calibration_puts_it(tmp_path):
    write_image_folders(tmp_path, ["1.png", "2.png"])
    rig = camera_pair(se3.exp([0.2, 0, 0, 0, 0, 0]))
    (tmp_path / "rig.toml").write_text(rig.to_toml())
    with pytest.raises(sfm.ConfigError, match="to the left of the left one") as caught:
        sfm.open_log(tmp_path)
    assert str(tmp_path) in str(caught.value)


def test_folders_called_as_those_of_euroc_may_hold_images_alone(tmp_path):
    for n in (1, 2):
        for side in ("cam0", "cam1"):
            write_picture(tmp_path / side / f"{n}.png")
    log = sfm.open_log(tmp_path, calibration=camera_pair())
    assert len(list(log.frames())) == 2


def test_a_folder_of_recordings_names_them(tmp_path, cli):
    for name in ("a", "b"):
        write_kitti(tmp_path / name)
    (tmp_path / "notes.txt").touch()
    with pytest.raises(sfm.LogError, match=r"give one of .*/a, .*/b$"):
        sfm.open_log(tmp_path)
    assert "stream-sfm batch DIR" in cli("inspect", tmp_path, code=3).err
