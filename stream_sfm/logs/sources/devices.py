"""Stereo cameras by name: OpenCV's, RealSense, OAK and ZED, each through its package, which is imported when needed.

A device is a rig and a function that waits for the next pair of images. To add one, add a function and a line in
`OPEN`.
"""

import time
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...camera.calibration.document import camera_matrix
from ...camera.models import Camera
from ...camera.rig import StereoRig
from ...errors import ConfigError, LogError
from ...geometry import se3

Image = NDArray[np.uint8]
Grab = Callable[[], tuple[int, Image, Image] | None]
_OAK_SIZE = 640, 400  # half the resolution of its sensors, binned
_OAK_VERSION = 3  # of depthai: the first whose cameras are built by `build`
_OAK_ISO = 400  # gain for a manual exposure: depthai takes both together
# Sizes of ZED's images by the names in its SDK.
_ZED_SIZES = {
    (2208, 1242): "HD2K", (1920, 1200): "HD1200", (1920, 1080): "HD1080", (1280, 720): "HD720", (960, 600): "SVGA",
    (672, 376): "VGA",
}  # fmt: skip
WAIT_S = 5  # longest wait for an image, after which the camera is considered gone


class Device(NamedTuple):
    """An open camera: its factory calibration, if it has one; `grab` waits for the next pair, None at the end.

    `grab` returns the stamp in nanoseconds and the images of left and right, grey or blue, green, red.
    """

    rig: StereoRig | None
    grab: Grab
    close: Callable[[], object]


class CameraOptions(NamedTuple):
    """Options requested from a camera; None: its default. `size`: (width, height) of each image."""

    size: tuple[int, int] | None = None
    rate_hz: float | None = None
    serial: str | None = None
    exposure_ms: float | None = None

    @property
    def rate(self) -> int:
        """Frames per second, a whole number as the manufacturers' packages require."""
        return round(self.rate_hz or 30)


def open_device(names: Sequence[str], rig: StereoRig | None, options: CameraOptions | None = None) -> Device:
    """Open `realsense`, `oak`, `zed`, or one or two cameras or streams of OpenCV. Raises ConfigError, LogError.

    `rig` gives the size of the images if one camera delivers both of them in one.
    """
    options = options or CameraOptions()
    if len(names) == 1 and (known := OPEN.get(names[0].lower())) is not None:
        try:
            return known(options)
        except (RuntimeError, OSError) as error:  # of the manufacturer's package
            reason = " ".join(str(error).split())
            cure = "is it connected, permitted, and not in use?"
            raise LogError(f"camera {names[0]} cannot be opened: {reason}; {cure}") from None
    return _opencv(names, rig, options)


def _opencv(names: Sequence[str], rig: StereoRig | None, options: CameraOptions) -> Device:
    """Open cameras by number, by a device file, or by the address of a stream: all that OpenCV opens."""
    import cv2

    if len(names) not in (1, 2):
        raise ConfigError(f"{len(names)} cameras were given: give one that holds both images, or left and right")
    if options.serial:
        raise ConfigError(f"camera {names[0]} is opened by OpenCV, which knows no serial numbers: give its device")
    logging = cv2.utils.logging
    level_before = logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # errors are reported below
    try:
        captures = [cv2.VideoCapture(int(name) if name.isdecimal() else name) for name in names]
    finally:
        logging.setLogLevel(level_before)
    for name, capture in zip(names, captures, strict=True):
        if not capture.isOpened():
            raise LogError(
                f"camera {name} cannot be opened: it is not connected, in use or not permitted, or this is no camera; "
                f"give its number, such as 0, or one of {', '.join(OPEN)}"
            )

        _ask(capture, options, sides=3 - len(names))

    def grab() -> tuple[int, Image, Image] | None:
        grabbed, stamp_ns = [capture.grab() for capture in captures], time.time_ns()
        if not all(grabbed):
            return None
        images = [np.asarray(image, np.uint8) for good, image in (c.retrieve() for c in captures) if good]
        if len(images) < len(captures):
            return None
        left, right = images if len(images) == 2 else halves(images[0], rig, " ".join(names))
        return stamp_ns, left, right

    def close() -> None:
        for capture in captures:
            capture.release()

    return Device(None, grab, close)


def _ask(capture: Any, options: CameraOptions, sides: int) -> None:
    """Set options of an OpenCV camera that delivers the images of this many `sides`; drivers apply what they can."""
    import cv2

    if options.size:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, sides * options.size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, options.size[1])
    if options.rate_hz:
        capture.set(cv2.CAP_PROP_FPS, options.rate_hz)
    if options.exposure_ms:
        capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, 1)  # 1 is manual, for Video4Linux
        capture.set(cv2.CAP_PROP_EXPOSURE, 10 * options.exposure_ms)  # in units of 0.1 ms there


def halves(image: NDArray[Any], rig: StereoRig | None, name: str) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the left and right image in one that holds both, side by side or stacked. Raises LogError."""
    height, width = image.shape[:2]
    size = None if rig is None else (rig.left.width, rig.left.height)
    for axis, half in ((1, (width // 2, height)), (0, (width, height // 2))):
        if half == size or (size is None and axis == (0 if height > width else 1)):
            left, right = np.split(image, 2, axis)
            return left, right
    problem = f"images are {width}×{height}, and two of the calibrated {size} would be twice as wide or as high"
    cure = "give the calibration of these images, or two cameras"
    raise LogError(f"{name}: {problem}: {cure}", hint=("calibration",))


def _realsense(options: CameraOptions) -> Device:
    """Open the two infrared cameras of a RealSense D400, rectified by the device."""
    rs = _package("pyrealsense2", "realsense")
    pipeline, config = rs.pipeline(), rs.config()
    if options.serial:
        config.enable_device(options.serial)
    for number in (1, 2):
        config.enable_stream(rs.stream.infrared, number, *(options.size or (640, 480)), rs.format.y8, options.rate)
    profile = pipeline.start(config)
    sensor = profile.get_device().first_depth_sensor()
    if sensor.supports(rs.option.emitter_enabled):  # its dots would move with the camera
        sensor.set_option(rs.option.emitter_enabled, 0)
    if options.exposure_ms:
        sensor.set_option(rs.option.enable_auto_exposure, 0)
        sensor.set_option(rs.option.exposure, 1000 * options.exposure_ms)  # microseconds
    sides = [profile.get_stream(rs.stream.infrared, n).as_video_stream_profile() for n in (1, 2)]
    cameras = [
        Camera(i.width, i.height, camera_matrix(i.fx, i.fy, i.ppx, i.ppy), tuple(i.coeffs))
        for i in (side.get_intrinsics() for side in sides)
    ]
    pose = sides[0].get_extrinsics_to(sides[1])
    rotation = np.reshape(pose.rotation, (3, 3)).T  # column by column
    rig = StereoRig(cameras[0], cameras[1], se3.from_rotation_translation(rotation, pose.translation))

    def grab() -> tuple[int, Image, Image] | None:
        frames = pipeline.wait_for_frames(1000 * WAIT_S)
        left, right = (np.array(frames.get_infrared_frame(n).get_data(), np.uint8) for n in (1, 2))
        return round(frames.get_timestamp() * 1e6), left, right  # from milliseconds

    return Device(rig, grab, pipeline.stop)


def _oak(options: CameraOptions) -> Device:
    """Open the two grey cameras of an OAK-D, not rectified."""
    dai = _package("depthai", "oak")
    if int(dai.__version__.split(".")[0]) < _OAK_VERSION:
        raise ConfigError(f"oak needs depthai {_OAK_VERSION}, and {dai.__version__} is installed: update it")
    sockets = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
    width, height = options.size or _OAK_SIZE
    queues = []
    pipeline = dai.Pipeline(dai.Device(options.serial)) if options.serial else dai.Pipeline()
    for socket in sockets:
        camera = pipeline.create(dai.node.Camera).build(socket)
        if options.exposure_ms:
            camera.initialControl.setManualExposure(round(1000 * options.exposure_ms), _OAK_ISO)
        output = camera.requestOutput((width, height), dai.ImgFrame.Type.GRAY8, fps=options.rate)
        queues.append(output.createOutputQueue())
    pipeline.start()
    factory = pipeline.getDefaultDevice().readCalibration()
    cameras = []
    for socket in sockets:
        k = np.array(factory.getCameraIntrinsics(socket, width, height))
        d = np.array(factory.getDistortionCoefficients(socket))[:8]  # then thin prism and tilt, which are zero
        cameras.append(Camera(width, height, k, tuple(d), "rational_polynomial"))
    pose = np.array(factory.getCameraExtrinsics(*sockets), dtype=float)
    pose[:3, 3] /= 100  # from centimetres
    rig = StereoRig(cameras[0], cameras[1], se3.orthonormalise(pose))

    def grab() -> tuple[int, Image, Image] | None:
        pair = [queue.get() for queue in queues]
        while (behind := pair[0].getSequenceNum() - pair[1].getSequenceNum()) != 0:
            late = 1 if behind > 0 else 0
            pair[late] = queues[late].get()
        left, right = (np.array(image.getCvFrame(), np.uint8) for image in pair)
        return round(pair[0].getTimestamp().total_seconds() * 1e9), left, right

    return Device(rig, grab, pipeline.stop)


def _zed(options: CameraOptions) -> Device:
    """Open both cameras of a ZED in grey, rectified by its own software; depth is not computed."""
    sl = _package("pyzed.sl", "zed")
    camera, settings = sl.Camera(), sl.InitParameters()
    settings.camera_fps, settings.depth_mode = options.rate, sl.DEPTH_MODE.NONE
    settings.coordinate_units = sl.UNIT.METER
    if options.serial:
        settings.set_from_serial_number(int(options.serial))
    if options.size:
        if (name := _ZED_SIZES.get(options.size)) is None:
            sizes = ", ".join(f"{width}×{height}" for width, height in _ZED_SIZES)
            raise ConfigError(f"a ZED has no images of {options.size[0]}×{options.size[1]}: give one of {sizes}")
        settings.camera_resolution = getattr(sl.RESOLUTION, name)
    if (status := camera.open(settings)) != sl.ERROR_CODE.SUCCESS:
        raise LogError(f"ZED: {status}")
    if options.exposure_ms:  # per cent of the time between two images
        share = round(min(100.0, options.exposure_ms * options.rate / 10))
        camera.set_camera_settings(sl.VIDEO_SETTINGS.EXPOSURE, share)
    factory = camera.get_camera_information().camera_configuration.calibration_parameters
    cameras = [
        Camera(c.image_size.width, c.image_size.height, camera_matrix(c.fx, c.fy, c.cx, c.cy))
        for c in (factory.left_cam, factory.right_cam)
    ]
    rig = StereoRig(cameras[0], cameras[1], se3.exp([-factory.get_camera_baseline(), 0, 0, 0, 0, 0]))
    buffer = sl.Mat()

    def grab() -> tuple[int, Image, Image] | None:
        if (status := camera.grab()) != sl.ERROR_CODE.SUCCESS:
            raise LogError(f"ZED: {status}")
        images = []
        for view in (sl.VIEW.LEFT_GRAY, sl.VIEW.RIGHT_GRAY):
            camera.retrieve_image(buffer, view)
            images.append(np.array(buffer.get_data(), np.uint8))
        return camera.get_timestamp(sl.TIME_REFERENCE.IMAGE).get_nanoseconds(), images[0], images[1]

    return Device(rig, grab, camera.close)


OPEN: dict[str, Callable[[CameraOptions], Device]] = {"realsense": _realsense, "oak": _oak, "zed": _zed}


def _package(name: str, extra: str) -> Any:
    """Import a package of a manufacturer. Raises ConfigError if it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        how = "comes with the ZED SDK" if extra == "zed" else f"is the extra [{extra}] of this one"
        raise ConfigError(f"{extra} needs the package {name}, which {how}") from None
