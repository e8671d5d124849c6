"""Data sets and folders of images open as they lie on disk, and their imports read back the same: bytes, rig, truth."""

from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.importers import Imported, import_euroc, import_kitti
from stream_sfm.recording.stereo_log import StereoLog
from tests.helpers.data_sets import (
    BODY_FROM_LEFT,
    EUROC_STAMPS_NS,
    RIGHT_FROM_LEFT,
    camera_pair,
    write_euroc,
    write_image_folders,
    write_kitti,
    write_kitti_raw,
    write_tartanair,
    write_tum_vi,
)


def check_both(
    folder: Path,
    imported: Imported,
    stamps_ns: list[int],
    files: tuple[str, str],
    right_from_left: np.ndarray,
    world_from_cam: np.ndarray,
) -> StereoLog:
    """The folder and the log made of it have these stamps, the bytes of these files, this rig and this ground truth."""
    for log in (sfm.open_log(folder), sfm.open_log(imported.path)):
        pairs = list(log.pairs())
        assert [p.stamp_ns for p in pairs] == stamps_ns and log.stats.complete
        assert log.expected_frames == log.stats.left_read == imported.left
        for n, pair in enumerate(pairs):
            for image, name, side in zip(pair.images, files, ("left", "right"), strict=True):
                assert image.data == (folder / name.format(n=n, stamp=pair.stamp_ns)).read_bytes()
                assert image.frame_id == f"{side}_camera_optical_frame"
        np.testing.assert_allclose(log.rig.right_from_left, right_from_left, atol=1e-9)
        np.testing.assert_allclose(log.ground_truth().world_from_cam, world_from_cam, atol=1e-9)
    return log


@pytest.mark.parametrize(
    ("images", "left_m", "right_m"),
    [
        (("image_0", "image_1"), (0, 0, 0), (-0.54, 0, 0)),
        (("image_2", "image_3"), (0.06, 0, 0), (-0.47, 0.002, 0)),  # ground truth is of camera 0
    ],
)
def test_a_kitti_sequence(tmp_path, images, left_m, right_m):
    poses = write_kitti(tmp_path / "00", images, (left_m, right_m))
    done = import_kitti(tmp_path / "00", tmp_path / "00.mcap")
    assert (done.left, done.right, done.poses, done.warnings) == (3, 3, 3, [])
    eye = np.eye(3)
    pose = se3.from_rotation_translation(eye, np.subtract(right_m, left_m))
    cam0_from_left = se3.from_rotation_translation(eye, -np.array(left_m))
    files = tuple(f"{side}/{{n:06d}}.png" for side in images)
    stamps_ns = [0, 103_622_400, 207_286_900]
    log = check_both(tmp_path / "00", done, stamps_ns, files, pose, poses @ cam0_from_left)
    assert np.array_equal(log.rig.left.K, [[70.0, 0, 32], [0, 70.0, 24], [0, 0, 1]])
    assert sfm.inspect(tmp_path / "00")["format"] == "KITTI odometry"


def test_an_euroc_recording(tmp_path):
    world_from_body = write_euroc(tmp_path / "MH")
    done = import_euroc(tmp_path / "MH", tmp_path / "mh.mcap")
    assert (done.left, done.right, done.poses, len(done.warnings)) == (3, 2, 4, 1)
    for folder in (tmp_path / "MH" / "mav0", tmp_path / "MH"):
        inside = "" if folder.name == "mav0" else "mav0/"
        files = f"{inside}cam0/data/{{stamp}}.png", f"{inside}cam1/data/{{stamp}}.png"
        truth = world_from_body @ BODY_FROM_LEFT
        log = check_both(folder, done, EUROC_STAMPS_NS[:2], files, RIGHT_FROM_LEFT, truth)
        assert log.rig.left.D == (-0.28, 0.07, 0.0002, 1.7e-05)


def test_tum_vi_is_laid_out_like_euroc_with_one_calibration_for_all(tmp_path):
    world_from_body = write_tum_vi(tmp_path / "room1")
    log = sfm.open_log(tmp_path / "room1")
    np.testing.assert_allclose(log.rig.right_from_left, RIGHT_FROM_LEFT, atol=1e-9)
    assert log.rig.left.distortion_model == "equidistant" and len(list(log.frames())) == 2
    np.testing.assert_allclose(log.ground_truth().world_from_cam, world_from_body @ BODY_FROM_LEFT, atol=1e-9)


def test_euroc_without_any_calibration_takes_the_one_that_is_given(tmp_path):
    """And without tables, where the names are the stamps; as a sample of another system has it."""
    write_euroc(tmp_path / "MH")
    (tmp_path / "MH/mav0/cam1/sensor.yaml").unlink()
    with pytest.raises(sfm.ConfigError, match=r"cannot read calibration .*cam1/sensor\.yaml"):
        sfm.open_log(tmp_path / "MH")
    (tmp_path / "MH/mav0/cam0/sensor.yaml").unlink()
    with pytest.raises(sfm.LogError, match="calibration"):
        sfm.open_log(tmp_path / "MH")
    for _ in range(2):
        log = sfm.open_log(tmp_path / "MH", calibration=camera_pair())
        assert [f.stamp_ns for f in log.frames()] == EUROC_STAMPS_NS[:2] and log.ground_truth() is None
        said = "is not used: no calibration says where the camera is on the body"
        assert any(said in w for w in log.stats.warnings)
        (tmp_path / "MH/mav0/cam1/data.csv").unlink(missing_ok=True)


def test_a_drive_of_kittis_raw_data(tmp_path):
    drive = write_kitti_raw(tmp_path / "2011_09_26")
    log = sfm.open_log(drive)
    first_ns = 1317042145594360375  # 2011-09-26 13:02:25.594360375
    assert [f.stamp_ns - first_ns for f in log.frames()] == [0, 103_554_625, 207_139_625]
    assert log.rig.baseline_m == pytest.approx(0.54) and log.rig.left.K[0, 0] == 70
    assert sfm.inspect(drive)["format"] == "KITTI raw"
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
    assert len(list(log.frames())) == 3 and log.rig.baseline_m == 0.25
    assert log.rig.left.K[0].tolist() == [320, 0, 32]
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
@pytest.mark.parametrize("sides", [("left", "right"), ("cam0", "cam1")])
def test_names_that_are_times_are_the_stamps(tmp_path, names, stamps_ns, sides):
    write_image_folders(tmp_path, [f"{name}.png" for name in names], sides)
    log = sfm.open_log(tmp_path, calibration=camera_pair())
    assert tuple(f.stamp_ns for f in log.frames()) == stamps_ns
    assert [w for w in log.stats.warnings if "no stamps" in w] == (
        ["no stamps and no rate were given: frames are put 0.1 s apart"] if stamps_ns[0] == 0 else []
    )


def test_folders_of_images_want_a_calibration_that_puts_the_right_camera_on_the_right(tmp_path):
    write_image_folders(tmp_path, ["1.png", "2.png"])
    with pytest.raises(sfm.LogError, match="has no calibration for topic /camera/left/image") as caught:
        sfm.open_log(tmp_path)
    assert caught.value.hint == ("calibration",)
    (tmp_path / "rig.toml").write_text(camera_pair(se3.exp([0.2, 0, 0, 0, 0, 0])).to_toml())
    with pytest.raises(sfm.ConfigError, match=f"{tmp_path}.* to the left of the left one"):
        sfm.open_log(tmp_path)


def test_a_damaged_image_costs_its_frame_where_the_folder_is_read(tmp_path):
    write_kitti(tmp_path / "00")
    (tmp_path / "00/image_1/000001.png").write_bytes(b"no image")
    log = sfm.open_log(tmp_path / "00")
    assert len(list(log.frames())) == 2 and not log.stats.complete
    assert any("000001.png is not a PNG" in w for w in log.stats.warnings)


def test_a_folder_of_recordings_names_them(tmp_path, cli):
    for name in ("a", "b"):
        write_kitti(tmp_path / name)
    (tmp_path / "notes.txt").touch()
    with pytest.raises(sfm.LogError, match=r"give one of .*/a, .*/b$"):
        sfm.open_log(tmp_path)
    assert "stream-sfm batch DIR" in cli("inspect", tmp_path, code=3).err
