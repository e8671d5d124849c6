"""Videos written by OpenCV are replayed directly: every image, its time, its side."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.logs.recording.stereo_log import StereoLog
from tests.helpers.wall import Wall, camera_path, rig

FRAMES, RATE_HZ = 6, 25.0
FFV1 = cv2.VideoWriter.fourcc(*"FFV1")  # lossless
Pairs = list[tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def pairs() -> Pairs:
    return [(frame.left, frame.right) for frame in Wall(5).frames(rig(), camera_path(FRAMES))]


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    (tmp_path / "c.toml").write_text(rig().to_toml())
    return tmp_path / "c.toml"


def write(path: Path, images: list[np.ndarray], codec: int = FFV1) -> Path:
    height, width = images[0].shape
    path.parent.mkdir(exist_ok=True)
    writer = cv2.VideoWriter(str(path), codec, RATE_HZ, (width, height))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no such video")
    for image in images:
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def assert_same_frames(log: StereoLog, pairs: Pairs) -> None:
    frames = list(log.frames())
    # times of videos are whole milliseconds
    assert np.allclose([f.stamp_ns for f in frames], np.arange(len(pairs)) * 1e9 / RATE_HZ, atol=1e6)
    for frame, images in zip(frames, pairs, strict=True):
        # Lossless except for the way from grey to YUV and back.
        assert all(abs(a.astype(int) - b).max() <= 2 for a, b in zip(frame.images, images, strict=True))


@pytest.mark.parametrize("ending", [".mkv", ".avi"])
def test_a_folder_with_a_video_of_each_side(ending: str, pairs: Pairs, calibration: Path, tmp_path: Path) -> None:
    for n, side in enumerate(("left", "right")):
        write(tmp_path / f"v/{side}{ending}", [p[n] for p in pairs])
    log = sfm.open_log(tmp_path / "v", calibration=calibration)
    assert_same_frames(log, pairs)
    assert log.stats.complete


def test_the_calibration_beside_the_videos_is_theirs(pairs: Pairs, tmp_path: Path) -> None:
    for n, side in enumerate(("cam0", "cam1")):
        write(tmp_path / f"v/{side}.mkv", [p[n] for p in pairs])
    (tmp_path / "v/rig.toml").write_text(rig().to_toml())
    log = sfm.open_log(tmp_path / "v")
    assert_same_frames(log, pairs)
    assert log.rig.baseline_m == pytest.approx(rig().baseline_m) and log.stats.complete
    (tmp_path / "v/rig.toml").write_text("[left]\n")  # a broken one: that which is given goes before it
    assert_same_frames(sfm.open_log(tmp_path / "v", calibration=rig()), pairs)


def test_packets_of_mpeg_ts(pairs: Pairs, tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    for n, side in enumerate(("left", "right")):
        with av.open(str(tmp_path / f"{side}.ts"), "w") as container:
            stream = container.add_stream("mpeg2video", rate=25, options={"qscale": "1", "g": "1"})
            stream.height, stream.width = pairs[0][n].shape
            pictures = [av.VideoFrame.from_ndarray(pair[n], format="gray").reformat(format="yuv420p") for pair in pairs]
            for picture in (*pictures, None):
                container.mux(stream.encode(picture))
    log = sfm.open_log(tmp_path, calibration=rig())
    read = [np.asarray(frame.left, int) for frame in log.frames()]
    assert len(read) == len(pairs)
    assert all(np.abs(image - pair[0]).mean() < 5 for image, pair in zip(read, pairs, strict=True))


def test_a_video_whose_frames_cannot_be_decoded(pairs: Pairs, tmp_path: Path) -> None:
    """Its container can be opened, as that of AV1 where OpenCV has no decoder of it."""
    for n, side in enumerate(("left", "right")):
        video = write(tmp_path / f"{side}.avi", [p[n] for p in pairs])
        video.write_bytes(video.read_bytes().replace(b"FFV1", b"XYZ9"))
    with pytest.raises(sfm.LogError, match=r"left\.avi is not a video that OpenCV can decode: convert it"):
        sfm.open_log(tmp_path, calibration=rig())


@pytest.mark.parametrize("axis", [0, 1])
def test_a_video_that_holds_both_images(axis: int, pairs: Pairs, calibration: Path, tmp_path: Path, cli) -> None:
    both = write(tmp_path / "both.mkv", [np.concatenate(p, axis) for p in pairs])
    log = sfm.open_log(both, calibration=calibration)
    assert_same_frames(log, pairs)
    assert log.stats.complete
    topics = log.left_topic, log.right_topic
    exchanged = sfm.open_log(both, topics[1], topics[0], calibration=calibration)
    assert_same_frames(exchanged, [p[::-1] for p in pairs])
    cli("replay", both, "--calibration", calibration, "--out", tmp_path / "run", "-q")
    assert set(sfm.read_results(tmp_path / "run").statuses[1:]) == {"ok"}
    assert "/camera/left/image" in cli("inspect", both, "--calibration", calibration).out


def test_one_side_that_ends_early_is_reported(pairs: Pairs, calibration: Path, tmp_path: Path) -> None:
    write(tmp_path / "v/l.mkv", [p[0] for p in pairs])
    write(tmp_path / "v/r.mkv", [p[1] for p in pairs[:-3]])
    log = sfm.open_log(tmp_path / "v", calibration=calibration)
    assert len(list(log.pairs())) == FRAMES - 3
    assert log.stats.warnings == ["3 left and 0 right images have no partner within half a frame period"]


def test_times_that_do_not_grow_are_those_of_the_rate(pairs: Pairs, calibration: Path, tmp_path: Path, monkeypatch):
    both = write(tmp_path / "both.mkv", [np.hstack(p) for p in pairs])
    real = cv2.VideoCapture

    class WithoutTimes:
        def __init__(self, path: str) -> None:
            self._inside = real(path)

        def __getattr__(self, name: str):
            return getattr(self._inside, name)

        def get(self, what: int) -> float:
            return 0.0 if what == cv2.CAP_PROP_POS_MSEC else self._inside.get(what)

    monkeypatch.setattr("cv2.VideoCapture", WithoutTimes)
    log = sfm.open_log(both, calibration=calibration)
    assert_same_frames(log, pairs)
    assert log.stats.complete and any("its rate is used, 25 Hz" in w for w in log.stats.warnings)


@pytest.mark.parametrize(("ending", "codec"), [(".mkv", "FFV1"), (".avi", "FFV1"), (".mp4", "mp4v")])
def test_a_video_without_a_calibration_is_distinguished_from_damage(
    ending: str, codec: str, pairs: Pairs, tmp_path, cli
):
    video = write(tmp_path / f"v{ending}", [p[0] for p in pairs], codec=cv2.VideoWriter.fourcc(*codec))
    said = cli("replay", video, "--out", tmp_path / "out", code=3).err
    assert "is a video: give the calibration of its images" in said and "--calibration" in said
    (tmp_path / f"t{ending}").write_bytes(video.read_bytes()[:100])
    said = cli("inspect", tmp_path / f"t{ending}", code=3).err
    assert f"t{ending} is not a video that OpenCV can decode: convert it" in said


def test_a_folder_with_one_video_of_both_sides_or_with_two_of_any_name(pairs: Pairs, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text(rig().to_toml())
    write(tmp_path / "v/GX010012.mkv", [np.hstack(images) for images in pairs])
    log = sfm.open_log(tmp_path / "v")
    assert_same_frames(log, pairs)
    assert any("c.toml" in warning for warning in log.stats.warnings)
    write(tmp_path / "v/GX010077.mkv", [right for _, right in pairs])
    with pytest.raises(sfm.LogError, match=r"GX010012\.mkv, .*GX010077\.mkv.*name them left\.mp4") as refused:
        sfm.open_log(tmp_path / "v")
    assert not refused.value.hint  # images are imported, videos are not


@pytest.mark.parametrize("name", ["a.svo", "a.svo2"])
def test_a_recording_of_a_zed_says_what_to_do(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes((b"SVO" if name == "a.svo" else b"\x89MCAP0\r\n") + bytes(99))
    with pytest.raises(sfm.LogError, match="a ZED recording: export it"):
        sfm.open_log(tmp_path / name)
