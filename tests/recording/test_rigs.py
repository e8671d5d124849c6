"""Calibration as drivers send it: coefficients of odd lengths, poses by transforms, attachments, and their faults."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm import LogError, open_log
from stream_sfm.geometry import se3
from tests.helpers.stereo_logs import (
    BASELINE_M,
    START_NS,
    Calib,
    K,
    LogWriter,
    Spec,
    right_calib,
    scene,
    write_log,
    write_pair,
    write_transform,
)


@pytest.mark.parametrize(
    ("model", "sent", "read"),
    [
        ("plumb_bob", (0.1, 0.2), ("plumb_bob", (0.1, 0.2, 0, 0))),
        ("plumb_bob", (0.1, 0.2, 0.3, 0.4, 0.5, 0, 0, 0), ("plumb_bob", (0.1, 0.2, 0.3, 0.4, 0.5))),
        ("plumb_bob", (0.1,) * 8, ("rational_polynomial", (0.1,) * 8)),
        ("rational_polynomial", (0.1,) * 8 + (0.0,) * 6, ("rational_polynomial", (0.1,) * 8)),
        ("equidistant", (0.1, 0.2, 0.3, 0.4, 0.0), ("equidistant", (0.1, 0.2, 0.3, 0.4))),
        ("kannala_brandt", (), ("equidistant", (0.0,) * 4)),
        ("", (), ("none", ())),
        ("none", (0.0,) * 5, ("none", ())),
        ("inverse_brown_conrady", (0.0,) * 5, ("none", ())),
        ("rational_polynomial", (0.1,) * 12, "12 distortion coefficients are not supported, only the first 8"),
        ("equidistant", (0.1,) * 5, "only the first 4 of equidistant"),
        ("inverse_brown_conrady", (0.1,) * 5, "'inverse_brown_conrady' is not supported"),
    ],
)
def test_coefficients_are_filled_up_left_out_or_refused(path, model, sent, read):
    log = write_log(path, Spec(infos=(Calib(model=model, D=sent), right_calib(model=model, D=sent))))
    if isinstance(read, str):
        with pytest.raises(LogError, match=read):
            open_log(log)
    else:
        camera = open_log(log).rig.left
        assert (camera.distortion_model, camera.D) == read


def transforms(path, *edges, per_frame=0.0, frames=("left", "right")):
    """A log whose P gives no baseline; `edges` (parent, child, pose); poses move by `per_frame` metres."""
    log = LogWriter(path)
    for i in range(4):
        time = START_NS + i * 100_000_000
        write_pair(log, "foxglove", time, (scene(i, 0), scene(i, 1)), (Calib(), Calib()), frame_ids=frames)
        for parent, child, pose in edges:
            write_transform(log, "foxglove", time, parent, child, se3.exp([i * per_frame, 0, 0, 0, 0, 0]) @ pose)
    log.close()
    return path


LEFT_FROM_RIGHT = se3.exp([BASELINE_M, 0.01, 0.002, 0.01, -0.02, 0.005])
BODY_FROM_LEFT = se3.exp([0.5, 1.0, -0.3, 0.4, 0.5, -1.2])


@pytest.mark.parametrize(
    "edges",
    [
        [("left", "right", LEFT_FROM_RIGHT)],
        [("right", "left", se3.inverse(LEFT_FROM_RIGHT))],
        [("body", "left", BODY_FROM_LEFT), ("body", "right", BODY_FROM_LEFT @ LEFT_FROM_RIGHT)],
        [("body", "left", BODY_FROM_LEFT), ("left", "mount", BODY_FROM_LEFT),
         ("mount", "right", se3.inverse(BODY_FROM_LEFT) @ LEFT_FROM_RIGHT)],
    ],
)  # fmt: skip
def test_the_pose_of_the_right_camera_along_any_chain(path, edges):
    rig = open_log(transforms(path, *edges)).rig
    np.testing.assert_allclose(rig.right_from_left, se3.inverse(LEFT_FROM_RIGHT), atol=1e-12)


def test_transforms_that_move_are_no_calibration(path):
    """Both cameras tracked in a room: their poses differ by the baseline only if they are of one moment."""
    edges = [("room", "left", BODY_FROM_LEFT), ("room", "right", BODY_FROM_LEFT @ LEFT_FROM_RIGHT)]
    # 1 cm to the side is a sixth of a millimetre
    assert open_log(transforms(path, *edges)).rig.baseline_m == pytest.approx(0.3, abs=1e-3)
    with pytest.raises(
        LogError, match=r"no fixed transform leads from frame 'left' to frame 'right'.*give the calibration"
    ):
        open_log(transforms(path, *edges, per_frame=0.001))


def test_one_frame_for_both_cameras_has_no_baseline(path):
    with pytest.raises(LogError, match="baseline is not known"):
        open_log(transforms(path, ("left", "right", LEFT_FROM_RIGHT), frames=("left", "left")))


def attach(path, text, name="calibration.toml"):
    """A log with an attachment beside calibration messages."""
    log = LogWriter(path)
    log.writer.add_attachment(0, 0, name, "application/toml", text.encode())
    for i in range(3):
        write_pair(log, "foxglove", START_NS + i, (scene(i, 0), scene(i, 1)), (Calib(), right_calib()))
    log.close()
    return path


def test_an_attached_calibration_goes_before_messages(path):
    rig = open_log(write_log(path)).rig
    moved = replace(rig, right_from_left=se3.exp([-0.5, 0, 0, 0, 0, 0]))
    assert open_log(attach(path, moved.to_toml())).rig.baseline_m == 0.5
    assert open_log(attach(path, moved.to_toml(), "notes.toml")).rig.baseline_m == pytest.approx(BASELINE_M)
    assert open_log(attach(path, moved.to_toml()), calibration=rig).rig is rig


def test_an_attached_calibration_that_is_broken_is_named(path):
    with pytest.raises(LogError, match=r"log\.mcap: calibration attached to the log: section \[left\] is missing"):
        open_log(attach(path, "[right]\n"))


def test_zeroed_messages_are_no_calibration(path):
    """As drivers send them that were never calibrated."""
    zero = Calib(K=np.zeros((3, 3)), R=np.zeros((3, 3)), P=np.zeros((3, 4)))
    with pytest.raises(LogError, match="K and P of topic /camera/left/calibration are zero: this camera was not"):
        open_log(write_log(path, Spec(infos=(zero, zero))))
    rig = open_log(write_log(path)).stereo_rig
    (path.parent / "calibration.toml").write_text(rig.to_toml())
    opened = open_log(write_log(path, Spec(infos=(zero, zero))))  # the one beside it
    np.testing.assert_allclose(opened.rig.right_from_left, rig.right_from_left, atol=1e-9)
    assert len(list(opened.frames())) == 12
    (path.parent / "calibration.toml").unlink()
    no_k = Calib(K=np.zeros((3, 3)))
    with pytest.raises(LogError, match="is the camera calibrated"):
        open_log(write_log(path, Spec(infos=(no_k, right_calib(K=K)))))
