"""Calibrations as other tools write them give the rig that is in them."""

import json

import cv2
import numpy as np
import pytest

from stream_sfm import Camera, ConfigError, MonoRig, StereoRig, open_log
from stream_sfm.camera.calibration.document import make_camera
from stream_sfm.geometry import se3
from tests.helpers.stereo_logs import HEIGHT, WIDTH, Spec, write_log

RNG = np.random.default_rng(8)
SIZE = (752, 480)
LEFT = Camera(
    *SIZE, np.array([[458.654, 0, 367.215], [0, 457.296, 248.375], [0, 0, 1]]), (-0.28, 0.07, 2e-4, 1.8e-5)
)
RIGHT = Camera(
    *SIZE, np.array([[457.587, 0, 379.999], [0, 456.134, 255.238], [0, 0, 1]]), (-0.28, 0.08, 1e-4, -3e-5)
)
POSE = se3.from_rotation_translation(se3.exp_so3(np.array([0.002, 0.014, -0.0007])), np.array([-0.11, 4e-4, -8e-4]))
RIG = StereoRig(LEFT, RIGHT, POSE)
BODY_FROM_LEFT = se3.exp(RNG.normal(size=6) * 0.3)


def rows(matrix):
    return "\n".join(f"  - {row.tolist()}" for row in matrix)


def kalibr(first, second, lens="radtan", extra=""):
    def camera(n, c):
        intrinsics = [float(c.K[0, 0]), float(c.K[1, 1]), float(c.K[0, 2]), float(c.K[1, 2])]
        return (
            f"cam{n}:\n  cam_overlaps: [{1 - n}]\n  camera_model: pinhole\n  distortion_coeffs: {list(c.D)}\n"
            f"  distortion_model: {lens}\n  intrinsics: {intrinsics}\n  resolution: [{c.width}, {c.height}]\n"
            f"  rostopic: /cam{n}/image_raw\n"
        )

    return camera(0, first) + camera(1, second) + f"  T_cn_cnm1:\n{rows(POSE)}\n{extra}"


def camera_info(camera, name, r, p, model="plumb_bob"):
    def matrix(key, m, shape):
        return f"{key}:\n  rows: {shape[0]}\n  cols: {shape[1]}\n  data: {np.ravel(m).tolist()}\n"

    d = [*camera.D, 0.0]
    return (
        f"image_width: {camera.width}\nimage_height: {camera.height}\ncamera_name: {name}\n"
        + matrix("camera_matrix", camera.K, (3, 3))
        + f"distortion_model: {model}\n"
        + matrix("distortion_coefficients", d, (1, 5))
        + matrix("rectification_matrix", r, (3, 3))
        + matrix("projection_matrix", p, (3, 4))
    )


def sensor_yaml(camera, body_from_cam):
    """As in the data set: with comments, and a matrix over several lines."""
    data = ",\n         ".join(", ".join(repr(float(x)) for x in row) for row in body_from_cam)
    intrinsics = [float(camera.K[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2))]
    return (
        "#Default calibration\nsensor_type: camera\ncomment: VI-Sensor cam (MT9M034)\n\n# Sensor extrinsics\n"
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{data}]\n\nrate_hz: 20\n"
        f"resolution: [{camera.width}, {camera.height}]\ncamera_model: pinhole\n"
        f"intrinsics: {intrinsics} #fu, fv, cu, cv\n"
        f"distortion_model: radial-tangential\ndistortion_coefficients: {list(camera.D)}\n"
    )


def rectification():
    r, t = POSE[:3, :3], POSE[:3, 3:]
    r1, r2, p1, p2, *_ = cv2.stereoRectify(LEFT.K, np.zeros(4), RIGHT.K, np.zeros(4), SIZE, r, t)
    return r1, r2, p1, p2


def storage(path, **values):
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        file.write(name, value)
    file.release()
    return path


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def check(where, rig=RIG, size=None, atol=1e-9):
    found = StereoRig.from_calibration(where, size)
    np.testing.assert_allclose(found.right_from_left, rig.right_from_left, atol=atol)
    for one, other in ((found.left, rig.left), (found.right, rig.right)):
        np.testing.assert_allclose(one.K, other.K, atol=1e-9)
        assert (one.width, one.height, one.distortion_model) == (other.width, other.height, other.distortion_model)
        np.testing.assert_allclose(one.D[:4], other.D[:4], atol=1e-12)
    left = MonoRig.from_calibration(where, size)
    np.testing.assert_allclose(left.left.K, rig.left.K, atol=1e-9)


def test_kalibr(tmp_path):
    check(write(tmp_path / "camchain.yaml", kalibr(LEFT, RIGHT)))


@pytest.mark.parametrize("name", ["equi", "equidistant", "fisheye"])
def test_kalibr_of_a_fisheye(tmp_path, name):
    cameras = [Camera(*SIZE, c.K, (-0.01, 0.02, -0.003, 0.001), "equidistant") for c in (LEFT, RIGHT)]
    check(write(tmp_path / "camchain.yaml", kalibr(*cameras, name)), StereoRig(*cameras, POSE))


def test_kalibr_with_an_imu_instead_of_a_chain(tmp_path):
    cam_from_imu = se3.exp(RNG.normal(size=6) * 0.2)
    text = kalibr(LEFT, RIGHT).split("  T_cn_cnm1")[0]
    text = text.replace("cam1:\n", f"  T_cam_imu:\n{rows(cam_from_imu)}\ncam1:\n")
    check(write(tmp_path / "camchain.yaml", f"{text}  T_cam_imu:\n{rows(POSE @ cam_from_imu)}\n"))


def test_ros_camera_info(tmp_path):
    r1, r2, p1, p2 = rectification()
    left = write(tmp_path / "left.yaml", camera_info(LEFT, "stereo/left", r1, p1))
    right = write(tmp_path / "right.yaml", camera_info(RIGHT, "stereo/right", r2, p2))
    check((left, right))
    check(tmp_path)
    with pytest.raises(ConfigError, match=r"left\.yaml: this is the calibration of one camera"):
        StereoRig.from_calibration(left)
    write(right, camera_info(RIGHT, "stereo/right", r2, p1))
    with pytest.raises(
        ConfigError, match=r"right\.yaml: projection_matrix of neither camera contains the baseline"
    ):
        StereoRig.from_calibration(tmp_path)


def test_euroc_sensor_files(tmp_path):
    left = write(tmp_path / "mav0" / "cam0" / "sensor.yaml", sensor_yaml(LEFT, BODY_FROM_LEFT))
    right = sensor_yaml(RIGHT, BODY_FROM_LEFT @ se3.inverse(POSE))
    right_path = write(tmp_path / "mav0" / "cam1" / "sensor.yaml", right)
    check((left, right_path))
    check(tmp_path)
    check(tmp_path / "mav0")


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_opencv_stereo_calibrate(tmp_path, suffix):
    r1, r2, p1, p2 = rectification()
    pair = {"M1": LEFT.K, "D1": np.array([LEFT.D]), "M2": RIGHT.K, "D2": np.array([RIGHT.D])}
    pose = {"R": POSE[:3, :3], "T": POSE[:3, 3:]}
    size = {"image_width": SIZE[0], "image_height": SIZE[1]}
    check(storage(tmp_path / f"all.{suffix}", **pair, **pose, **size))
    folder = tmp_path / "two"
    folder.mkdir()
    files = [
        storage(folder / f"intrinsics.{suffix}", **pair),
        storage(folder / f"extrinsics.{suffix}", **pose, R1=r1, R2=r2, P1=p1, P2=p2),
    ]
    check(files, size=SIZE)
    check(folder, size=SIZE)
    with pytest.raises(ConfigError, match="the size of the images is missing: add image_width and image_height"):
        StereoRig.from_calibration(files)
    check(storage(tmp_path / f"rectified.{suffix}", **pair, **size, R1=r1, R2=r2, P1=p1, P2=p2))


def test_opencv_names_of_the_documentation(tmp_path):
    names = {"cameraMatrix1": LEFT.K, "distCoeffs1": np.array(LEFT.D), "cameraMatrix2": RIGHT.K}
    names |= {"distCoeffs2": np.array(RIGHT.D), "R": POSE[:3, :3], "T": POSE[:3, 3:], "imageSize": list(SIZE)}
    text = {k: np.asarray(v).tolist() for k, v in names.items()}
    check(write(tmp_path / "stereo.json", json.dumps(text)))


def test_kitti_projections_take_the_size_from_the_images(tmp_path):
    k = np.array([[718.856, 0, 607.1928], [0, 718.856, 185.2157], [0, 0, 1]])
    offsets = {0: 0.0, 1: -0.5372, 2: 0.06, 3: -0.47}
    projections = {n: k @ np.c_[np.eye(3), [x, 0, 0]] for n, x in offsets.items()}
    lines = [f"P{n}: " + " ".join(repr(float(x)) for x in p.ravel()) for n, p in projections.items()]
    path = write(tmp_path / "calib.txt", "\n".join([*lines, f"Tr: {' '.join(['0.1'] * 12)}"]) + "\n")
    camera = Camera(1241, 376, k, (), "none")
    pose = se3.from_rotation_translation(np.eye(3), np.array([-0.5372, 0, 0]))
    check(path, StereoRig(camera, camera, pose), size=(1241, 376))
    with pytest.raises(ConfigError, match="does not tell the size of the images"):
        StereoRig.from_calibration(path)


def test_a_log_tells_the_size_that_a_calibration_does_not(tmp_path):
    k = np.array([[80.0, 0, WIDTH / 2], [0, 80.0, HEIGHT / 2], [0, 0, 1]])
    values = {"M1": k, "D1": np.zeros(5), "M2": k, "D2": np.zeros(5), "R": np.eye(3), "T": np.array([-0.25, 0, 0])}
    path = storage(tmp_path / "stereo.yml", **values)
    log = open_log(write_log(tmp_path / "log.mcap", Spec(infos=(None, None))), calibration=path)
    assert log.rig.baseline_m == pytest.approx(0.25) and (log.rig.left.width, log.rig.left.height) == (
        WIDTH,
        HEIGHT,
    )
    assert len(list(log.frames())) == 12


BROKEN = {
    "no rotation": (lambda: kalibr(LEFT, RIGHT).replace(repr(float(POSE[0, 0])), "3.5"), "T_cn_cnm1 is not a rotation"),
    "model": (lambda: kalibr(LEFT, RIGHT).replace("pinhole", "omni", 1), "cam0.camera_model 'omni' is not supported"),
    "lens": (lambda: kalibr(LEFT, RIGHT, "fov"), "distortion model 'fov' is not supported; supported are .*radtan"),
    "one camera": (lambda: kalibr(LEFT, RIGHT).split("cam1:")[0], "cam1 is missing"),
    "no chain": (lambda: kalibr(LEFT, RIGHT).split("  T_cn_cnm1")[0], "cam1.T_cn_cnm1.* is missing"),
    "no number": (lambda: kalibr(LEFT, RIGHT).replace("752", "wide", 1), "cam0.resolution must be 2 numbers"),
    "YAML": (lambda: "cam0: [1, 2", "neither TOML nor YAML"),
    "a list": (lambda: "- 1\n- 2\n", "has no keys"),
    "other keys": (lambda: "fx: 1\nfy: 2\n", "of no known format; known are TOML.*Kalibr.*ROS.*EuRoC.*KITTI.*OpenCV"),
    "empty": (lambda: "", "has no keys"),
    "storage": (lambda: "%YAML:1.0\nM1: !!opencv-matrix\n  rows: [", "OpenCV's FileStorage"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_mistakes_are_named_with_the_file(tmp_path, name):
    make, words = BROKEN[name]
    path = write(tmp_path / "rig.yaml", make())
    with pytest.raises(ConfigError, match=words) as caught:
        StereoRig.from_calibration(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_two_formats_are_no_pair_and_a_folder_has_one(tmp_path):
    r1, _, p1, _ = rectification()
    files = [
        write(tmp_path / "left.yaml", camera_info(LEFT, "left", r1, p1)),
        write(tmp_path / "c.yaml", kalibr(LEFT, RIGHT)),
    ]
    with pytest.raises(ConfigError, match=r"this is a Kalibr.*left\.yaml is a ROS"):
        StereoRig.from_calibration(files)
    with pytest.raises(ConfigError, match=r"several calibrations \(c\.yaml, left\.yaml\)"):
        StereoRig.from_calibration(tmp_path)
    with pytest.raises(ConfigError, match="holds no calibration"):
        StereoRig.from_calibration(write(tmp_path / "empty" / "notes.txt", "nothing").parent)


@pytest.mark.parametrize("model", ["none", "None"])
def test_coefficients_of_no_model_are_not_dropped_in_silence(model):
    k = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
    with pytest.raises(ConfigError, match=r"'[nN]one' comes with the coefficients \[-0\.1, 0\.0\]: name the model"):
        make_camera((320, 240), k, model, (-0.1, 0.0))
    assert make_camera((320, 240), k, model, (0.0, 0.0)).distortion_model == "none"
