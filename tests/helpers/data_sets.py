"""Small recordings laid out like KITTI's, EuRoC's, and like people's own folders of images."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

RNG = np.random.default_rng(5)
WIDTH, HEIGHT = 64, 48
K = np.array([[60.0, 0, 31], [0, 61.0, 24], [0, 0, 1]])
KITTI_K = np.array([[70.0, 0, 32], [0, 70.0, 24], [0, 0, 1]])
EUROC_CAMERA = Camera(
    WIDTH, HEIGHT, np.array([[60.1, 0, 31.5], [0, 60.2, 23.5], [0, 0, 1]]), (-0.28, 0.07, 0.0002, 1.7e-05)
)
EUROC_STAMPS_NS = [1403636579763555584 + n * 50_000_000 for n in range(3)]
RIGHT_FROM_LEFT = se3.exp([-0.11, 0.001, 0.002, 0.01, -0.02, 0.005])
BODY_FROM_LEFT = se3.exp([0.02, -0.06, 0.01, 0.1, 0.2, 1.5])


def camera_pair(right_from_left: np.ndarray | None = None) -> StereoRig:
    """A rig of two cameras without distortion, of the size of the images here."""
    pose = se3.exp([-0.2, 0, 0, 0, 0.05, 0]) if right_from_left is None else right_from_left
    return StereoRig(Camera(WIDTH, HEIGHT, K), Camera(WIDTH, HEIGHT, K), pose)


def write_picture(path: Path, suffix: str = ".png") -> Path:
    """An image of noise."""
    path.parent.mkdir(parents=True, exist_ok=True)
    grey = RNG.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
    path.write_bytes(cv2.imencode(suffix, grey)[1].tobytes())
    return path


def write_image_folders(folder: Path, names: Sequence[str], sides: Sequence[str] = ("left", "right")) -> None:
    """Images of these names in both folders."""
    for side in sides:
        for name in names:
            write_picture(folder / side / name)


def write_kitti(
    folder: Path,
    images: tuple[str, str] = ("image_0", "image_1"),
    offsets: Sequence[Sequence[float]] = ((0, 0, 0), (-0.54, 0, 0)),
) -> np.ndarray:
    """A sequence of three frames; returns the poses of camera 0."""
    first = int(images[0][-1])
    folder.mkdir(parents=True)
    rows = [f"P{first + i}: {kitti_projection(offset)}\n" for i, offset in enumerate(offsets)]
    (folder / "calib.txt").write_text("".join(rows))
    (folder / "times.txt").write_text("0.000000e+00\n1.036224e-01\n2.072869e-01\n")
    for name in images:
        for n in range(3):
            write_picture(folder / name / f"{n:06d}.png")
    poses = se3.exp(RNG.normal(size=(3, 6)) * 0.2)
    poses[0] = np.eye(4)
    (folder / "poses.txt").write_text("".join(f"{numbers(pose[:3])}\n" for pose in poses))
    return poses


def numbers(values: np.ndarray) -> str:
    """In one line, exact."""
    return " ".join(map(repr, np.ravel(values).astype(float).tolist()))


def kitti_projection(offset_m: Sequence[float], k: np.ndarray = KITTI_K) -> str:
    """The projection of a rectified camera that is moved by so much, as KITTI writes it."""
    return numbers(k @ np.c_[np.eye(3), offset_m])


def write_euroc(folder: Path) -> np.ndarray:
    """A recording of three left and two right images; returns the four poses of the body."""
    mav = folder / "mav0"
    body_from_right = BODY_FROM_LEFT @ se3.inverse(RIGHT_FROM_LEFT)
    for name, pose in (("cam0", BODY_FROM_LEFT), ("cam1", body_from_right)):
        (mav / name).mkdir(parents=True)
        (mav / name / "sensor.yaml").write_text(sensor_yaml(EUROC_CAMERA, pose))
        kept = EUROC_STAMPS_NS if name == "cam0" else EUROC_STAMPS_NS[:2]
        table = "".join(f"{s},{s}.png\r\n" for s in kept)
        (mav / name / "data.csv").write_text("#timestamp [ns],filename\r\n" + table, newline="")
        for s in kept:
            write_picture(mav / name / "data" / f"{s}.png")
    world_from_body = se3.exp(RNG.normal(size=(4, 6)))
    (mav / "state_groundtruth_estimate0").mkdir()
    stamps = [EUROC_STAMPS_NS[0] - 5, *EUROC_STAMPS_NS]
    write_euroc_truth(mav / "state_groundtruth_estimate0" / "data.csv", stamps, world_from_body)
    return world_from_body


def write_euroc_truth(path: Path, stamps_ns: Sequence[int], world_from_body: np.ndarray) -> Path:
    """A table of ground truth: stamp, position, quaternion w first, velocity."""
    places, quats = (
        world_from_body[:, :3, 3].tolist(),
        se3.quat_xyzw_from_matrix(world_from_body[:, :3, :3]).tolist(),
    )
    rows = [[s, *p, q[3], *q[:3], 0.1, 0.0, 0.0] for s, p, q in zip(stamps_ns, places, quats, strict=True)]
    path.write_text("#timestamp, p_RS_R_x [m], …\n" + "\n".join(",".join(map(repr, row)) for row in rows))
    return path


def intrinsics(camera: Camera) -> list[float]:
    """Focal lengths and centre, in the order of Kalibr and EuRoC."""
    return camera.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()


def sensor_yaml(camera: Camera, body_from_cam: np.ndarray) -> str:
    """A sensor file of EuRoC, with comments and a matrix over several lines."""
    data = ",\n         ".join(", ".join(repr(float(x)) for x in row) for row in body_from_cam)
    return (
        "#Default calibration\nsensor_type: camera\ncomment: VI-Sensor cam (MT9M034)\n\n# Sensor extrinsics\n"
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{data}]\n\nrate_hz: 20\n"
        f"resolution: [{camera.width}, {camera.height}]\ncamera_model: pinhole\n"
        f"intrinsics: {intrinsics(camera)} #fu, fv, cu, cv\n"
        f"distortion_model: radial-tangential\ndistortion_coefficients: {list(camera.D)}\n"
    )


def kalibr(
    cameras: Sequence[Camera],
    second_from_first: np.ndarray | None = None,
    from_imu: Sequence[np.ndarray] = (),
    lens: str = "radtan",
) -> str:
    """A camchain of Kalibr, with the pose of the second camera from the first, or of both from an IMU."""
    text = ""
    for n, c in enumerate(cameras):
        text += (
            f"cam{n}:\n  cam_overlaps: [{1 - n}]\n  camera_model: pinhole\n  distortion_coeffs: {list(c.D[:4])}\n"
            f"  distortion_model: {lens}\n  intrinsics: {intrinsics(c)}\n  resolution: [{c.width}, {c.height}]\n"
            f"  rostopic: /cam{n}/image_raw\n"
        )
        if len(from_imu):
            text += f"  T_cam_imu:\n{matrix_rows(from_imu[n])}\n"
        elif n and second_from_first is not None:
            text += f"  T_cn_cnm1:\n{matrix_rows(second_from_first)}\n"
    return text


def matrix_rows(matrix: np.ndarray) -> str:
    return "\n".join(f"  - {row.tolist()}" for row in matrix)


def write_tum_vi(folder: Path) -> np.ndarray:
    """As TUM-VI in EuRoC's form: no sensor.yaml, one camchain beside mav0, poses of the body by motion capture."""
    poses = write_euroc(folder)
    mav = folder / "mav0"
    for name in ("cam0", "cam1"):
        (mav / name / "sensor.yaml").unlink()
    (mav / "state_groundtruth_estimate0").rename(mav / "mocap0")
    bent = replace(EUROC_CAMERA, D=(0.003, 0.0007, -0.002, 0.0002), distortion_model="equidistant")
    from_body = [se3.inverse(BODY_FROM_LEFT), RIGHT_FROM_LEFT @ se3.inverse(BODY_FROM_LEFT)]
    (folder / "dso").mkdir()
    (folder / "dso" / "camchain.yaml").write_text(kalibr((bent, bent), from_imu=from_body, lens="equidistant"))
    return poses


def write_kitti_raw(date: Path) -> Path:
    """As a synchronised, rectified drive of KITTI's raw data; beside it the calibration, with rows of other kinds."""
    drive = date / f"{date.name}_drive_0001_sync"
    for n in (0, 1):
        for i in range(3):
            write_picture(drive / f"image_0{n}" / "data" / f"{i:010d}.png")
        times = "".join(f"2011-09-26 13:02:25.{t}\n" for t in ("594360375", "697915000", "801500000"))
        (drive / f"image_0{n}" / "timestamps.txt").write_text(times)
    rows = ["calib_time: 09-Jan-2012 13:57:47", "corner_dist: 9.950000e-02"]
    for n, x in enumerate((0.0, -0.54)):
        rows += [f"S_0{n}: 1.392000e+03 5.120000e+02", f"D_0{n}: -3.7e-01 2.0e-01 1.3e-03 1.2e-03 -7.2e-02"]
        rows += [f"S_rect_0{n}: 6.4e+01 4.8e+01", f"P_rect_0{n}: {kitti_projection((x, 0, 0))}"]
    (date / "calib_cam_to_cam.txt").write_text("\n".join(rows) + "\n")
    return drive


def write_tartanair(folder: Path, names: tuple[str, str, str]) -> np.ndarray:
    """A trajectory of three frames; returns the poses of the camera in the first one, in its own axes."""
    camera_path = se3.exp(np.array([[0, 0, 0, 0, 0, 0], [0.1, 0, 0.3, 0, 0.1, 0], [0.2, 0.1, 0.6, 0.1, 0.2, 0]]))
    for n in range(3):
        for name in names[:2]:
            write_picture(folder / name / f"{n:06d}_{name.split('_')[1]}.png")
    body_from_cam = se3.from_rotation_translation(np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0.0]]), np.zeros(3))
    ned = body_from_cam @ camera_path @ se3.inverse(body_from_cam)
    quats = se3.quat_xyzw_from_matrix(ned[:, :3, :3])
    (folder / names[2]).write_text("".join(f"{numbers(row)}\n" for row in np.c_[ned[:, :3, 3], quats]))
    return camera_path
