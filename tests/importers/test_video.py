"""Videos written by OpenCV become logs: every image, its time, its side."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.cli.main import main
from stream_sfm.importers.video import import_video
from stream_sfm.recording.images import decode_grey
from tests.helpers.wall import Wall, camera_path, rig

FRAMES, RATE_HZ = 6, 25.0
FFV1 = cv2.VideoWriter.fourcc(*"FFV1")  # lossless


@pytest.fixture(scope="module")
def pairs() -> list[tuple[np.ndarray, np.ndarray]]:
    return [(frame.left, frame.right) for frame in Wall(5).frames(rig(), camera_path(FRAMES))]


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    (tmp_path / "c.toml").write_text(rig().to_toml())
    return tmp_path / "c.toml"


def write(path: Path, images: list[np.ndarray], rate_hz: float = RATE_HZ, codec: int = FFV1) -> Path:
    height, width = images[0].shape
    writer = cv2.VideoWriter(str(path), codec, rate_hz, (width, height))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no such video")
    for image in images:
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def assert_same_frames(log: Path, pairs: list[tuple[np.ndarray, np.ndarray]], rate_hz: float = RATE_HZ) -> None:
    recorded = list(sfm.open_log(log).pairs())
    # times of videos are whole milliseconds
    assert np.allclose([p.stamp_ns for p in recorded], np.arange(len(pairs)) * 1e9 / rate_hz, atol=1e6)
    for pair, images in zip(recorded, pairs, strict=True):
        for message, image in zip((pair.left, pair.right), images, strict=True):
            # Lossless but for the way from grey to YUV and back.
            assert abs(decode_grey(message).astype(int) - image.astype(int)).max() <= 2


@pytest.mark.parametrize("ending", [".mkv", ".avi"])
def test_two_files(ending: str, pairs, calibration: Path, tmp_path: Path) -> None:
    left, right = (write(tmp_path / f"{n}{ending}", [p[n] for p in pairs]) for n in (0, 1))
    done = import_video((left, right), calibration, tmp_path / "o.mcap")
    assert (done.left, done.right, done.warnings) == (FRAMES, FRAMES, [])
    assert_same_frames(tmp_path / "o.mcap", pairs)
    read = sfm.open_log(tmp_path / "o.mcap").rig
    assert np.allclose(read.right_from_left, rig().right_from_left, atol=1e-9)


@pytest.mark.parametrize("layout", ["left-right", "right-left", "top-bottom", "bottom-top"])
@pytest.mark.parametrize("told", [True, False])
def test_one_file_with_both_images(layout: str, told: bool, pairs, calibration: Path, tmp_path: Path) -> None:
    order = slice(None) if layout in ("left-right", "top-bottom") else slice(None, None, -1)
    axis = 1 if layout.endswith(("right", "left")) else 0
    both = write(tmp_path / "both.mkv", [np.concatenate(p[order], axis) for p in pairs])
    import_video(both, calibration, tmp_path / "o.mcap", layout=layout if told else None)
    expected = (
        pairs if told else [p[order] for p in pairs]
    )  # not told, the left or the upper one is the left camera's
    assert_same_frames(tmp_path / "o.mcap", expected)


def test_a_rate_replaces_the_times_of_the_file(pairs, calibration: Path, tmp_path: Path, cli) -> None:
    both = write(tmp_path / "both.mkv", [np.hstack(p) for p in pairs])
    command = ["import", "video", "--both", both, "--calibration", calibration, "--rate", "50", tmp_path / "o.mcap"]
    cli(*command)
    assert_same_frames(tmp_path / "o.mcap", pairs, rate_hz=50)


def test_lossy_video_is_replayed(calibration: Path, pairs, tmp_path: Path, cli) -> None:
    left, right = (
        write(tmp_path / f"{n}.mp4", [p[n] for p in pairs], codec=cv2.VideoWriter.fourcc(*"mp4v")) for n in (0, 1)
    )
    log, out = tmp_path / "new" / "o.mcap", tmp_path / "out"
    videos = ["--left", str(left), "--right", str(right), "--calibration", str(calibration)]
    assert f"{FRAMES} left and {FRAMES} right images" in cli("import", "video", *videos, log).out
    cli("replay", log, "--out", out, "-q")
    run = sfm.read_results(out)
    assert len(run) == FRAMES and set(run.statuses[1:]) == {"ok"}
    assert (run.table["points_used"] > 100).all()  # of 250 wanted


def test_one_side_that_ends_early_is_told(pairs, calibration: Path, tmp_path: Path) -> None:
    left = write(tmp_path / "l.mkv", [p[0] for p in pairs])
    right = write(tmp_path / "r.mkv", [p[1] for p in pairs[:-2]])
    done = import_video((left, right), calibration, tmp_path / "o.mcap")
    assert (done.left, done.right) == (FRAMES, FRAMES - 2)
    assert done.warnings == [
        f"there are {FRAMES} left and {FRAMES - 2} right frames: they are paired by their times"
    ]
    assert len(list(sfm.open_log(tmp_path / "o.mcap").pairs())) == FRAMES - 2


def test_what_does_not_fit_is_named_and_nothing_is_left(pairs, calibration: Path, tmp_path: Path, capfd) -> None:
    left, small = write(tmp_path / "l.mkv", [p[0] for p in pairs]), tmp_path / "s.mkv"
    write(small, [p[1][::2, ::2].copy() for p in pairs])
    (tmp_path / "text.mp4").write_text("not a video")
    out, size = tmp_path / "o.mcap", f"{rig().left.width}×{rig().left.height}"
    for videos, kind, words in (
        ((left, small), sfm.InputError, rf"s\.mkv is .*, the calibration is for {size}: give the calibration"),
        (left, sfm.InputError, rf"l\.mkv is {size}; two images of the calibrated {size} side by side are"),
        (tmp_path / "text.mp4", sfm.InputError, r"text\.mp4 is not a video that OpenCV can decode: convert it"),
        (tmp_path / "none.mp4", sfm.InputError, r"none\.mp4: the file does not exist"),
        ((left, left, left), sfm.ConfigError, "3 videos were given"),
    ):
        with pytest.raises(kind, match=words):
            import_video(videos, calibration, out)
    for more, words in (
        ({"rate_hz": 0}, "the rate must be a positive number"),
        ({"layout": "sideways"}, "unknown layout 'sideways'; known are left-right"),
        ({"layout": "left-right"}, "a layout is for one video"),
    ):
        with pytest.raises(sfm.ConfigError, match=words):
            import_video((left, left), calibration, out, **more)
    assert not list(tmp_path.glob("o.mcap*"))
    out.write_bytes(b"mine")
    with pytest.raises(sfm.OutputError, match="exists already"):
        import_video((left, left), calibration, out)
    with pytest.raises(sfm.OutputError, match="it is an input of this run"):
        import_video((left, left), calibration, left, overwrite=True)
    capfd.readouterr()
    assert main(["import", "video", "--left", str(left), "--calibration", str(calibration), str(out)]) == 2
    assert "--left, --right" in capfd.readouterr().err


def test_times_that_do_not_grow_ask_for_a_rate(pairs, calibration: Path, tmp_path: Path, monkeypatch) -> None:
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
    with pytest.raises(sfm.InputError, match=r"frames 0 and 1 do not grow: give the rate, which may be 25 frames"):
        import_video(both, calibration, tmp_path / "o.mcap")
    import_video(both, calibration, tmp_path / "o.mcap", rate_hz=RATE_HZ)
    assert_same_frames(tmp_path / "o.mcap", pairs)


@pytest.mark.parametrize("ending, codec", [(".mkv", "FFV1"), (".avi", "FFV1"), (".mp4", "mp4v")])
def test_a_video_given_as_a_log_is_told_from_damage(ending: str, codec: str, pairs, tmp_path: Path, cli) -> None:
    video = write(tmp_path / f"v{ending}", [p[0] for p in pairs], codec=cv2.VideoWriter.fourcc(*codec))
    said = cli("replay", video, "--out", tmp_path / "out", code=3).err
    assert "is a video: give the calibration of its images" in said and "--calibration" in said


@pytest.mark.parametrize("axis", [0, 1])
def test_a_video_that_holds_both_images_is_replayed_as_it_is(
    axis: int, pairs, calibration, tmp_path: Path, cli
) -> None:
    both = write(tmp_path / "both.mkv", [np.concatenate(p, 1 - axis) for p in pairs])
    log = sfm.open_log(both, calibration=calibration)
    for frame, images in zip(log.frames(), pairs, strict=True):
        assert all(abs(a.astype(int) - b).max() <= 2 for a, b in zip(frame.images, images, strict=True))
    assert log.stats.complete
    import_video(both, calibration, tmp_path / "o.mcap")
    for video, imported in zip(log.frames(), sfm.open_log(tmp_path / "o.mcap").frames(), strict=True):
        assert video.stamp_ns == imported.stamp_ns
        assert np.array_equal(video.left, imported.left) and np.array_equal(video.right, imported.right)
    cli("replay", both, "--calibration", calibration, "--out", tmp_path / "run", "-q")
    assert set(sfm.read_results(tmp_path / "run").statuses[1:]) == {"ok"}
    said = cli("inspect", both, "--calibration", calibration).out
    assert "/camera/left/image" in said
