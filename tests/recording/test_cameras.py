"""Live cameras: RealSense by its package's software device, others by stand-ins of their packages, and by OpenCV.

No such camera has been connected: these tests say that the calls fit together as the makers document them.
"""

import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace as Is
from typing import Any
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.logs.sources.camera import _Grabber
from tests.helpers.places import ROOM
from tests.helpers.same_results import estimate_messages
from tests.helpers.wall import Wall, camera_path, rig

FRAMES = 8
PERIOD_NS = 33_333_333
START_NS = 1_700_000_000_000_000_000
Pictures = list[tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def pictures() -> Pictures:
    return [(frame.left, frame.right) for frame in Wall(5).frames(rig(), camera_path(FRAMES))]


@pytest.fixture(autouse=True)
def _nothing_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand-ins deliver as fast as they are asked."""
    monkeypatch.setattr("stream_sfm.logs.sources.camera.WAITING_PAIRS", FRAMES)


def lens(camera: sfm.Camera, cx: str, cy: str, **more: object) -> Is:
    """Intrinsics, under a maker's names of the principal point."""
    k = camera.K
    return Is(fx=k[0, 0], fy=k[1, 1], **{cx: k[0, 2], cy: k[1, 2]}, **more)


def realsense(pictures: Pictures) -> dict[str, Any]:
    """As librealsense itself: its software device with streams, options, calibration and frames, and its syncer.

    Its pipeline takes real devices only; this one does no more than start and wait.
    """
    rs = pytest.importorskip("pyrealsense2", reason="needs the package pyrealsense2: pip install pyrealsense2")
    device, syncer, log, pose = rs.software_device(), rs.syncer(100), list[str](), rig().right_from_left
    sensor, kept = device.add_sensor("Stereo Module"), list[Any]()
    sensor.add_read_only_option(rs.option.depth_units, 0.001)
    for option in (rs.option.emitter_enabled, rs.option.enable_auto_exposure, rs.option.exposure):
        bounds = rs.option_range()
        bounds.min, bounds.max, bounds.default, bounds.step = 0, 1e5, 1, 1
        sensor.add_option(option, bounds, True)
    profiles = [stream_of(rs, sensor, number) for number in (1, 2)]
    right_from_left = rs.extrinsics()
    right_from_left.rotation, right_from_left.translation = pose[:3, :3].T.ravel().tolist(), pose[:3, 3].tolist()
    profiles[0].register_extrinsics_to(profiles[1], right_from_left)
    device.create_matcher(rs.matchers.default)

    def push(n: int, images: tuple[np.ndarray, ...]) -> None:
        for profile, image in zip(profiles, images, strict=True):
            frame = rs.software_video_frame()
            frame.pixels, frame.stride, frame.bpp, frame.profile = image, image.shape[1], 1, profile
            frame.timestamp, frame.frame_number = (START_NS + n * PERIOD_NS) / 1e6, n + 1
            frame.domain = rs.timestamp_domain.hardware_clock
            kept.append(frame)  # it does not copy the pixels
            sensor.on_video_frame(frame)

    def start(config: object) -> Is:
        assert isinstance(config, rs.config)
        sensor.open(profiles)
        sensor.start(syncer)
        push(-1, pictures[0])  # until it has met both streams, the syncer hands out single images
        for _ in profiles:
            syncer.wait_for_frames(2000)
        return Is(get_device=lambda: device, get_stream=lambda _, number: profiles[number - 1])

    waiting = iter(enumerate(pictures))

    def wait_for_frames(_ms: int) -> Any:
        if (found := next(waiting, None)) is None:
            raise RuntimeError("Frame didn't arrive within 5000")
        push(*found)
        return syncer.wait_for_frames(2000)

    def stop() -> None:
        for option in (rs.option.emitter_enabled, rs.option.exposure):
            log.append(f"{option.name} {sensor.get_option(option):g}")
        sensor.stop()
        log.append("stopped")

    pipeline = Is(start=start, wait_for_frames=wait_for_frames, stop=stop)
    names = {name: getattr(rs, name) for name in ("config", "stream", "format", "option")}
    return {"pyrealsense2": Is(pipeline=lambda: pipeline, log=log, **names)}


def stream_of(rs: Any, sensor: Any, number: int) -> Any:
    """An infrared stream of a software sensor, with the intrinsics of the left (1) or right (2) camera."""
    camera, stream, known = (rig().left, rig().right)[number - 1], rs.video_stream(), rs.intrinsics()
    known.width, known.height, known.fx, known.fy = camera.width, camera.height, camera.K[0, 0], camera.K[1, 1]
    known.ppx, known.ppy, known.coeffs, known.model = *camera.K[:2, 2], [0.0] * 5, rs.distortion.none
    stream.type, stream.index, stream.uid, stream.fmt = rs.stream.infrared, number, number, rs.format.y8
    stream.width, stream.height = camera.width, camera.height
    stream.fps, stream.bpp, stream.intrinsics = 30, 1, known
    return sensor.add_video_stream(stream).as_video_stream_profile()


def oak(pictures: Pictures) -> dict[str, Any]:
    """As depthai 3: queues per camera, of which one begins a picture later; extrinsics in centimetres."""
    log, cameras, pose = list[str](), (rig().left, rig().right), rig().right_from_left.copy()
    pose[:3, 3] *= 100

    def image(n: int, pixels: np.ndarray) -> Is:
        stamp = Is(total_seconds=lambda: n * PERIOD_NS / 1e9)
        return Is(getSequenceNum=lambda: n, getTimestamp=lambda: stamp, getCvFrame=lambda: pixels)

    def build(socket: int) -> Is:
        waiting = iter([image(n, p[socket]) for n, p in enumerate(pictures)][socket:])

        def get() -> Is:
            if (found := next(waiting, None)) is None:
                raise RuntimeError("communication exception: device closed")
            return found

        return Is(requestOutput=lambda *_, fps: Is(createOutputQueue=lambda: Is(get=get)))

    factory = Is(
        getCameraIntrinsics=lambda socket, w, h: cameras[socket].K.tolist(),
        getDistortionCoefficients=lambda socket: [0.0] * 14,
        getCameraExtrinsics=lambda a, b: pose.tolist(),
    )
    pipeline = Is(
        create=lambda _: Is(build=build),
        start=lambda: log.append("started"),
        stop=lambda: log.append("stopped"),
        getDefaultDevice=lambda: Is(readCalibration=lambda: factory),
    )
    names = {
        "node": Is(Camera="camera"),
        "CameraBoardSocket": Is(CAM_B=0, CAM_C=1),
        "ImgFrame": Is(Type=Is(GRAY8="grey")),
        "__version__": "3.1.0",
    }
    return {"depthai": Is(Pipeline=lambda: pipeline, log=log, **names)}


def zed(pictures: Pictures) -> dict[str, Any]:
    """As the ZED SDK 5: one buffer for both views, which the next call overwrites."""
    log, waiting, taken = list[str](), iter(enumerate(pictures)), list[Any]()
    size = Is(width=rig().left.width, height=rig().left.height)
    left, right = (lens(camera, "cx", "cy", image_size=size) for camera in (rig().left, rig().right))
    factory = Is(left_cam=left, right_cam=right, get_camera_baseline=lambda: -rig().right_from_left[0, 3])
    known = Is(camera_configuration=Is(calibration_parameters=factory))
    pixels = np.zeros((size.height, size.width, 1), np.uint8)

    def grab() -> str:
        taken[:] = next(waiting, ())
        return "SUCCESS" if taken else "CAMERA NOT DETECTED"

    def retrieve_image(_buffer: object, view: int) -> None:
        pixels[..., 0] = taken[1][view]

    camera = Is(
        open=lambda _: "SUCCESS", get_camera_information=lambda: known, grab=grab, retrieve_image=retrieve_image,
        get_timestamp=lambda _: Is(get_nanoseconds=lambda: START_NS + taken[0] * PERIOD_NS),
        close=lambda: log.append("stopped"),
    )  # fmt: skip
    module = Is(Camera=lambda: camera, Mat=lambda: Is(get_data=lambda: pixels), InitParameters=Is, log=log)
    module.DEPTH_MODE, module.UNIT = Is(NONE="none"), Is(METER="m")
    module.VIEW, module.ERROR_CODE = Is(LEFT_GRAY=0, RIGHT_GRAY=1), Is(SUCCESS="SUCCESS")
    module.TIME_REFERENCE = Is(IMAGE="image")
    return {"pyzed": Is(sl=module), "pyzed.sl": module}


MAKERS = {"realsense": realsense, "oak": oak, "zed": zed}


@pytest.fixture(params=MAKERS)
def camera(
    request: pytest.FixtureRequest, pictures: Pictures, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[str, list[str]]]:
    """The name of a camera, and what was asked of it; in the end it has been given back."""
    modules = MAKERS[request.param](pictures)
    monkeypatch.setattr("stream_sfm.logs.sources.devices._OAK_SIZE", (rig().left.width, rig().left.height))
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    log = list(modules.values())[-1].log
    yield request.param, log
    assert log[-1] == "stopped"


def test_a_camera_is_estimated_recorded_and_its_recording_replays_to_the_same_bytes(
    camera: tuple[str, list[str]], pictures: Pictures, tmp_path: Path, cli
) -> None:
    name, asked = camera
    out, log = tmp_path / "run", tmp_path / "log.mcap"
    said = cli("live", name, "--out", out, "--record", log, code=3).err  # it has been unplugged
    assert re.search("didn't arrive|device closed|NOT DETECTED", said) and "could not be read" not in said
    if name == "realsense":
        assert asked[-3] == "emitter_enabled 0"
    recorded = sfm.open_log(log)
    assert np.allclose(recorded.rig.right_from_left, rig().right_from_left, atol=1e-7)  # RealSense has single floats
    assert np.allclose(recorded.rig.left.K, rig().left.K)
    expected = pictures[1:] if name == "oak" else pictures  # whose right camera began later
    for frame, images in zip(recorded.frames(), expected, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(frame.images, images, strict=True))
    run = sfm.read_results(out)
    assert len(run) == len(expected) and set(run.statuses[1:]) == {"ok"}
    assert np.allclose(np.diff(run.stamps_ns), PERIOD_NS, atol=512)  # of a double in milliseconds
    cli("replay", log, "--out", tmp_path / "again", "-q")
    assert estimate_messages(tmp_path / "again/estimates.mcap") == estimate_messages(out / "estimates.mcap")


@pytest.mark.parametrize("camera", ["realsense"], indirect=True)  # a stand-in would repeat its settings
def test_a_camera_gets_the_requested_options(camera: tuple[str, list[str]], tmp_path: Path, cli) -> None:
    """Size, rate, serial number and exposure."""
    name, asked = camera
    wanted = ["--size", "320x240", "--rate", "30", "--serial", "123", "--exposure", "4.5"]
    cli("live", name, *wanted, "-q", "--out", tmp_path, code=3)
    assert asked[-2] == "exposure 4500"  # microseconds


def test_a_recording_is_a_camera_at_its_own_pace(tmp_path: Path, cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """It waits as its stamps say, and every byte is that of a replay; the summary says how old pictures were.

    The clock stands still but while it waits, and the queue holds all pairs, so that no load of the machine shows.
    """
    out, frames, waited_s = tmp_path / "run", 8, list[float]()
    clock = Is(monotonic=lambda: 100.0 + sum(waited_s), sleep=waited_s.append)
    monkeypatch.setattr("stream_sfm.logs.recording.stereo_log.time", clock)
    for name in ("WAITING_PAIRS", "_REMEMBERED"):
        monkeypatch.setattr(f"stream_sfm.logs.sources.camera.{name}", 10**6)
    cli("live", ROOM, "--out", out, "--max-frames", frames, "-q")
    run = sfm.read_results(out)
    assert len(run) == frames
    np.testing.assert_allclose(waited_s[:frames], [0, *np.diff(run.stamps_ns) / 1e9], atol=1e-6)
    live = run.summary["live"]
    assert (
        live["left_out"] == 0
        and 0 < live["latency_ms"]["p50"] <= live["latency_ms"]["p99"] <= live["latency_ms"]["max"]
    )
    cli("replay", ROOM, "--out", tmp_path / "again", "--max-frames", frames, "-q")
    again = sfm.read_results(tmp_path / "again")
    assert np.array_equal(again.world_from_cam, run.world_from_cam) and "live" not in again.summary
    assert "is a recording: its size, rate and exposure" in cli("live", ROOM, "--rate", "5", code=2).err


def capture_of(pictures: Pictures) -> Callable[[object], Is]:
    """OpenCV's cameras: 0 and 1 are left and right, 2 holds both; they end after the last picture."""

    def capture(given: object) -> Is:
        waiting, taken = iter(pictures), list[Any]()

        def grab() -> bool:
            taken[:] = [next(waiting, None)]
            return taken[0] is not None

        def retrieve() -> tuple[bool, np.ndarray | None]:
            if taken[0] is None:
                return False, None
            image = np.hstack(taken[0]) if given == 2 else taken[0][int(str(given))]
            return True, cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)

        return Is(isOpened=lambda: given in (0, 1, 2), grab=grab, retrieve=retrieve, release=lambda: None)

    return capture


@pytest.fixture
def webcams(pictures: Pictures, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The calibration of the cameras that OpenCV finds."""
    monkeypatch.setattr("cv2.VideoCapture", capture_of(pictures))
    (tmp_path / "c.toml").write_text(rig().to_toml(), encoding="utf-8")
    return tmp_path / "c.toml"


@pytest.mark.parametrize("names", [("0", "1"), ("2",)])
def test_webcams_are_two_or_one_that_holds_both(names: tuple[str, ...], webcams: Path, pictures: Pictures) -> None:
    with closing(sfm.open_camera(*names, calibration=webcams)) as log:
        found = [frame.images for frame in log.frames()]
        assert log.stats.complete and not log.stats.warnings
    assert len(found) == FRAMES
    assert all(np.array_equal(a, b) for pair, images in zip(found, pictures, strict=True)
               for a, b in zip(pair, images, strict=True))  # fmt: skip


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["7", "--calibration", "c.toml"], 3, "or this is no camera; give its number, such as 0, or one"),
        (["0", "--serial", "5"], 2, "is opened by OpenCV, which knows no serial numbers"),
        (["0", "--size", "640"], 2, "is not a size: give width and height in pixels, such as 640x480"),
        (["0", "--rate", "0"], 2, "'0' is not a number above 0"),
        (["0", "1"], 2, "camera 0 1 has no factory calibration: give one"),
        (["0", "--calibration", "c.toml"], 3, "would be twice as wide or as high"),
        (["oak"], 2, "oak needs the package depthai, which is the extra [oak] of this one"),
    ],
)
def test_missing_parts_are_named(
    words: list[str], code: int, said: str, webcams: Path, monkeypatch: pytest.MonkeyPatch, cli
) -> None:
    monkeypatch.chdir(webcams.parent)
    monkeypatch.setitem(sys.modules, "depthai", None)
    assert said in cli("live", *words, code=code).err
    assert not list(webcams.parent.glob("runs/*"))


@pytest.mark.parametrize(
    ("words", "package"), [("oak", "depthai"), ("oak --serial 12", "depthai"), ("realsense", "pyrealsense2")]
)
def test_a_camera_that_is_not_plugged_in_is_reported(
    words: str, package: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, cli
) -> None:
    def nothing(*_: object) -> None:
        raise RuntimeError("No available devices\n(0 connected)")

    calls = Is(Pipeline=nothing, pipeline=nothing, config=lambda: Is(enable_stream=lambda *_: None), Device=nothing)
    names = Is(stream=Is(infrared=0), format=Is(y8=0), CameraBoardSocket=Is(CAM_B=1, CAM_C=2), __version__="3.1.0")
    monkeypatch.setitem(sys.modules, package, Is(**vars(calls), **vars(names)))
    monkeypatch.chdir(tmp_path)
    said = cli("live", *words.split(), code=3).err
    assert "No available devices" in said and "is it connected" in said
    assert not list(tmp_path.iterdir())


def test_an_older_depthai_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, cli) -> None:
    monkeypatch.setitem(sys.modules, "depthai", Is(__version__="2.33.0.0"))
    assert "oak needs depthai 3, and 2.33.0.0 is installed" in cli("live", "oak", "--out", tmp_path / "o", code=2).err


def test_images_that_come_too_fast_are_recorded_and_reported(
    webcams: Path, pictures: Pictures, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The first picture is taken when all have been delivered, and two of them were kept."""
    monkeypatch.setattr("stream_sfm.logs.sources.camera.WAITING_PAIRS", 2)
    ask = _Grabber.next
    monkeypatch.setattr(_Grabber, "next", lambda self: (self._thread.join(), ask(self))[1])
    with closing(sfm.open_camera("0", "1", calibration=webcams, record=tmp_path / "log.mcap")) as log:
        assert len(list(log.frames())) == 2
        assert log.stats.complete and not log.stats.undecodable
        assert any(f"{FRAMES - 2} pairs of images were left out" in warning for warning in log.stats.warnings)
    assert len(list(sfm.open_log(tmp_path / "log.mcap").frames())) == FRAMES


def test_a_recording_replaces_no_file_unasked(webcams: Path, tmp_path: Path, cli) -> None:
    mine = tmp_path / "holiday.jpg"
    mine.write_bytes(b"mine")
    words = ("live", "0", "1", "--calibration", webcams, "--record", mine, "--out", tmp_path / "run", "-q")
    said = cli(*words, code=3).err
    assert "holiday.jpg exists already" in said and "--force" in said
    assert mine.read_bytes() == b"mine" and not (tmp_path / "run").exists()
    cli(*words, "--force")
    assert len(list(sfm.open_log(mine).frames())) == FRAMES


def test_a_run_that_is_ended_keeps_all_it_has(webcams: Path, tmp_path: Path) -> None:
    """By a sink that has seen enough, as by Ctrl-C: the recording is whole, and so are the results."""
    seen: list[int] = []

    def enough(estimate: sfm.FrameEstimate, _: object) -> None:
        seen.append(estimate.frame_index)
        if len(seen) == 3:
            os.kill(os.getpid(), signal.SIGINT)

    camera = sfm.open_camera("0", "1", calibration=webcams, record=tmp_path / "log.mcap")
    with closing(camera) as log, pytest.raises(sfm.ReplayInterrupted) as stop:
        sfm.replay(log, tmp_path / "run", sinks=[Mock(write=enough)])
    assert len(stop.value.result.trajectory) == len(seen) == 3
    assert len(sfm.read_results(tmp_path / "run")) == 3
    assert len(list(sfm.open_log(tmp_path / "log.mcap").frames())) >= 3
