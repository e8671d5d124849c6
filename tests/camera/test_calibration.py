"""Calibrations written by this package and by other tools give the right rig."""

import json
import zipfile

import cv2
import numpy as np
import pytest

from stream_sfm import Camera, ConfigError, ImuCalibration, StereoRig, open_log
from stream_sfm.camera.calibration.read import calibrations_near, read_document
from stream_sfm.camera.calibration.slam import body_from_left
from stream_sfm.camera.lens import project_into_image
from stream_sfm.geometry import se3
from tests.helpers.calibrations import (
    BODY_FROM_LEFT,
    BOTH,
    LEFT,
    OF_ROS,
    POSE,
    RIG,
    RIGHT,
    RNG,
    SIZE,
    TOML,
    camera_info,
    check,
    storage,
    write,
)
from tests.helpers.data_sets import kalibr, kitti_projection, matrix_rows, sensor_yaml
from tests.helpers.stereo_logs import HEIGHT, WIDTH, Spec, write_log


def test_both_forms_of_our_own_are_read(tmp_path):
    k = np.array([[500, 0, 320], [0, 501, 240.5], [0, 0, 1]])
    right = Camera(640, 480, [[500.0, 0, 321], [0, 500, 240], [0, 0, 1]], (-0.2, 0.03, 0.0, 0.001))
    rig = StereoRig(Camera(640, 480, k, (), "none"), right, se3.exp([-0.12, 0, 0, 0, 0, 0]))
    check(write(tmp_path / "rig.toml", TOML), rig)
    matrix = "right_from_left = [[1, 0, 0, -0.12], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]\n"
    check(write(tmp_path / "matrix.toml", matrix + TOML.split("[right_from_left]")[0]), rig)


def test_our_own_is_written_and_read_back(tmp_path):
    rig = StereoRig(
        Camera(*SIZE, LEFT.K, (0.1, 0.2, 0.3, 0.4), "equidistant"), Camera(*SIZE, RIGHT.K, (), "none"), POSE
    )
    check(write(tmp_path / "rig.toml", rig.to_toml()), rig, atol=1e-15)


@pytest.mark.parametrize("name", ["radtan", "equi", "equidistant", "fisheye"])
def test_kalibr(tmp_path, name):
    rig = RIG
    if name != "radtan":
        rig = StereoRig(*(Camera(*SIZE, c.K, (-0.01, 0.02, -3e-3, 1e-3), "equidistant") for c in (LEFT, RIGHT)), POSE)
    check(write(tmp_path / "camchain.yaml", kalibr((rig.left, rig.right), POSE, lens=name)), rig)


def test_kalibr_with_an_imu_instead_of_a_chain(tmp_path):
    cam_from_imu = se3.exp(RNG.normal(size=6) * 0.2)
    text = kalibr(BOTH, from_imu=(cam_from_imu, POSE @ cam_from_imu))
    check(write(tmp_path / "camchain.yaml", text))


def test_openvins_with_the_camera_in_the_imu(tmp_path):
    """Its head is OpenCV's, and its poses are the inverses of Kalibr's."""
    cam_from_imu = se3.exp(RNG.normal(size=6) * 0.3)
    text = kalibr(BOTH, from_imu=(se3.inverse(cam_from_imu), se3.inverse(POSE @ cam_from_imu)))
    path = write(tmp_path / "chain.yaml", "%YAML:1.0\n\n" + text.replace("T_cam_imu", "T_imu_cam"))
    check(path, RIG)
    np.testing.assert_allclose(body_from_left(read_document(path)), se3.inverse(cam_from_imu), atol=1e-9)


def test_openvins_by_the_configuration_that_names_the_files(tmp_path):
    cam_from_imu = se3.exp(RNG.normal(size=6) * 0.3)
    write(tmp_path / "chain.yaml", "%YAML:1.0\n\n" + kalibr(BOTH, from_imu=(cam_from_imu, POSE @ cam_from_imu)))
    write(tmp_path / "imu.yaml", "%YAML:1.0\n\nimu0:\n  accelerometer_noise_density: 2.0e-3\n")
    named = 'relative_config_imu: "imu.yaml"\nrelative_config_imucam: "chain.yaml"\n'
    check(path := write(tmp_path / "estimator_config.yaml", f"%YAML:1.0 # \n\nuse_stereo: true\n{named}"))
    assert [[file.name for file in files] for files in next(calibrations_near(path))] == [
        ["chain.yaml", "imu.yaml"],
        ["estimator_config.yaml", "imu.yaml"],  # the same calibration
    ]
    imu = StereoRig.from_calibration(path).imu
    assert imu.accel_noise == 2e-3
    np.testing.assert_allclose(imu.cam_from_imu, cam_from_imu, atol=1e-9)


@pytest.mark.parametrize("model", ["PINHOLE", "KANNALA_BRANDT", "MEI"])
def test_vins_fusion(tmp_path, model):
    """Its matrices are OpenCV's, and each camera has a file of its own; MEI with ξ = 0 is a pinhole without D."""
    d = {"PINHOLE": (-0.28, 0.07, 2e-4, 1.8e-5), "KANNALA_BRANDT": (-0.01, 0.02, -3e-3, 1e-3), "MEI": (0, 0, 0, 0)}
    names = {"PINHOLE": "fx fy cx cy", "KANNALA_BRANDT": "mu mv u0 v0", "MEI": "gamma1 gamma2 u0 v0"}[model].split()
    lens = "k2 k3 k4 k5" if model == "KANNALA_BRANDT" else "k1 k2 p1 p2"
    for n, camera in enumerate(BOTH):
        numbers = dict(zip(names, camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], strict=True))
        coefficients = dict(zip(lens.split(), d[model], strict=True))
        if model == "KANNALA_BRANDT":  # all in one table
            numbers, coefficients = coefficients | numbers, {}
        rows = [("projection_parameters", numbers), ("distortion_parameters", coefficients)]
        rows += [("mirror_parameters", {"xi": 0.0})] if model == "MEI" else []
        tables = "".join(f"{t}:\n" + "".join(f"   {k}: {v}\n" for k, v in row.items()) for t, row in rows if row)
        head = f"%YAML:1.0\n---\nmodel_type: {model}\ncamera_name: camera\nimage_width: 752\nimage_height: 480\n"
        write(tmp_path / f"cam{n}.yaml", head + tables)
    poses = {"body_T_cam0": BODY_FROM_LEFT, "body_T_cam1": BODY_FROM_LEFT @ se3.inverse(POSE)}
    named = {"imu": 1, "cam0_calib": "cam0.yaml", "cam1_calib": "cam1.yaml", "acc_n": 0.1, "td": 0.01}
    path = storage(tmp_path / "config.yaml", **named, **poses)
    found = StereoRig.from_calibration(path)
    np.testing.assert_allclose(found.right_from_left, POSE, atol=1e-9)
    np.testing.assert_allclose(found.imu.cam_from_imu, se3.inverse(BODY_FROM_LEFT), atol=1e-9)
    assert (found.imu.time_offset_s, found.imu.accel_noise) == (0.01, ImuCalibration(np.eye(4)).accel_noise)
    if model == "MEI":
        pixel = project_into_image(found.left, np.array([[0.3, -0.2, 1.0]]))[0]
        np.testing.assert_allclose(pixel, LEFT.K[:2] @ (0.3, -0.2, 1), atol=0.01)  # px, of the nearest fisheye
    else:
        np.testing.assert_allclose(found.left.K, LEFT.K, atol=1e-9)
        assert found.left.D[:4] == d[model]
        assert found.left.distortion_model == ("plumb_bob" if model == "PINHOLE" else "equidistant")


def test_mrpt_as_in_the_malaga_data_sets(tmp_path):
    text = ""
    for name, camera in (("LEFT", LEFT), ("RIGHT", RIGHT)):
        fx, fy, cx, cy = camera.K[[0, 1, 0, 1], [0, 1, 2, 2]]
        dist = " ".join(map(repr, [*camera.D, 0.0]))
        text += f"[CAMERA_PARAMS_{name}]\nresolution=[752 480]\ncx={cx}\ncy={cy}\nfx={fx}\nfy={fy}\ndist=[{dist}]\n\n"
    left_from_right = se3.inverse(POSE)
    x, y, z, w = se3.quat_xyzw_from_matrix(left_from_right[:3, :3])
    numbers = " ".join(repr(float(v)) for v in (*left_from_right[:3, 3], w, x, y, z))
    check(write(tmp_path / "params.txt", f"{text}[CAMERA_PARAMS_LEFT2RIGHT_POSE]\npose_quaternion=[{numbers}]\n"))


@pytest.mark.parametrize("by_third", [False, True])
def test_oak_calibration_of_the_eeprom(tmp_path, by_third):
    """Of twice the size of the images; the pose in centimetres, from socket to socket."""
    third_from_left = se3.exp(RNG.normal(size=6) * 0.1)
    to_third = (third_from_left, third_from_left @ se3.inverse(POSE)) if by_third else (POSE, None)
    half = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])  # of pixels whose centres are whole numbers
    entries = [[0, {"cameraType": 0, "extrinsics": {"toCameraSocket": -1}}]]
    for socket, camera, pose in zip((1, 2), BOTH, to_third, strict=True):
        t = dict(zip("xyz", np.zeros(3) if pose is None else 100 * pose[:3, 3], strict=True))
        link = {
            "rotationMatrix": (np.eye(3) if pose is None else pose[:3, :3]).tolist(),
            "translation": t, "specTranslation": {"x": -7.5, "y": 0.0, "z": 0.0},
            "toCameraSocket": (0 if by_third else 2) if pose is not None else -1,
        }  # fmt: skip
        values = {"width": 2 * camera.width, "height": 2 * camera.height, "extrinsics": link, "cameraType": 0}
        entries.append(
            [
                socket,
                values | {"intrinsicMatrix": (half @ camera.K).tolist(), "distortionCoeff": [*camera.D, *[0.0] * 10]},
            ]
        )
    text = json.dumps({"boardName": "OAK-D", "cameraData": entries, "stereoRectificationData": {"leftCameraSocket": 1}})
    path = write(tmp_path / "calib.json", text)
    rig = StereoRig.from_calibration(path, (LEFT.width, LEFT.height))
    np.testing.assert_allclose(rig.right_from_left, POSE, atol=1e-9)
    for camera, expected in zip((rig.left, rig.right), BOTH, strict=True):
        np.testing.assert_allclose(camera.K, expected.K, atol=1e-9)
        assert camera.D[:4] == expected.D and not any(camera.D[4:])
    assert StereoRig.from_calibration(path).left.width == 2 * LEFT.width
    with pytest.raises(ConfigError, match=r"cameraData\[1\]\. is for .* of which 640×480 is no scaled image"):
        StereoRig.from_calibration(path, (640, 480))


def test_zed_conf_of_the_size_of_the_images(tmp_path):
    """In millimetres and radians: where the right camera is, and the turn that OpenCV is given."""
    text = (
        "[LEFT_CAM_HD]\nfx=700.1\nfy=700.2\ncx=640.5\ncy=360.25\nk1=-0.17\nk2=0.02\np1=0.001\np2=-0.002\nk3=0.003\n"
        "[RIGHT_CAM_HD]\nfx=701.1\nfy=701.2\ncx=641.5\ncy=361.25\nk1=-0.16\nk2=0.03\n"
        "[LEFT_CAM_VGA]\nfx=350\nfy=350\ncx=336\ncy=188\n[RIGHT_CAM_VGA]\nfx=350\nfy=350\ncx=336\ncy=188\n"
        "[STEREO]\nBaseline=119.975\nTY=0.5\nTZ=-0.25\nCV_HD=0.01\nRX_HD=-0.002\nRZ_HD=0.001\nCV_VGA=0.02\n"
    )
    path = write(tmp_path / "SN1234.conf", text)
    rig = StereoRig.from_calibration(path, (1280, 720))
    assert rig.left.D == (-0.17, 0.02, 0.001, -0.002, 0.003) and rig.right.K[1, 2] == 361.25
    np.testing.assert_allclose(rig.right_from_left[:3, 3], [-0.119975, -0.0005, 0.00025])
    np.testing.assert_allclose(rig.right_from_left[:3, :3], cv2.Rodrigues(np.array([-0.002, 0.01, 0.001]))[0])
    assert StereoRig.from_calibration(tmp_path, (672, 376)).left.K[0, 0] == 350
    with pytest.raises(ConfigError, match="for several sizes of images"):
        StereoRig.from_calibration(path)
    with pytest.raises(ConfigError, match="images of 640×480 do not come from a ZED"):
        StereoRig.from_calibration(path, (640, 480))


def test_ros_camera_info(tmp_path):
    left = write(tmp_path / "left.yaml", camera_info(OF_ROS[0]))
    right = write(tmp_path / "right.yaml", camera_info(OF_ROS[1]))
    check((left, right))
    check(tmp_path)
    with pytest.raises(ConfigError, match=r"left\.yaml: this is the calibration of one camera"):
        StereoRig.from_calibration(left)
    write(right, camera_info(OF_ROS[1], OF_ROS[0].P))
    with pytest.raises(ConfigError, match=r"right\.yaml: projection_matrix of neither camera contains the baseline"):
        StereoRig.from_calibration(tmp_path)


@pytest.mark.parametrize("heads", [("", ""), ("%YAML:1.0\n", "%YAML:1.0\n---\n")], ids=["plain", "of OpenCV"])
def test_euroc_sensor_files(tmp_path, heads):
    bodies = (BODY_FROM_LEFT, BODY_FROM_LEFT @ se3.inverse(POSE))
    texts = [head + sensor_yaml(c, body) for head, c, body in zip(heads, (LEFT, RIGHT), bodies, strict=True)]
    check([write(tmp_path / "mav0" / f"cam{n}" / "sensor.yaml", text) for n, text in enumerate(texts)])
    check(tmp_path)
    check(tmp_path / "mav0")


LENSES = {  # of a EuRoC camera, of TUM-VI, and of KITTI-360 at half its size: parameters, fx fy cx cy, size
    "ds": ({"xi": -0.172, "alpha": 0.593}, (158.28, 158.3, 254.96, 256.3), (512, 512), ()),
    "eucm": ({"alpha": 0.63, "beta": 1.04}, (190.9, 190.8, 254.9, 256.9), (512, 512), ()),
    "omni": ({"xi": 2.2134}, (668.0, 667.9, 358.4, 352.8), (700, 700), (0.01666, 1.6588, 2e-4, 2e-4)),
}


def bent(model, points, values, f, d):
    """Pixels of points by the papers: Usenko eq. 40, Khomutenko eq. 6, Mei section II."""
    x, y, z = (points / np.linalg.norm(points, axis=1)[:, None]).T
    if model == "ds":
        xi, alpha = values.values()
        below = alpha * np.sqrt(x**2 + y**2 + (xi + z) ** 2) + (1 - alpha) * (xi + z)
    elif model == "eucm":
        alpha, beta = values.values()
        below = alpha * np.sqrt(beta * (x**2 + y**2) + z**2) + (1 - alpha) * z
    else:
        below = z + values["xi"]
    m = np.stack([x / below, y / below, np.ones_like(x)], axis=1)
    return cv2.projectPoints(m, np.zeros(3), np.zeros(3), np.array([[f[0], 0, f[2]], [0, f[1], f[3]], [0, 0, 1.0]]),
                             np.array([*d, *4 * [0.0]][:4]))[0][:, 0]  # fmt: skip


@pytest.mark.parametrize(
    ("tool", "model"), [*(("kalibr", model) for model in LENSES), ("basalt", "ds"), ("basalt", "eucm")]
)
def test_unified_lenses_are_the_fisheye_that_is_nearest(tmp_path, tool, model):
    values, f, size, d = LENSES[model]
    if tool == "basalt":
        path = write(
            tmp_path / "calibration.json",
            basalt([(model, dict(zip(("fx", "fy", "cx", "cy"), f, strict=True)) | values)] * 2, size),
        )
    else:
        camera = f"  camera_model: {model}\n  intrinsics: {[*values.values(), *f]}\n  resolution: {list(size)}\n"
        camera += f"  distortion_model: {'radtan' if d else 'none'}\n  distortion_coeffs: {list(d)}\n"
        path = write(tmp_path / "camchain.yaml", f"cam0:\n{camera}cam1:\n{camera}  T_cn_cnm1:\n{matrix_rows(POSE)}\n")
    found = StereoRig.from_calibration(path)
    np.testing.assert_allclose(found.right_from_left, POSE, atol=1e-9)
    points = np.random.default_rng(1).uniform([-2, -2, 0.4], [2, 2, 1], (4000, 3))
    expected = bent(model, points, values, f, d)
    inside = ((expected > 0) & (expected < size)).all(axis=1)
    assert inside.sum() > 1000
    apart = np.linalg.norm(project_into_image(found.left, points) - expected, axis=1)[inside]
    assert apart.max() < (0.2 if d else 0.001)  # pixels: a fisheye has no tangential coefficients


def test_a_lens_that_no_fisheye_is_near_is_refused(tmp_path):
    camera = "  camera_model: omni\n  intrinsics: [0.9, 832, 830, 376, 240]\n  resolution: [752, 480]\n"
    camera += "  distortion_model: radtan\n  distortion_coeffs: [-0.2, 0.1, 0.01, 0.02]\n"
    path = write(tmp_path / "c.yaml", f"cam0:\n{camera}cam1:\n{camera}  T_cn_cnm1:\n{matrix_rows(POSE)}\n")
    with pytest.raises(ConfigError, match=r"cam0\.omni: this lens is up to .* px from every one that is supported"):
        StereoRig.from_calibration(path)


def basalt(cameras, size):
    """As basalt_calibrate writes it; both cameras on an IMU."""
    poses = [BODY_FROM_LEFT, BODY_FROM_LEFT @ se3.inverse(POSE)]
    quats = [se3.quat_xyzw_from_matrix(pose[:3, :3]) for pose in poses]
    imu = [
        dict(zip(("px", "py", "pz"), p[:3, 3], strict=True)) | dict(zip(("qx", "qy", "qz", "qw"), q, strict=True))
        for p, q in zip(poses, quats, strict=True)
    ]
    inside = [{"camera_type": name, "intrinsics": values} for name, values in cameras]
    content = {"T_imu_cam": imu, "intrinsics": inside, "resolution": [list(size)] * 2, "calib_accel_bias": [0.1]}
    return json.dumps({"value0": content}, default=float)


def numbers(camera, names):
    k = camera.K
    return {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]} | dict(zip(names, camera.D, strict=True))


def test_basalt_with_the_lenses_that_are_here(tmp_path):
    fisheyes = [Camera(*SIZE, c.K, (0.01, -0.002, 0.003, -0.001), "equidistant") for c in (LEFT, RIGHT)]
    cameras = [("kb4", numbers(c, ("k1", "k2", "k3", "k4"))) for c in fisheyes]
    check(write(tmp_path / "kb4.json", basalt(cameras, SIZE)), StereoRig(*fisheyes, POSE))
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    bent = [Camera(*SIZE, c.K, (*c.D, 0.01, 0.02, 0.03, 0.04), "rational_polynomial") for c in (LEFT, RIGHT)]
    check(
        write(tmp_path / "r.json", basalt([("pinhole-radtan8", numbers(c, names)) for c in bent], SIZE)),
        StereoRig(*bent, POSE),
    )
    with pytest.raises(
        ConfigError, match=r"intrinsics\[0\].camera_type 'ftheta' is not supported; supported are pinhole, kb4"
    ):
        StereoRig.from_calibration(write(tmp_path / "f.json", basalt([("ftheta", {})] * 2, SIZE)))


@pytest.mark.parametrize("kind", ["PinHole", "KannalaBrandt8", "Rectified", "version 2"])
def test_orb_slam_settings(tmp_path, kind):
    """T_c1_c2 carries points of the right camera into the left one, as its examples of EuRoC say."""
    lines = ["%YAML:1.0", "---", f'Camera.type: "{kind}"', f"Camera.width: {SIZE[0]}", f"Camera.height: {SIZE[1]}"]
    rig = RIG
    if kind in ("PinHole", "KannalaBrandt8"):
        names = ("k1", "k2", "p1", "p2") if kind == "PinHole" else ("k1", "k2", "k3", "k4")
        if kind != "PinHole":
            rig = StereoRig(*(Camera(*SIZE, c.K, c.D, "equidistant") for c in (LEFT, RIGHT)), POSE)
        for n, camera in ((1, rig.left), (2, rig.right)):
            lines += [f"Camera{n}.{key}: {float(value)}" for key, value in numbers(camera, names).items()]
        data = [float(x) for x in se3.inverse(POSE).ravel()]
        lines += [f"Stereo.T_c1_c2: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: f\n   data: {data}"]
    else:
        straight = Camera(*SIZE, LEFT.K, (), "none")
        rig = StereoRig(straight, straight, se3.exp([-0.11, 0, 0, 0, 0, 0]))
        name = "Camera1" if kind == "Rectified" else "Camera"
        lines += [f"{name}.{key}: {float(value)}" for key, value in numbers(straight, ()).items()]
        lines += ["Stereo.b: 0.11"] if kind == "Rectified" else [f"Camera.bf: {0.11 * LEFT.K[0, 0]}"]
        if kind != "Rectified":
            lines.remove('Camera.type: "version 2"')
    check(write(tmp_path / "EuRoC.yaml", "\n".join(lines) + "\n"), rig, atol=1e-6)  # floats of 32 bits


def test_arrays_of_numpy(tmp_path):
    pair = {"mtxL": LEFT.K, "distL": np.array([LEFT.D]), "mtxR": RIGHT.K, "distR": np.array([RIGHT.D])}
    np.savez(tmp_path / "stereo.npz", **pair, R=POSE[:3, :3], T=POSE[:3, 3:], imageSize=np.array(SIZE))
    check(tmp_path / "stereo.npz")
    check(tmp_path)
    np.savez(tmp_path / "objects.npz", M1=np.array([{}], dtype=object))
    with pytest.raises(ConfigError, match=r"objects\.npz is not a file of np\.savez with arrays of numbers"):
        StereoRig.from_calibration(tmp_path / "objects.npz")
    for name in ("readme.txt", "M1.npy"):
        with zipfile.ZipFile(tmp_path / "other.npz", "w") as archive:
            archive.writestr(name, b"no array")
        with pytest.raises(ConfigError, match=r"other\.npz is not a file of np\.savez .* in it is not an array"):
            StereoRig.from_calibration(tmp_path / "other.npz")


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_opencv_stereo_calibrate(tmp_path, suffix):
    rectified = {f"{key}{n}": getattr(OF_ROS[n - 1], key) for n in (1, 2) for key in "RP"}
    pair = {"M1": LEFT.K, "D1": np.array([LEFT.D]), "M2": RIGHT.K, "D2": np.array([RIGHT.D])}
    pose = {"R": POSE[:3, :3], "T": POSE[:3, 3:]}
    size = {"image_width": SIZE[0], "image_height": SIZE[1]}
    check(storage(tmp_path / f"all.{suffix}", **pair, **pose, **size))
    folder = tmp_path / "two"
    folder.mkdir()
    files = [
        storage(folder / f"intrinsics.{suffix}", **pair),
        storage(folder / f"extrinsics.{suffix}", **pose, **rectified),
    ]
    check(files, size=SIZE)
    check(folder, size=SIZE)
    with pytest.raises(ConfigError, match="the size of the images is missing: add image_width and image_height"):
        StereoRig.from_calibration(files)
    check(storage(tmp_path / f"rectified.{suffix}", **pair, **size, **rectified))


def test_opencv_names_of_the_documentation(tmp_path):
    names = {"cameraMatrix1": LEFT.K, "distCoeffs1": np.array(LEFT.D), "cameraMatrix2": RIGHT.K}
    names |= {"distCoeffs2": np.array(RIGHT.D), "R": POSE[:3, :3], "T": POSE[:3, 3:], "imageSize": list(SIZE)}
    text = {k: np.asarray(v).tolist() for k, v in names.items()}
    check(write(tmp_path / "stereo.json", json.dumps(text)))


def test_kitti_projections_take_the_size_from_the_images(tmp_path):
    k = np.array([[718.856, 0, 607.1928], [0, 718.856, 185.2157], [0, 0, 1]])
    lines = [f"P{n}: {kitti_projection((x, 0, 0), k)}" for n, x in enumerate((0.0, -0.5372, 0.06, -0.47))]
    path = write(tmp_path / "calib.txt", "\n".join([*lines, f"Tr: {' '.join(['0.1'] * 12)}"]) + "\n")
    camera = Camera(1241, 376, k, (), "none")
    pose = se3.from_rotation_translation(np.eye(3), np.array([-0.5372, 0, 0]))
    check(path, StereoRig(camera, camera, pose), size=(1241, 376))
    with pytest.raises(ConfigError, match="does not contain the size of the images"):
        StereoRig.from_calibration(path)


def test_a_log_tells_the_size_that_a_calibration_does_not(tmp_path):
    k = np.array([[80.0, 0, WIDTH / 2], [0, 80.0, HEIGHT / 2], [0, 0, 1]])
    values = {"M1": k, "D1": np.zeros(5), "M2": k, "D2": np.zeros(5), "R": np.eye(3), "T": np.array([-0.25, 0, 0])}
    path = storage(tmp_path / "stereo.yml", **values)
    log = open_log(write_log(tmp_path / "log.mcap", Spec(infos=(None, None))), calibration=path)
    assert log.rig.baseline_m == pytest.approx(0.25)
    assert (log.rig.left.width, log.rig.left.height) == (WIDTH, HEIGHT)
    assert len(list(log.frames())) == 12
