"""Live cameras by stand-ins of their makers' packages, which deliver the pictures of a recording, and by OpenCV.

No such camera has been connected: these tests say that the calls fit together as the makers document them.
"""

import os
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.cli.main import main
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
    monkeypatch.setattr("stream_sfm.sources.camera.WAITING_PAIRS", FRAMES)


def realsense(pictures: Pictures) -> dict[str, object]:
    """As librealsense 2.56: a pipeline, profiles, milliseconds, rotations column by column."""
    waiting = iter(enumerate(pictures))
    log: list[str] = []

    def lens(camera: sfm.Camera) -> SimpleNamespace:
        k = camera.K
        sizes = {"width": camera.width, "height": camera.height, "ppx": k[0, 2], "ppy": k[1, 2]}
        return SimpleNamespace(fx=k[0, 0], fy=k[1, 1], coeffs=[0.0] * 5, **sizes)

    class Stream:
        def __init__(self, camera: sfm.Camera) -> None:
            self.camera = camera

        def as_video_stream_profile(self) -> "Stream":
            return self

        def get_intrinsics(self) -> SimpleNamespace:
            return lens(self.camera)

        def get_extrinsics_to(self, _other: "Stream") -> SimpleNamespace:
            pose = rig().right_from_left
            return SimpleNamespace(rotation=pose[:3, :3].T.ravel().tolist(), translation=pose[:3, 3].tolist())

    class Frames:
        def __init__(self, n: int, images: tuple[np.ndarray, np.ndarray]) -> None:
            self.n, self.images = n, images

        def get_infrared_frame(self, number: int) -> SimpleNamespace:
            return SimpleNamespace(get_data=lambda: self.images[number - 1])

        def get_timestamp(self) -> float:
            return (START_NS + self.n * PERIOD_NS) / 1e6

    class Pipeline:
        def start(self, _config: object) -> "Pipeline":
            return self

        def get_device(self) -> SimpleNamespace:
            sensor = SimpleNamespace(supports=lambda _: True, set_option=lambda *given: log.append(f"{given}"))
            return SimpleNamespace(first_depth_sensor=lambda: sensor)

        def get_stream(self, _kind: str, number: int) -> Stream:
            return Stream((rig().left, rig().right)[number - 1])

        def wait_for_frames(self, _ms: int) -> Frames:
            found = next(waiting, None)
            if found is None:
                raise RuntimeError("Frame didn't arrive within 5000")
            return Frames(*found)

        def stop(self) -> None:
            log.append("stopped")

    module = SimpleNamespace(
        pipeline=Pipeline,
        config=lambda: SimpleNamespace(enable_stream=lambda *given: log.append(f"{given}")),
        stream=SimpleNamespace(infrared="infrared"),
        format=SimpleNamespace(y8="y8"),
        option=SimpleNamespace(emitter_enabled="emitter"),
        log=log,
    )
    return {"pyrealsense2": module}


def oak(pictures: Pictures) -> dict[str, object]:
    """As depthai 3: queues per camera, of which one begins a picture later; extrinsics in centimetres."""
    log: list[str] = []

    class Image:
        def __init__(self, n: int, image: np.ndarray) -> None:
            self.n, self.image = n, image

        def getSequenceNum(self) -> int:
            return self.n

        def getTimestamp(self) -> SimpleNamespace:
            return SimpleNamespace(total_seconds=lambda: self.n * PERIOD_NS / 1e9)

        def getCvFrame(self) -> np.ndarray:
            return self.image

    class Camera:
        def build(self, socket: int) -> "Camera":
            waiting = iter([Image(n, p[socket]) for n, p in enumerate(pictures)][socket:])

            def get() -> Image:
                if (found := next(waiting, None)) is None:
                    raise RuntimeError("communication exception: device closed")
                return found

            self.queue = SimpleNamespace(get=get)
            return self

        def requestOutput(self, _size: tuple[int, int], _kind: str, fps: int) -> SimpleNamespace:
            log.append(f"{fps}")
            return SimpleNamespace(createOutputQueue=lambda: self.queue)

    cameras, metres = (rig().left, rig().right), rig().right_from_left
    pose = np.block([[metres[:3, :3], 100 * metres[:3, 3:]], [np.zeros((1, 3)), np.ones((1, 1))]])
    factory = SimpleNamespace(
        getCameraIntrinsics=lambda socket, w, h: cameras[socket].K.tolist(),
        getDistortionCoefficients=lambda socket: [0.0] * 14,
        getCameraExtrinsics=lambda a, b: pose.tolist(),
    )
    pipeline = SimpleNamespace(
        create=lambda kind: kind(),
        start=lambda: log.append("started"),
        stop=lambda: log.append("stopped"),
        getDefaultDevice=lambda: SimpleNamespace(readCalibration=lambda: factory),
    )
    module = SimpleNamespace(
        Pipeline=lambda: pipeline,
        node=SimpleNamespace(Camera=Camera),
        CameraBoardSocket=SimpleNamespace(CAM_B=0, CAM_C=1),
        ImgFrame=SimpleNamespace(Type=SimpleNamespace(GRAY8="grey")),
        log=log,
    )
    return {"depthai": module}


def zed(pictures: Pictures) -> dict[str, object]:
    """As the ZED SDK 5: one buffer for both views, which the next call overwrites."""
    log: list[str] = []
    waiting = iter(enumerate(pictures))

    def lens(camera: sfm.Camera) -> SimpleNamespace:
        size = SimpleNamespace(width=camera.width, height=camera.height)
        return SimpleNamespace(
            fx=camera.K[0, 0], fy=camera.K[1, 1], cx=camera.K[0, 2], cy=camera.K[1, 2], image_size=size
        )

    class Mat:
        def __init__(self) -> None:
            self.pixels = np.zeros((rig().left.height, rig().left.width, 1), np.uint8)

        def get_data(self) -> np.ndarray:
            return self.pixels

    class Camera:
        def open(self, _settings: object) -> str:
            return "SUCCESS"

        def get_camera_information(self) -> SimpleNamespace:
            baseline_m = -rig().right_from_left[0, 3]
            factory = SimpleNamespace(
                left_cam=lens(rig().left), right_cam=lens(rig().right), get_camera_baseline=lambda: baseline_m
            )
            return SimpleNamespace(camera_configuration=SimpleNamespace(calibration_parameters=factory))

        def grab(self) -> str:
            found = next(waiting, None)
            if found is None:
                return "CAMERA NOT DETECTED"
            self.n, self.images = found
            return "SUCCESS"

        def retrieve_image(self, buffer: Mat, view: int) -> None:
            buffer.pixels[..., 0] = self.images[view]

        def get_timestamp(self, _which: str) -> SimpleNamespace:
            return SimpleNamespace(get_nanoseconds=lambda: START_NS + self.n * PERIOD_NS)

        def close(self) -> None:
            log.append("stopped")

    module = SimpleNamespace(
        Camera=Camera,
        Mat=Mat,
        InitParameters=SimpleNamespace,
        DEPTH_MODE=SimpleNamespace(NONE="none"),
        UNIT=SimpleNamespace(METER="m"),
        VIEW=SimpleNamespace(LEFT_GRAY=0, RIGHT_GRAY=1),
        ERROR_CODE=SimpleNamespace(SUCCESS="SUCCESS"),
        TIME_REFERENCE=SimpleNamespace(IMAGE="image"),
        log=log,
    )
    return {"pyzed": SimpleNamespace(sl=module), "pyzed.sl": module}


MAKERS = {"realsense": realsense, "oak": oak, "zed": zed}


@pytest.fixture(params=MAKERS)
def camera(
    request: pytest.FixtureRequest, pictures: Pictures, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[str, list[str]]]:
    """The name of a camera, and what was asked of it; in the end it has been given back."""
    modules = MAKERS[request.param](pictures)
    monkeypatch.setattr("stream_sfm.sources.devices._OAK_SIZE", (rig().left.width, rig().left.height))
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    log = list(modules.values())[-1].log  # type: ignore[attr-defined]
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
        assert "('emitter', 0)" in asked and len([a for a in asked if "infrared" in a]) == 2
    recorded = sfm.open_log(log)
    assert np.allclose(recorded.rig.right_from_left, rig().right_from_left, atol=1e-9)
    assert np.allclose(recorded.rig.left.K, rig().left.K)
    expected = pictures[1:] if name == "oak" else pictures  # whose right camera began later
    for frame, images in zip(recorded.frames(), expected, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(frame.images, images, strict=True))
    run = sfm.read_results(out)
    assert len(run) == len(expected) and set(run.statuses[1:]) == {"ok"}
    assert np.allclose(np.diff(run.stamps_ns), PERIOD_NS, atol=512)  # of a double in milliseconds
    cli("replay", log, "--out", tmp_path / "again", "-q")
    assert estimate_messages(tmp_path / "again/estimates.mcap") == estimate_messages(out / "estimates.mcap")


class Captures:
    """OpenCV's cameras: 0 and 1 are left and right, 2 holds both; they end after the last picture."""

    pictures: ClassVar[Pictures] = []

    def __init__(self, given: object) -> None:
        self.given, self.n = given, -1

    def isOpened(self) -> bool:
        return self.given in (0, 1, 2)

    def grab(self) -> bool:
        self.n += 1
        return self.n < len(self.pictures)

    def retrieve(self) -> tuple[bool, np.ndarray | None]:
        if self.n >= len(self.pictures):
            return False, None
        pair = self.pictures[self.n]
        image = np.hstack(pair) if self.given == 2 else pair[int(str(self.given))]
        return True, cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)

    def release(self) -> None:
        pass


@pytest.fixture
def webcams(pictures: Pictures, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The calibration of the cameras that OpenCV finds."""
    monkeypatch.setattr(Captures, "pictures", pictures)
    monkeypatch.setattr("cv2.VideoCapture", Captures)
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
        (
            ["live", "7", "--calibration", "c.toml"],
            3,
            "camera 7 cannot be opened: give its number, such as 0, or one",
        ),
        (["live", "0", "1"], 2, "camera 0 1 has no calibration of its own: give one"),
        (["live", "0", "--calibration", "c.toml"], 3, "would be twice as wide or as high"),
        (["live", "oak"], 2, "oak needs the package depthai, which is the extra [oak] of this one"),
    ],
)
def test_what_is_missing_is_named(
    words: list[str], code: int, said: str, webcams: Path, monkeypatch: pytest.MonkeyPatch, capfd
) -> None:
    monkeypatch.chdir(webcams.parent)
    monkeypatch.setitem(sys.modules, "depthai", None)
    assert main(words) == code
    assert said in capfd.readouterr().err
    assert not list(webcams.parent.glob("runs/*"))


def test_what_comes_too_fast_is_recorded_and_told(
    webcams: Path, pictures: Pictures, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The first picture is taken when all have been delivered, and two of them were kept."""
    monkeypatch.setattr("stream_sfm.sources.camera.WAITING_PAIRS", 2)
    monkeypatch.setattr("stream_sfm.sources.camera._Grabber.next", slowly(FRAMES))
    with closing(sfm.open_camera("0", "1", calibration=webcams, record=tmp_path / "log.mcap")) as log:
        assert len(list(log.frames())) == 2
        assert log.stats.complete and not log.stats.undecodable
        assert any(f"{FRAMES - 2} pairs of images were left out" in warning for warning in log.stats.warnings)
    assert len(list(sfm.open_log(tmp_path / "log.mcap").frames())) == FRAMES


def slowly(frames: int):
    """Asks for the next picture only when the camera has delivered all."""
    from stream_sfm.sources.camera import _Grabber

    ask = _Grabber.next

    def later(self: _Grabber):
        self._thread.join()
        return ask(self)

    return later


def test_a_run_that_is_ended_keeps_all_it_has(webcams: Path, tmp_path: Path) -> None:
    """By a sink that has seen enough, as by Ctrl-C: the recording is whole, and so are the results."""
    seen: list[int] = []

    class Enough:
        def write(self, estimate: sfm.FrameEstimate, frame: sfm.StereoFrame) -> None:
            seen.append(estimate.frame_index)
            if len(seen) == 3:
                os.kill(os.getpid(), signal.SIGINT)

        def close(self) -> None:
            pass

    camera = sfm.open_camera("0", "1", calibration=webcams, record=tmp_path / "log.mcap")
    with closing(camera) as log, pytest.raises(sfm.ReplayInterrupted) as stop:
        sfm.replay(log, tmp_path / "run", sinks=[Enough()])
    assert len(stop.value.result.trajectory) == len(seen) == 3
    assert len(sfm.read_results(tmp_path / "run")) == 3
    assert len(list(sfm.open_log(tmp_path / "log.mcap").frames())) >= 3
