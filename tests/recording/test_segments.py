"""What changes during a log: calibrations, clocks, sizes of images, the brightness of single pixels."""

from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.camera.pixels import GreyScaler
from tests.helpers.stereo_logs import (
    PERIOD_NS,
    START_NS,
    Calib,
    K,
    LogWriter,
    Spec,
    right_calib,
    scene,
    write_image,
    write_info,
    write_pair,
)

FRAMES = 12
CHANGE = 5  # the frame before which something changes
HOUR_NS = 3600 * 10**9
OTHER_K = K * [[1.1], [1.1], [1.0]]


def log_that_changes(path: Path, profile: str, changed: Calib, first: Calib | None = None) -> Path:
    """Calibrations before every frame; the left one is `changed` from frame CHANGE on, and `first` before any image."""
    log = LogWriter(path)
    if first is not None:
        write_info(log, profile, Spec.info_topics[0], START_NS - PERIOD_NS, first)
    for n in range(FRAMES):
        time = START_NS + n * PERIOD_NS
        infos = changed if n >= CHANGE else Calib(), right_calib()
        write_pair(log, profile, time, (scene(n, 0), scene(n, 1)), infos)
    log.close()
    return path


@pytest.mark.parametrize(
    ("profile", "changed", "what", "why"),
    [
        ("foxglove", Calib(K=OTHER_K), "K", ""),
        ("ros2", Calib(K=OTHER_K), "K", ""),
        ("ros1", Calib(P=np.c_[K, [1.0, 0, 0]]), "P", ""),
        ("json", Calib(D=(0.1, 0, 0, 0, 0)), "D", ""),
        ("foxglove", Calib(model="equidistant"), "the distortion model", ""),
        ("foxglove", Calib(width=2 * Calib().width), "the image size", "another camera took them"),
        ("foxglove", Calib(K=K * np.nan), "K", "K must be 3×3 and finite"),
    ],
)
def test_a_log_ends_where_its_calibration_changes(
    path: Path, profile: str, changed: Calib, what: str, why: str
) -> None:
    """With `all_calibrations` it goes on, by the rig in force; not where `why` says that the next one is of no use."""
    log = sfm.open_log(log_that_changes(path, profile, changed))
    assert len(list(log.frames())) == CHANGE and not log.stats.complete
    assert f"calibration on topic /camera/left/calibration changes ({what})" in " ".join(log.stats.warnings)
    given = sfm.open_log(path, calibration=log.rig)  # whose images belong to it
    assert len(list(given.frames())) == FRAMES and given.stats.complete
    rigs = [frame.recorded.rig for frame in log.frames(all_calibrations=True)]
    assert rigs[:CHANGE] == CHANGE * [log.rig] and log.stats.complete == (not why)
    assert why in log.stats.warnings[-1] and f"changes ({what})" in " ".join(log.stats.warnings)
    if not why:
        assert rigs[CHANGE:] == (FRAMES - CHANGE) * [rigs[-1]] and rigs[-1] is not log.rig
        if what == "K":
            assert rigs[-1] is not None and rigs[-1].left.K[0, 0] == OTHER_K[0, 0]


def test_numbers_that_are_rounded_differently_are_the_same_calibration(path: Path) -> None:
    log = sfm.open_log(log_that_changes(path, "foxglove", Calib(K=K * (1 + 1e-9))))
    assert len(list(log.frames())) == FRAMES and log.stats.complete


def test_the_calibration_in_force_at_the_first_image_is_used(path: Path) -> None:
    """Some drivers send a default one before they have read that of the camera."""
    log = sfm.open_log(log_that_changes(path, "ros2", Calib(), first=Calib(K=OTHER_K)))
    assert log.rig.left.K[0, 0] == K[0, 0]
    assert len(list(log.frames())) == FRAMES and log.stats.complete


def test_images_of_another_size_are_of_another_camera(path: Path) -> None:
    log = LogWriter(path)
    for n in range(FRAMES):
        time, size = START_NS + n * PERIOD_NS, (48, 32) if n >= CHANGE else Spec.size
        infos = (Calib(), right_calib()) if n == 0 else None
        write_pair(log, "foxglove", time, (scene(n, 0, size), scene(n, 1, size)), infos)
    log.close()
    opened = sfm.open_log(path)
    assert len(list(opened.frames())) == CHANGE and not opened.stats.complete
    assert "48×32" in " ".join(opened.stats.warnings)


def clock_log(path: Path, shift_ns: dict[int, int], right_too: bool = True) -> Path:
    """84 frames; those numbered in `shift_ns` have stamps that are so much later, of the left image at least."""
    log = LogWriter(path)
    for n in range(84):
        log.clock_ns = time = START_NS + n * PERIOD_NS  # the recorder's clock is right
        infos = Calib(), right_calib()
        for side, moves in enumerate((True, right_too)):
            stamp_ns = time + moves * shift_ns.get(n, 0)
            write_info(log, "foxglove", Spec.info_topics[side], stamp_ns, infos[side])
            write_image(log, "foxglove", Spec.topics[side], stamp_ns, scene(0, side), "png")
    log.close()
    return path


def test_stray_stamps_cost_their_frames_and_are_reported(path: Path) -> None:
    log = sfm.open_log(clock_log(path, dict.fromkeys((10, 20, 21, 40, 41, 60), HOUR_NS)))
    assert len(list(log.frames())) == 78
    assert not log.stats.complete and log.stats.dropped_backwards == 12
    assert "far from those of the images around them" in " ".join(log.stats.warnings)


def test_a_clock_that_is_set_back_begins_a_segment(path: Path) -> None:
    log = sfm.open_log(clock_log(path, {n: -HOUR_NS for n in range(30, 84)}))
    stamps = [frame.stamp_ns for frame in log.frames()]
    assert stamps == [START_NS + n * PERIOD_NS for n in range(30)]
    said = " ".join(log.stats.warnings)
    assert (
        not log.stats.complete
        and "set back by 3599.900 s" in said
        and "reading stopped at 2.90 s: the clock was set back" in said
    )
    rest = [frame.stamp_ns for frame in log.frames(sfm.Selection(start_s=2.95))]
    assert len(rest) == 53 and rest == sorted(rest) and rest[-1] < START_NS
    report = sfm.inspect(path)
    assert report["frames"]["paired"] == 84 and not report["problems"]


def test_a_clock_of_one_camera_that_is_set_back_is_not_complete(path: Path) -> None:
    log = sfm.open_log(clock_log(path, {n: -HOUR_NS for n in range(30, 84)}, right_too=False))
    assert len(list(log.frames())) == 30 and not log.stats.complete
    assert "54 images of each camera have no partner" in " ".join(log.stats.warnings)


def test_one_hot_sample_does_not_darken_the_log() -> None:
    """A sensor of 10 bits; a hot pixel has all 16, a bright scene 12."""
    scaler, image = GreyScaler(), np.full((100, 100), 600, np.uint16)
    hot = image.copy()
    hot[50, 50] = 65535
    for given in (image, hot, image):
        (grey,) = scaler.to_uint8(given)
        assert grey[0, 0] == 600 >> 2
    assert scaler.to_uint8(hot)[0][50, 50] == 255
    bright = image.copy()
    bright[:20] = 4000
    assert scaler.to_uint8(bright)[0][0, 0] == 4000 >> 4
