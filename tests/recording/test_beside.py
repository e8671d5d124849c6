"""A recording without a calibration uses the only one beside it that fits its images, and says so."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.inspection.overview import inspect_log
from tests.helpers.data_sets import kalibr, write_image_folders
from tests.helpers.stereo_logs import (
    HEIGHT,
    PERIOD_NS,
    START_NS,
    WIDTH,
    LogWriter,
    Spec,
    scene,
    write_image,
    write_log,
)

K = np.array([[60.0, 0, WIDTH / 2], [0, 60.0, HEIGHT / 2], [0, 0, 1]])
CAMERA = sfm.Camera(WIDTH, HEIGHT, K)
RIG = sfm.StereoRig(CAMERA, CAMERA, sfm.se3_exp([-0.11, 0, 0, 0, 0.01, 0]))
CHAIN = kalibr((RIG.left, RIG.right), RIG.right_from_left)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log without a calibration, in a folder of its own."""
    (tmp_path / "data/bags").mkdir(parents=True)
    return write_log(tmp_path / "data/bags/flight.mcap", Spec(infos=(None, None), left=(0, 1), right=(0, 1)))


@pytest.mark.parametrize(
    "place", ["bags/camchain.yaml", "bags/config/chain.yaml", "chain.yaml", "calibration/chain.yaml"]
)
def test_the_only_one_that_fits_is_used_and_named(log: Path, place: str) -> None:
    file = log.parents[1] / place
    file.parent.mkdir(exist_ok=True)
    file.write_text(CHAIN)
    (file.parent / "imu.yaml").write_text("accelerometer_noise_density: 2.0e-3\n")
    other = replace(CAMERA, width=2 * WIDTH)  # for other images
    (file.parent / "other.yaml").write_text(kalibr((other, other), RIG.right_from_left))
    opened = sfm.open_log(log)
    np.testing.assert_allclose(opened.rig.right_from_left, RIG.right_from_left, atol=1e-12)
    assert len(list(opened.frames())) == 2
    (note,) = opened.stats.warnings
    assert note.startswith("the calibration beside the recording is used") and str(file) in note
    report = inspect_log(log)
    assert report["rig"]["baseline_m"] == pytest.approx(RIG.baseline_m) and note in report["warnings"]
    assert sfm.open_log(log, mono=True).rig.left.width == WIDTH


def test_the_nearest_folder_counts_and_of_several_there_one_has_to_be_given(log: Path) -> None:
    far, near, same = log.parents[1] / "a.yaml", log.with_name("b.yaml"), log.with_name("c.yaml")
    far.write_text(CHAIN.replace("60.0", "61.0"))
    for path in (near, same):
        path.write_text(CHAIN)  # equal ones are one
    assert sfm.open_log(log).rig.left.K[0, 0] == 60.0
    same.write_text(CHAIN.replace("60.0", "62.0"))
    with pytest.raises(sfm.LogError, match=r"several beside it fit its images: .*b\.yaml.*c\.yaml") as refused:
        sfm.open_log(log)
    assert "calibration" in refused.value.hint
    assert sfm.open_log(log, calibration=same).rig.left.K[0, 0] == 62.0


def test_a_recording_with_its_own_uses_its_own(tmp_path: Path) -> None:
    log = write_log(tmp_path / "own.mcap")
    before = sfm.open_log(log).rig
    (tmp_path / "chain.yaml").write_text(CHAIN)
    opened = sfm.open_log(log)
    assert (opened.rig.right_from_left == before.right_from_left).all()
    assert len(list(opened.frames())) == 12 and not opened.stats.warnings


def test_images_take_it_as_well(tmp_path: Path) -> None:
    """As in KAIST, whose calibration is beside the folder of the images."""
    images = tmp_path / "image"
    write_image_folders(images, ["1.png", "2.png"], ("stereo_left", "stereo_right"))
    found = cv2.imread(str(images / "stereo_left/1.png"))
    camera = replace(CAMERA, height=found.shape[0], width=found.shape[1])
    (tmp_path / "calibration").mkdir()
    (tmp_path / "calibration/rig.toml").write_text(replace(RIG, left=camera, right=camera).to_toml())
    assert sfm.open_log(tmp_path).rig.baseline_m == pytest.approx(RIG.baseline_m)


def test_hilti(tmp_path: Path) -> None:
    """Five cameras, of which names pair two, and a chain of several cameras beside the bag."""
    log = LogWriter(tmp_path / "exp04.mcap")
    for n in range(2):
        for k in range(5):
            topic, stamp = f"/alphasense/cam{k}/image_raw", START_NS + n * PERIOD_NS
            write_image(log, "ros1", topic, stamp, scene(n, k % 2), "mono8", f"cam{k}")
    log.close()
    from_imu = [se3.exp([-0.1 * k, 0, 0, 0, 0.1 * k, 0]) for k in range(5)]
    (tmp_path / "calibration").mkdir()
    (tmp_path / "calibration/camchain-imucam.yaml").write_text(kalibr(5 * [CAMERA], from_imu=from_imu))
    opened = sfm.open_log(tmp_path / "exp04.mcap")
    assert (opened.left_topic, opened.right_topic) == ("/alphasense/cam0/image_raw", "/alphasense/cam1/image_raw")
    np.testing.assert_allclose(opened.rig.right_from_left, from_imu[1] @ se3.inverse(from_imu[0]), atol=1e-9)
    assert len(list(opened.frames())) == 2


def test_uzh_fpv_and_malaga(tmp_path: Path) -> None:
    """Images of both sides in one folder; stamps in tables of their names, or in the names."""
    stamps = [START_NS + n * PERIOD_NS for n in range(2)]
    camera = replace(CAMERA, width=64, height=48)
    for s, side in enumerate(("left", "right")):
        names = [f"image_{s}_{n}.png" for n in range(2)]
        write_image_folders(tmp_path / "fpv", names, ("img",))
        rows = (
            f"{n} {t // 10**9}.{t % 10**9:09d} img/{name}\n"
            for n, (t, name) in enumerate(zip(stamps, names, strict=True))
        )
        (tmp_path / f"fpv/{side}_images.txt").write_text("# id timestamp image_name\n" + "".join(rows))
        names = [f"img_CAMERA1_{t // 10**9}.{t % 10**9 // 1000:06d}_{side}.png" for t in stamps]
        write_image_folders(tmp_path / "malaga", names, ("Images",))
    (tmp_path / "fpv/camchain-imucam.yaml").write_text(kalibr((camera, camera), RIG.right_from_left))
    text = "".join(
        f"[CAMERA_PARAMS_{side}]\nresolution=[64 48]\ncx=48\ncy=32\nfx=60\nfy=60\ndist=[0 0 0 0 0]\n"
        for side in ("LEFT", "RIGHT")
    )
    text += "[CAMERA_PARAMS_LEFT2RIGHT_POSE]\npose_quaternion=[0.11 0 0 1 0 0 0]\n"
    (tmp_path / "malaga/camera_params_rectified_a=0_64x48.txt").write_text(text)
    for name in ("fpv", "malaga"):
        opened = sfm.open_log(tmp_path / name)
        assert opened.stereo_rig.baseline_m == pytest.approx(0.11, abs=1e-4)
        assert [pair.stamp_ns for pair in opened.pairs()] == stamps
