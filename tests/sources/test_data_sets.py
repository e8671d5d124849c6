"""Data sets and folders of images open directly, and their imports read back the same bytes, rig and truth."""

import json
from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.logs.importers import Imported, import_euroc, import_kitti
from stream_sfm.logs.mcap_file.message import Damage
from stream_sfm.logs.recording.stereo_log import StereoLog
from stream_sfm.logs.sources.image_files import ImageFile, ImageFilesSource
from stream_sfm.logs.sources.recognise import is_recording
from tests.helpers.data_sets import (
    BODY_FROM_LEFT,
    EUROC_STAMPS_NS,
    HEIGHT,
    KITTI_K,
    RIGHT_FROM_LEFT,
    WIDTH,
    camera_pair,
    kitti_projection,
    numbers,
    write_euroc,
    write_image_folders,
    write_kitti,
    write_kitti_raw,
    write_picture,
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
    assert not log.stats.warnings[1:]  # except for the missing stamps
    text = (tmp_path / "P001" / names[2]).read_text()
    for name in names[:2]:  # the images cut short of their poses, at the front
        next((tmp_path / "P001" / name).glob("000000_*")).unlink()
    log = sfm.open_log(tmp_path / "P001")
    assert len(list(log.frames())) == 2 and "3 poses for 2 images: 2 belong together" in " ".join(log.stats.warnings)
    np.testing.assert_allclose(log.ground_truth().world_from_cam, expected[1:], atol=1e-9)
    (tmp_path / "P001" / names[2]).write_text("\n".join(text.split("\n")[:2]))  # and the poses, at the end
    np.testing.assert_allclose(sfm.open_log(tmp_path / "P001").ground_truth().world_from_cam, expected[1:2], atol=1e-9)


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
        ["no stamps and no rate were given: frames are 0.1 s apart"] if stamps_ns[0] == 0 else []
    )


def test_folders_of_images_want_a_calibration_that_puts_the_right_camera_on_the_right(tmp_path):
    write_image_folders(tmp_path, ["1.png", "2.png"])
    with pytest.raises(sfm.LogError, match="has no calibration for topic /camera/left/image") as caught:
        sfm.open_log(tmp_path)
    assert caught.value.hint == ("calibration",)
    (tmp_path / "rig.toml").write_text(camera_pair(se3.exp([0.2, 0, 0, 0, 0, 0])).to_toml())
    with pytest.raises(sfm.ConfigError, match=f"{tmp_path}.* to the left of the left one"):
        sfm.open_log(tmp_path)


def test_an_image_may_have_its_bytes_from_elsewhere_as_from_an_archive(tmp_path):
    packed = write_picture(tmp_path / "image.png").read_bytes()

    class Packed(ImageFile):
        def content(self) -> bytes:
            return packed

    images = [Packed(n, tmp_path / f"a.tar/{n}.png") for n in range(3)]
    source = ImageFilesSource(tmp_path / "a.tar", "tar", camera_pair(), (images, images))
    sent = [m for m in source.messages(Damage()) if "image" in m.channel.topic]
    assert len(sent) == 6 and all(packed in bytes(m.data) for m in sent)
    assert images[0].size() == (WIDTH, HEIGHT) and source.size_bytes == 0


def test_a_damaged_image_costs_its_frame_where_the_folder_is_read(tmp_path):
    write_kitti(tmp_path / "00")
    (tmp_path / "00/image_1/000001.png").write_bytes(b"no image")
    log = sfm.open_log(tmp_path / "00")
    assert len(list(log.frames())) == 2 and not log.stats.complete
    assert any("000001.png is not a PNG" in w for w in log.stats.warnings)


def test_own_images_in_folders_called_like_tartanairs_have_their_own_calibration(tmp_path):
    for n in range(2):
        for side in ("left", "right"):
            write_picture(tmp_path / f"image_{side}/{n:06d}_{side}.png")
    (tmp_path / "calibration.toml").write_text(camera_pair().to_toml())
    log = sfm.open_log(tmp_path)
    assert log.rig.baseline_m == pytest.approx(camera_pair().baseline_m) and len(list(log.pairs())) == 2


def test_the_one_recording_in_and_below_a_folder_is_taken(tmp_path):
    write_kitti(tmp_path / "dataset/sequences/00")
    (tmp_path / "dataset/notes.txt").touch()
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs/estimates.mcap").touch()  # a result, no recording
    assert sfm.open_log(tmp_path).path == tmp_path / "dataset/sequences/00"
    write_kitti(tmp_path / "dataset/sequences/01")
    with pytest.raises(sfm.LogError, match=r"give one of .*sequences/00, .*sequences/01$"):
        sfm.open_log(tmp_path)


def test_a_calibration_of_another_size_is_reported_in_one_sentence(tmp_path, cli):
    write_image_folders(tmp_path, [f"{n}.png" for n in range(9)])
    wrong = camera_pair().to_toml().replace(f"width = {WIDTH}", f"width = {2 * WIDTH}")
    (tmp_path / "calibration.toml").write_text(wrong)
    said = cli("replay", tmp_path, "--out", tmp_path / "run", code=3).err
    assert "give images of the calibrated size" in said and said.count("the calibration is for") <= 3


def test_a_folder_of_recordings_names_them(tmp_path, cli):
    for name in ("a", "b"):
        write_kitti(tmp_path / name)
    (tmp_path / "notes.txt").touch()
    with pytest.raises(sfm.LogError, match=r"give one of .*/a, .*/b$"):
        sfm.open_log(tmp_path)
    assert "stream-sfm batch DIR" in cli("inspect", tmp_path, code=3).err


@pytest.mark.parametrize(
    ("sides", "inner"),
    [
        (("L", "R"), ""), (("l", "r"), ""), (("cam_l", "cam_r"), ""), (("left_cam", "right_cam"), ""),
        (("camL", "camR"), ""), (("Left", "Right"), "/images"), (("infra1", "infra2"), ""),
        (("cam0", "cam1"), "/data"), (("image_2", "image_3"), ""), (("my_left_lens", "my_right_lens"), ""),
    ],
)  # fmt: skip
def test_folders_whose_names_differ_in_the_side_only(tmp_path, sides, inner):
    names = ["0.png", "1.png", "2.png"]
    write_image_folders(tmp_path, names, [f"{side}{inner}" for side in sides])
    write_image_folders(tmp_path, names, ["depth_left", "depth_right"])  # no cameras
    log = sfm.open_log(tmp_path, calibration=camera_pair(), rate_hz=20)
    frames = list(log.pairs())
    assert [p.stamp_ns for p in frames] == [0, 50_000_000, 100_000_000] and not log.stats.warnings
    for side, images in zip(sides, ([p.left for p in frames], [p.right for p in frames]), strict=True):
        files = [(tmp_path / f"{side}{inner}" / name).read_bytes() for name in names]
        assert [image.data for image in images] == files
    assert is_recording(tmp_path)


@pytest.mark.parametrize("form", ["left_{}.png", "{}_left.png", "left{}.png", "{}_L.png", "cam0_{}.png", "{}_cam0.png"])
def test_files_of_both_sides_in_one_folder(tmp_path, form):
    right = form.replace("left", "right").replace("L", "R").replace("cam0", "cam1")
    for n in range(3):
        write_picture(tmp_path / form.format(f"{n:04d}"))
        write_picture(tmp_path / right.format(f"{n:04d}"))
    (tmp_path / "rig.toml").write_text(camera_pair().to_toml())
    log = sfm.open_log(tmp_path)
    pairs = list(log.pairs())
    assert len(pairs) == 3
    for n, pair in enumerate(pairs):
        assert pair.left.data == (tmp_path / form.format(f"{n:04d}")).read_bytes()
        assert pair.right.data == (tmp_path / right.format(f"{n:04d}")).read_bytes()


def test_images_of_one_camera_are_no_pair(tmp_path):
    for n in range(9):
        write_picture(tmp_path / f"img{n}.png")
    with pytest.raises(sfm.LogError, match=r"there are images in .* \(9\), of which no names tell left from right"):
        sfm.open_log(tmp_path, calibration=camera_pair())
    log = sfm.open_log(tmp_path, calibration=camera_pair(), mono=True, rate_hz=20)
    assert [f.stamp_ns for f in log.frames()] == [n * 50_000_000 for n in range(9)] and not log.stats.warnings
    with pytest.raises(sfm.LogError, match=r"img.* \(9\), give the one of a single camera$"):
        (tmp_path / "deep").mkdir()
        (tmp_path / "deep/img").mkdir()
        for n in range(9):
            (tmp_path / f"img{n}.png").rename(tmp_path / f"deep/img/{n}.png")
        sfm.open_log(tmp_path, calibration=camera_pair(), mono=True)


def test_where_nothing_fits_the_import_line_is_reported(tmp_path, cli):
    write_image_folders(tmp_path, ["0.png", "1.png"], ["one", "deep/other"])
    said = cli("replay", tmp_path, code=3).err
    assert f"{tmp_path}/one (2)" in said and f"{tmp_path}/deep/other (2)" in said
    assert "stream-sfm import images --left DIR --right DIR --calibration FILE --rate HZ OUT.mcap" in said


def test_vignettes_are_not_the_recording(tmp_path):
    """As TUM-VI's folder `dso`: a vignette beside the folder of the images."""
    for side in ("cam0", "cam1"):
        write_picture(tmp_path / side / "vignette.png")
    write_image_folders(tmp_path, [f"{s}.png" for s in EUROC_STAMPS_NS], ["cam0/images", "cam1/images"])
    log = sfm.open_log(tmp_path, calibration=camera_pair())
    assert [p.stamp_ns for p in log.pairs()] == EUROC_STAMPS_NS


def test_a_calibration_that_is_given_goes_before_a_broken_one(tmp_path):
    write_image_folders(tmp_path / "own", ["0.png", "1.png"])
    (tmp_path / "own/rig.toml").write_text("[left]\nwidth = 5\n")
    write_kitti(tmp_path / "00")
    (tmp_path / "00/calib.txt").write_text("P0: 1 2 3\n")
    truth = write_euroc(tmp_path / "MH")
    (tmp_path / "MH/mav0/cam1/sensor.yaml").write_text("T_BS: 5\n")
    for name in ("own", "00", "MH"):
        with pytest.raises(sfm.ConfigError):
            sfm.open_log(tmp_path / name)
        log = sfm.open_log(tmp_path / name, calibration=camera_pair())
        assert len(list(log.frames())) >= 2 and log.rig.baseline_m == camera_pair().baseline_m
    assert len(truth) and sfm.open_log(tmp_path / "00", calibration=camera_pair()).ground_truth() is not None


def test_a_rate_is_for_images_without_stamps(tmp_path, cli):
    write_kitti(tmp_path / "00")
    with pytest.raises(sfm.ConfigError, match=r"a rate was given, but .* \(KITTI odometry\) has stamps"):
        sfm.open_log(tmp_path / "00", rate_hz=20)
    write_image_folders(tmp_path / "own", ["0.png", "1.png"])
    (tmp_path / "c.toml").write_text(camera_pair().to_toml())
    options = ("--calibration", tmp_path / "c.toml", "--rate", "20", "--json")
    assert json.loads(cli("inspect", tmp_path / "own", *options).out)["frames"]["rate_hz"] == pytest.approx(20)


def test_euroc_with_some_images_missing_is_not_damage(tmp_path):
    write_euroc(tmp_path / "MH")
    (tmp_path / f"MH/mav0/cam0/data/{EUROC_STAMPS_NS[0]}.png").unlink()
    log = sfm.open_log(tmp_path / "MH")
    assert [f.stamp_ns for f in log.frames()] == EUROC_STAMPS_NS[1:2]
    assert log.stats.complete and "1 of 3 images in" in " ".join(log.stats.warnings)


def test_a_drive_of_kittis_raw_data_that_is_not_rectified(tmp_path):
    """`…_extract`: images of the size of S, for which K, D, R and T are; P_rect is of smaller ones."""
    drive = write_kitti_raw(tmp_path / "2011_09_26")
    pose = se3.exp([-0.54, 0.01, 0, 0.01, -0.02, 0.003])
    rows = []
    for n, (k, x) in enumerate(((KITTI_K, np.eye(4)), (KITTI_K + np.diag([1e-3, 0, 0]), pose))):
        d = [-0.3, 0.1, 1e-3, -1e-3, 0.01]
        rows += [f"S_0{n}: {WIDTH}.0 {HEIGHT}.0", f"K_0{n}: {numbers(k)}", f"D_0{n}: {numbers(np.array(d))}"]
        rows += [f"R_0{n}: {numbers(x[:3, :3])}", f"T_0{n}: {numbers(x[:3, 3])}", f"S_rect_0{n}: 60.0 40.0"]
        rows += [f"P_rect_0{n}: {kitti_projection((-0.5 * n, 0, 0))}"]
    table = tmp_path / "2011_09_26/calib_cam_to_cam.txt"
    table.write_text("\n".join(rows) + "\n")
    for log in (sfm.open_log(drive), sfm.open_log(drive, calibration=table)):
        assert log.rig.left.D == (-0.3, 0.1, 1e-3, -1e-3, 0.01) and log.rig.right.K[0, 0] == 70.001
        np.testing.assert_allclose(log.rig.right_from_left, pose, atol=1e-9)
