"""One image on both sides, and both images displaced at once: suspected, reported, and over with their cause."""

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config.image_rules import ImageRules
from stream_sfm.estimators.motion_model import Displaced, Doubts, MotionModel
from stream_sfm.evaluation.association import matched
from stream_sfm.evaluation.trajectory import nees_pose
from stream_sfm.frontend.image_checks import are_one_image
from stream_sfm.frontend.step_check import StepCheck, displacement_px
from stream_sfm.geometry import se3
from tests.helpers.places import ROOM

F_PX = 400.0
RNG = np.random.default_rng(0)
TEXTURE = RNG.integers(0, 256, (60, 80)).astype(np.uint8)


def turned(px: float) -> np.ndarray:
    return displacement_px(np.array([0, 0, 0, 0, px / F_PX, 0]), F_PX, 0.5)


def checked(*changes_px: float) -> StepCheck:
    """Return the check after many small changes of motion, and then these."""
    check = StepCheck()
    for px in (*RNG.uniform(0.2, 1, 20), *changes_px):
        check = check.after(turned(px))
    return check


def test_a_step_is_a_change_that_the_next_frame_takes_back() -> None:
    assert not checked(12).problem
    assert "moved by 12 px at once" in checked(12, -11.5).problem
    assert not checked(12, -11.5, 0.1).problem


def test_a_turn_that_continues_is_no_step() -> None:
    assert not checked(12, 0.5).problem


def test_a_change_of_motion_displaces_points_as_it_moves_them() -> None:
    """The reference is the difference of two projections of a central point, and of one beside it for the roll."""
    depth_m = 4.0
    points = depth_m * np.array([[0, 0, 1], [1e-3, 0, 1]])
    for change in 1e-6 * np.eye(6)[[0, 1, 3, 4, 5]]:
        moved = se3.transform(se3.exp(change), points)
        apart = F_PX * (moved[:, :2] / moved[:, 2:] - points[:, :2] / points[:, 2:])
        roll = (apart[1, 1] - apart[0, 1]) / 1e-3
        expected = [*apart[0], roll]
        np.testing.assert_allclose(displacement_px(change, F_PX, 1 / depth_m), expected, atol=1e-8)


def test_a_step_aside_in_front_of_a_wall_is_a_step() -> None:
    """If all points are equally far, displaced images look like a step aside as well as like a turn."""
    aside = displacement_px(np.array([0, 0.18, 0, 0, 0, 0]), F_PX, 0.5)
    check = checked().after(aside)
    assert "moved by 36 px at once" in check.after(-0.96 * aside).problem


def test_a_shaking_hand_makes_no_step() -> None:
    check = StepCheck()
    for px in RNG.normal(0, 7, 200):
        check = check.after(turned(px))
        assert not check.problem


def test_a_pose_is_as_uncertain_as_a_step_that_the_camera_may_not_have_made() -> None:
    model = MotionModel(sfm.Config().motion)
    for n in range(3):
        model.add(n * 10**8, np.eye(4), np.zeros((6, 6)))
    step = np.array([0.1, 0, 0, 0, 0.02, 0])
    pose = se3.exp(step)
    nothing = np.zeros((6, 6))
    np.testing.assert_allclose(
        model.add(3 * 10**8, pose, nothing, Doubts(stepped=Displaced())), np.outer(step, step), atol=1e-12
    )
    later = pose @ se3.exp([0, 0, 1, 0, 0, 0])
    cov = model.add(4 * 10**8, later, nothing)
    np.testing.assert_allclose(cov[0, 0], (0.1 + 0.02) ** 2, rtol=1e-6)  # by the lever of 1 m
    assert model.predict(4 * 10**8)[1][0, 0] >= cov[0, 0]  # also for a lost frame
    model.restart(4 * 10**8, later, cov)
    np.testing.assert_array_equal(model.add(5 * 10**8, later, cov), cov)  # the new map contains it once


def test_a_step_of_images_that_do_not_fit_each_other_is_as_unknown_as_a_vehicle_allows() -> None:
    model = MotionModel(sfm.Config().motion)
    for n in range(3):
        model.add(n * 10**8, np.eye(4), np.zeros((6, 6)))
    pose, later = se3.exp(np.array([0.1, 0, 0, 0, 0.02, 0])), se3.exp(np.array([0.1, 0.01, 0, 0, 0.02, 0]))
    covering = model.predict(3 * 10**8)[1]
    model.add(3 * 10**8, pose, np.zeros((6, 6)), Doubts(misfit=True, stepped=Displaced()))
    cov = model.add(4 * 10**8, later, np.zeros((6, 6)))
    assert np.linalg.eigvalsh(cov)[0] > 0.9 * np.linalg.eigvalsh(covering)[0] > 0


def test_displaced_images_show_later_motions_turned() -> None:
    """The references are the motion of a camera turned by as much, and that of distant points."""
    displaced, turn = Displaced(turn_rad=0.1, depth_m=5.0), se3.exp(np.array([0, 0, 0, 0, 0.1, 0]))
    for xi in np.random.default_rng(1).normal(0, 0.2, (50, 6)):
        motion = se3.exp(xi)
        error = se3.log(se3.inverse(motion) @ turn @ motion @ se3.inverse(turn))
        assert error @ np.linalg.solve(displaced.cov_of(motion), error) < 3
    assert not displaced.cov_of(np.eye(4)).any()


def test_a_frame_that_may_be_displaced_covers_it_until_the_next_one_decides() -> None:
    model, nothing = MotionModel(sfm.Config().motion), np.zeros((6, 6))
    for n in range(3):
        model.add(n * 10**8, np.eye(4), nothing)
    step = np.array([0.1, 0, 0, 0, 0.02, 0])
    cov = model.add(3 * 10**8, se3.exp(step), nothing, Doubts(may_step=True))
    np.testing.assert_allclose(cov, np.outer(step, step), atol=1e-12)
    assert model.predict(4 * 10**8)[1][0, 0] >= 0.9 * cov[0, 0]  # without a decision
    np.testing.assert_array_equal(model.add(4 * 10**8, se3.exp(2 * step), nothing), nothing)


def test_after_an_uncertain_pose_its_velocity_is_uncertain() -> None:
    model, nothing = MotionModel(sfm.Config().motion), np.zeros((6, 6))
    for n in range(3):
        model.add(n * 10**8, np.eye(4), nothing)
    step = np.array([0.1, 0, 0, 0, 0, 0])
    model.add(3 * 10**8, se3.exp(step), nothing, Doubts(misfit=True))
    for frames in (1, 2, 5):  # lost frames since then
        pose, cov = model.predict((3 + frames) * 10**8)
        np.testing.assert_allclose(pose[0, 3], 0.1 * (1 + frames))
        assert np.sqrt(cov[0, 0]) > pose[0, 3]


@pytest.mark.parametrize("axis, by_px", [(0, 7), (0, 30), (1, 36)])
def test_no_frame_is_ok_and_wrong_after_both_images_are_displaced(axis: int, by_px: int) -> None:
    """They are displaced by rows and columns at frame 15; the right image of an unrectified pair then misfits, too."""
    log = sfm.open_log(ROOM)
    engine, truth = sfm.Engine(log.rig), log.ground_truth()
    assert truth is not None
    estimates = []
    for n, frame in enumerate(log.frames(sfm.Selection(max_frames=24))):
        left, right = (np.roll(image, by_px * (n >= 15), axis=axis) for image in (frame.left, frame.right))
        estimates.append(engine.step(sfm.StereoFrame(frame.stamp_ns, left, right)))
    poses, covs = np.array([e.world_from_cam for e in estimates]), np.array([e.cov_pose for e in estimates])
    rows, true = matched(sfm.Trajectory(np.array([e.stamp_ns for e in estimates]), poses, covs), truth)
    squares = nees_pose(poses[rows], covs[rows], true.world_from_cam)
    assert not [e.frame_index for e, x in zip(estimates, squares, strict=True) if e.status == "ok" and x > 100]


@pytest.mark.parametrize("noise", [0, 2])
def test_one_image_is_recognised_even_if_it_is_encoded_twice(noise: int) -> None:
    other = np.clip(TEXTURE.astype(int) + RNG.integers(-noise, noise + 1, TEXTURE.shape), 0, 255).astype(np.uint8)
    assert are_one_image(TEXTURE, other, ImageRules())
    assert not are_one_image(TEXTURE, np.roll(TEXTURE, 1, axis=1), ImageRules())
    assert not are_one_image(
        np.full_like(TEXTURE, 90), np.full_like(TEXTURE, 90), ImageRules()
    )  # a bare image: other checks report it


def test_while_both_sides_are_one_image_no_frame_is_ok() -> None:
    log, statuses = sfm.open_log(ROOM), []
    engine = sfm.Engine(log.rig)
    for n, frame in enumerate(log.frames(sfm.Selection(max_frames=24))):
        given = sfm.StereoFrame(frame.stamp_ns, frame.left, frame.left.copy()) if 8 <= n < 14 else frame
        estimate = engine.step(given)
        statuses.append(estimate.status)
        if 8 <= n < 14:
            assert estimate.reason
    assert "ok" not in statuses[8:14] and "ok" in statuses[18:]
