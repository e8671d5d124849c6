"""`inspect` names the fault of rendered logs with one defect each, and its fix works."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.inspection.calibration_check import calibration_findings, check_calibration, matched_corners
from stream_sfm.inspection.overview import inspect_log
from stream_sfm.logs.recording.topics import PairChoice
from tests.helpers.stereo_logs import START_NS, LogWriter, calibration_of, infos_of, write_image, write_info
from tests.helpers.wall import Wall, camera_path, rig

LEFT, RIGHT = "/camera/left/image", "/camera/right/image"
STEREO = rig()
INFOS = infos_of(STEREO)


@pytest.fixture(scope="module")
def frames():
    wall = Wall(5)
    return wall.frames(STEREO, camera_path(8))


def write(
    path, frames, calibrations=None, swapped=False, period_ms=100, offset_ms=0, size=(320, 240), sides=(LEFT, RIGHT)
):
    """Write a log of `frames` with these options; `swapped` exchanges the images, not the calibrations."""
    log = LogWriter(path)
    for i, frame in enumerate(frames):
        time = START_NS + i * period_ms * 1_000_000
        images = (frame.right, frame.left) if swapped else (frame.left, frame.right)
        for side, topic in enumerate(sides):
            info_topic = topic.replace("image", "camera_info")
            write_info(log, "foxglove", info_topic, time, (calibrations or INFOS)[side], topic.split("/")[2])
            grey = cv2.resize(images[side], size, interpolation=cv2.INTER_AREA)
            write_image(log, "foxglove", topic, time + side * offset_ms * 1_000_000, grey, "png")
    log.close()
    return path


def test_a_sound_log(path, frames):
    found = inspect_log(write(path, frames))
    assert found["problems"] == found["warnings"] == []
    check = found["calibration_check"]
    assert abs(check["vertical_px"]) < 0.1 and check["vertical_spread_px"] < 0.2 and check["negative_share"] < 0.01
    # 3 m away, 0.2 m between the cameras, 260 px: 17 px, more or less with the slant
    assert check["median_disparity_px"] == pytest.approx(260 * 0.2 / 3.0, abs=2.5)
    assert found["rig"]["baseline_m"] == pytest.approx(0.2)
    assert found["frames"]["rate_hz"] == pytest.approx(10) and found["frames"]["gap_count"] == 0
    assert found["pair"]["left"] == LEFT and "only in the side" in found["pair"]["reason"]


def test_swapped_cameras(path, frames, tmp_path):
    (problem,) = inspect_log(write(path, frames, swapped=True))["problems"]
    assert "the images are swapped" in problem and "negative disparity" in problem
    assert f"name {RIGHT} as left and {LEFT} as right" in problem and "calibration of that pair" in problem
    (tmp_path / "c.toml").write_text(STEREO.to_toml())
    assert inspect_log(path, left=RIGHT, right=LEFT, calibration=tmp_path / "c.toml")["problems"] == []


def test_swapped_cameras_that_converge(path):
    """What they see of nearby things may lie on either side: their rows tell."""
    wall, stereo = Wall(5), rig(0.08)
    frames = wall.frames(stereo, camera_path(4))
    infos = calibration_of(stereo, "plumb_bob")
    assert inspect_log(write(path, frames, infos))["problems"] == []
    (problem,) = inspect_log(write(path, frames, infos, swapped=True))["problems"]
    assert "the images are swapped: with the images exchanged matched corners lie on one row" in problem


def test_swapped_cameras_with_their_calibration(path, frames):
    (problem,) = inspect_log(write(path, frames, INFOS[::-1], swapped=True))["problems"]
    assert "left and right are swapped" in problem and f"name {RIGHT} as left and {LEFT} as right" in problem
    assert inspect_log(path, left=RIGHT, right=LEFT)["problems"] == []


def test_a_baseline_of_the_wrong_sign(path, frames):
    left, right = INFOS
    (problem,) = inspect_log(write(path, frames, [left, replace(right, P=right.P * [1, 1, 1, -1])]))["problems"]
    assert "the sign of the baseline is wrong" in problem and "0.2 m to the left" in problem and "negate" in problem
    assert "swapped" not in problem


def test_an_angle_between_the_cameras_that_the_calibration_has_not(path):
    """Cameras that converge, calibrated as parallel: what is far has negative disparity."""
    wall, stereo = Wall(5), rig(0.062)
    frames = wall.frames(stereo, camera_path(4))
    found = inspect_log(write(path, frames))
    # only the far part of the wall
    assert 0.05 < found["calibration_check"]["negative_share"] < 0.5 and found["problems"] == []
    assert any("negative disparity" in w and "angle between the cameras" in w for w in found["warnings"])
    assert inspect_log(write(path, frames, calibration_of(stereo, "plumb_bob")))["warnings"] == []


def test_half_size_images_with_the_calibration_of_the_full_size(path, frames):
    (problem,) = inspect_log(write(path, frames, size=(160, 120)))["problems"]
    assert "images are 160×120, the calibration is for 320×240" in problem and "resized by 0.5" in problem


def test_a_topic_that_was_announced_and_never_sent_is_not_a_camera(path, frames):
    log = LogWriter(path)
    write_image(log, "foxglove", RIGHT, START_NS, frames[0].right, "png")
    log.writer.register_channel(LEFT, "protobuf", 1)
    log.close()
    (problem,) = inspect_log(path)["problems"]
    assert "one camera only" in problem and LEFT in problem


@pytest.mark.parametrize(("period_ms", "offset_ms"), [(100, 30), (50, 30), (50, -30)])
def test_right_stamps_that_are_off(path, frames, period_ms, offset_ms):
    """At 10 Hz the nearest partner is still the right one, at 20 Hz it is of another frame: both are named."""
    found = inspect_log(write(path, frames, period_ms=period_ms, offset_ms=offset_ms))
    paired_ms = offset_ms - np.sign(offset_ms) * period_ms * (2 * abs(offset_ms) > period_ms)
    assert found["frames"]["median_offset_ms"] == pytest.approx(paired_ms)
    (warning,) = found["warnings"]
    assert found["problems"] == []
    other_ms = paired_ms - np.sign(paired_ms) * period_ms
    assert f"{RIGHT} differ from the left ones by {paired_ms:+.1f} ms (or by {other_ms:+.1f} ms" in warning


def test_the_wrong_calibration(path, frames):
    turned = [replace(c, R=cv2.Rodrigues(np.array([x, 0.0, 0.0]))[0]) for c, x in zip(INFOS, (0.0, 0.02), strict=True)]
    (problem,) = inspect_log(write(path, frames, turned))["problems"]
    assert "rows of left and right" in problem and "give the calibration of these cameras" in problem


@pytest.mark.parametrize(
    ("turn_rad", "wrong"),
    [((0, 0, 0.016), False), ((0, 0, 0.03), True), ((0.006, 0, 0), False), ((0.012, 0, 0), True)],
    ids=["rolled a little", "rolled", "pitched a little", "pitched"],
)
def test_rows_are_judged_as_a_replay_judges_them(path, frames, turn_rad, wrong):
    """What the model of rows takes out is no finding, however large its median; what it cannot is one of both."""
    turned = [replace(c, R=cv2.Rodrigues(k * np.array(turn_rad))[0]) for k, c in enumerate(INFOS)]
    found, summary = inspect_log(write(path, frames, turned)), sfm.replay(path).summary
    for problems in (found["problems"], summary["problems"]):
        assert [("rows of left and right differ" in p) for p in problems] == [True] * wrong
    assert found["warnings"] == []


def test_rows_of_cameras_that_are_late_are_refuted_by_frames_that_are_followed(frames):
    pitched = replace(STEREO, right_from_left=se3.exp([0, 0, 0, 0.012, 0, 0]) @ STEREO.right_from_left)
    corners = [matched_corners(f.left, f.right) for f in frames[:2]]
    check, choice = check_calibration(pitched, corners), PairChoice(LEFT, RIGHT, "")
    assert check.rows_problem
    for followed in (False, True):
        problems, warnings = calibration_findings(pitched, check, corners, choice, lambda f=followed: f)
        assert bool(problems) != followed and not warnings


def test_rectified_images_with_the_calibration_of_those_before(path):
    """The images are rectified, their topics do not say so, and the calibration has lenses and an angle."""
    bent = [
        replace(c, D=(-0.3, 0.1, 0, 0, 0), R=cv2.Rodrigues(np.array([x, 0.0, 0.0]))[0])
        for c, x in zip(INFOS, (0.0, 0.01), strict=True)
    ]
    frames = Wall(5).frames(STEREO, camera_path(4))
    (problem,) = inspect_log(write(path, frames, bent))["problems"]
    assert "if they are rectified already, name their topics image_rect" in problem.lower()
    topics = tuple(topic.replace("image", "image_rect") for topic in (LEFT, RIGHT))
    renamed = write(path.with_name("renamed.mcap"), frames, bent, sides=topics)
    assert inspect_log(renamed)["problems"] == []


def test_a_log_without_texture_cannot_be_checked_and_says_so(path, frames):
    grey = [replace(f, left=np.full_like(f.left, 90), right=np.full_like(f.right, 90)) for f in frames]
    found = inspect_log(write(path, grey))
    assert found["problems"] == [] and "could not be checked" in found["warnings"][0]
    left, right = INFOS
    found = inspect_log(write(path, grey, [right, left]))
    assert "stands 0.2 m to the left" in found["problems"][0]


def test_exit_codes_and_json(path, frames, cli):
    found = cli("inspect", write(path, frames), "--json").json
    assert found["problems"] == [] and found["images"]["left"]["size"] == [320, 240]
    assert not found["rig_errors"]["applied"]
    assert found["verdict"] == {"fit": "fits", "text": found["rig_errors"]["text"]}
    text = cli("inspect", path).out
    for words in (LEFT, "baseline 0.2000 m", "matched corners", "8 at 10.00 Hz", "this log can be replayed"):
        assert words in text
    assert "the images are swapped" in cli("inspect", write(path, frames, swapped=True), code=3).out


@pytest.mark.parametrize("d", [(0.0, 0.0, 1.0, 0.0, 0.0), (100.0, 100.0, 100.0, 100.0)])
def test_a_lens_that_a_replay_refuses_is_a_problem(d, path, frames, cli):
    write(path, frames, [replace(info, D=d) for info in INFOS])
    assert "leave no image" in cli("replay", path, code=3).err
    shown = cli("inspect", path, code=3).out
    assert "leave no image" in shown and "this log can be replayed" not in shown
