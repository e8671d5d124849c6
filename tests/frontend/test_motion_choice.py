"""Whose motion it is: far points agree with a body's, few in between do not, and tracks with a history remember."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.frontend.rules import MotionRules
from stream_sfm.frontend.second_motions.ambiguity import AmbiguityMemory
from stream_sfm.frontend.second_motions.motion_choice import choose
from stream_sfm.frontend.second_motions.start_check import StartCheck
from stream_sfm.frontend.seen import Seen
from stream_sfm.frontend.state import Setup
from stream_sfm.frontend.step import Step
from stream_sfm.geometry import se3
from stream_sfm.geometry.point_views import PointViews
from stream_sfm.geometry.resection import Resection, SecondMotion, resect, residuals_of
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.record import changed
from tests.helpers.tracks import tracks_at

P = StereoProjection(f_px=400, cx_left_px=240, cx_right_px=240, cy_px=180, baseline_m=0.25, width=480, height=360)
STD_PX = 0.15
TURNS = se3.exp([0, 0, 0, 0, 0.03, 0])  # the camera turns in place
FAR, BETWEEN, BODY = 22, 5, 20
QUIET = 0.6  # noise over σ


def seen(
    seed: int, body_moves_m: float, counts: tuple[int, int, int] = (FAR, BETWEEN, BODY), noise: float = 1.0
) -> tuple[Seen, np.ndarray]:
    """The views of far points, of a few in between, and of a compact set of near ones; and the set (n,) of each.

    `noise`: noise of the views over their σ.
    """
    rng = np.random.default_rng(seed)
    of = np.repeat([0, 1, 2], counts)
    least, most = (
        np.array([[0.5, 0.1], [0.05, 0.75], [0.3, 0.35]]),
        np.array([[0.95, 0.5], [0.2, 0.9], [0.45, 0.7]]),
    )
    place = rng.uniform(least[of], most[of]) * [P.width, P.height]
    depth_m = rng.uniform(np.array([10, 3.5, 2.2])[of], np.array([14, 5, 2.4])[of])
    points = np.column_stack([P.rays(place), np.ones(len(of))]) * depth_m[:, None]
    now = points + np.where(of[:, None] == 2, np.array([body_moves_m, 0, 0]), 0)
    first_px = P.project(points) + rng.normal(size=(len(of), 4)) * noise * STD_PX
    z_px = P.project(se3.transform(TURNS, now)) + rng.normal(size=(len(of), 4)) * noise * STD_PX
    before = np.column_stack([P.rays(first_px), np.ones(len(of)), P.inverse_depth(first_px)])
    return with_views(before, first_px, depth_m, z_px, np.zeros((4, 0))), of


def with_own_body(seed: int) -> tuple[Seen, np.ndarray]:
    """The views of 60 far points, which turn, and of five on the robot, at rest in the image; which are far (n,).

    All right sides have one unknown error. The noise of the views is half of their σ.
    """
    rng = np.random.default_rng(seed)
    far = np.arange(65) < 60
    least, most = (np.where(far[:, None], *of) for of in (([0.05, 0.1], [0.3, 0.8]), ([0.95, 0.7], [0.7, 0.95])))
    depth_m = np.where(far, rng.uniform(6, 14, 65), rng.uniform(1.2, 1.4, 65))
    points = np.column_stack([P.rays(rng.uniform(least, most) * [P.width, P.height]), np.ones(65)]) * depth_m[:, None]
    now = np.where(far[:, None], se3.transform(TURNS, points), points)
    first_px, z_px = (P.project(x) + rng.normal(size=(65, 4)) * 0.5 * STD_PX for x in (points, now))
    before = np.column_stack([P.rays(first_px), np.ones(65), P.inverse_depth(first_px)])
    return with_views(before, first_px, depth_m, z_px, 0.5 * np.eye(4)[:, 2:3]), far


def with_views(
    before: np.ndarray, first_px: np.ndarray, depth_m: np.ndarray, z_px: np.ndarray, shared: np.ndarray
) -> Seen:
    """Points `before` (n, 4) from their first views and their views now (n, 4), with `shared` (4, j) errors of all."""
    n, nothing = len(z_px), cast(Any, None)
    cov_points = np.zeros((n, 4, 4))
    cov_points[:, [0, 1], [0, 1]] = (STD_PX / P.f_px) ** 2
    cov_points[:, 3, 3] = 2 * (STD_PX / (P.f_px * P.baseline_m)) ** 2
    cov_px = np.broadcast_to(STD_PX**2 * np.eye(4), (n, 4, 4))
    shared_px = np.broadcast_to(shared, (n, *shared.shape))
    views = PointViews(P, before, cov_points, z_px, cov_px, shared=shared_px)
    tracks = changed(tracks_at(depth_m, left_px=first_px[:, :2]), points=before)
    return Seen(tracks, nothing, views, np.ones(n), float(n))


def chosen(found: Seen, motion: Resection, start: StartCheck) -> Resection:
    return chosen_since(found, motion, start)[0]


def chosen_since(found: Seen, motion: Resection, start: StartCheck) -> tuple[Resection, StartCheck]:
    """The choice, and the check of the start after it."""
    nothing = cast(Any, None)
    step = Step(Setup(P, Config()), nothing, nothing, 0.05, TURNS, True, None)
    state: Any = SimpleNamespace(start=start, unsteadiness=None, ambiguity=AmbiguityMemory())
    return choose(step, state, found, motion)


def test_at_the_start_the_motion_of_a_body_is_not_followed() -> None:
    misled = 0
    for seed in range(12):
        found, of = seen(seed, 0.08)
        motion = resect(found.point_views, TURNS)
        misled += bool(motion.accepted[of == 2].all() and motion.second is None)
        if motion.second is None:
            motion = chosen(found, motion, StartCheck())
            assert motion.accepted[of == 1].mean() > 0.5 and not motion.accepted[of == 2].any()
            assert motion.second is not None and motion.second.in_front and motion.second.views[of == 2].all()
            error = se3.log(motion.cam_from_ref @ se3.inverse(TURNS))
            assert np.linalg.norm(error[:3]) < 0.04  # 0.08 m would be the error if the body were followed
    assert misled > 6  # otherwise nothing is tested


def test_with_views_quieter_than_assumed_few_points_in_between_are_enough() -> None:
    """With two points in between and a slow body, hardly any view is beyond the gates of σ with either motion."""
    misled = decided = 0
    for seed in range(12):
        found, of = seen(seed, 0.018, (60, 2, 10), QUIET)
        motion = resect(found.point_views, TURNS)
        if motion.second is None and motion.accepted[of == 2].all():
            misled += 1
            motion, start = chosen_since(found, motion, StartCheck())
            assert start.suspects or not motion.accepted[of == 2].any()
            if not start.suspects:
                decided += 1
                assert np.linalg.norm(se3.log(motion.cam_from_ref @ se3.inverse(TURNS))[:3]) < 0.012
    assert misled > 6 and decided > 0.7 * misled


def test_frames_that_each_say_little_reveal_a_slow_body_together() -> None:
    """In a single frame the two motions differ by 2 to 6 σ. Until it is decided, the start is in doubt."""
    doubted = 0
    for seed in range(6):
        start, frames = StartCheck(), 0
        while not start.followed_body and frames < 5:
            found, of = seen(100 * seed + frames, 0.012, (40, 4, 10))
            found = changed(found, before=changed(found.before, agreed=np.full(len(of), frames)))
            motion = resect(found.point_views, TURNS, find_second=False)
            if frames == 0:
                assert motion.accepted[of == 2].mean() > 0.8  # the body is followed
            motion, start = chosen_since(found, motion, start)
            frames += 1
            doubted += start.suspects
        assert start.followed_body and motion.accepted[of != 2].mean() > 0.9 and motion.accepted[of == 2].mean() < 0.5
        assert motion.second is not None and motion.second.in_front
        error = se3.log(motion.cam_from_ref @ se3.inverse(TURNS))
        assert error @ np.linalg.solve(motion.cov_pose, error) < 22.5  # χ² of six unknowns, in one of a thousand
    assert doubted >= 6


def test_a_body_found_in_the_first_frame_has_not_been_followed() -> None:
    found, far = with_own_body(0)
    motion, start = chosen_since(found, resect(found.point_views, np.eye(4), predicted=np.eye(4)), StartCheck())
    assert motion.accepted[far].mean() > 0.9 and not start.followed_body and not start.suspects


def test_far_points_with_a_second_body_do_not_take_the_near_scene_for_one() -> None:
    """Without the nearer half the motion is that of a body, whose points lie before those that deny its motion."""
    for seed in range(6):
        found, of = seen(seed, 0.1, (40, 12, 10))
        motion = resect(found.point_views, TURNS, find_second=False)
        if motion.accepted[of == 1].mean() > 0.9 and not motion.accepted[of == 2].any():
            now, start = chosen_since(found, motion, StartCheck())
            assert np.array_equal(now.cam_from_ref, motion.cam_from_ref) and not start.suspects


@pytest.mark.parametrize("noise", [QUIET, 1.0, 2.0])
def test_frames_of_a_static_scene_cast_no_doubt_on_a_start(noise: float) -> None:
    start, doubted = StartCheck(), 0
    for seed in range(20):
        found, _ = seen(seed, 0.0, (40, 4, 10), noise)
        _, start = chosen_since(found, resect(found.point_views, TURNS, find_second=False), start)
        doubted += start.suspects
        assert not start.followed_body
    assert doubted == 0 or noise > 1  # gates that are too narrow choose the views that agree


def test_the_robots_own_body_does_not_lead_the_far_points_along() -> None:
    """An unknown disparity error lets far points agree with a motion that keeps the body at rest."""
    for seed in range(6):
        found, far = with_own_body(seed)
        motion = resect(found.point_views, np.eye(4), predicted=np.eye(4))
        assert np.linalg.norm(se3.log(motion.cam_from_ref @ se3.inverse(TURNS))[:3]) > 0.03  # metres
        motion = chosen(found, motion, StartCheck())
        assert motion.accepted[far].mean() > 0.9 and not motion.accepted[~far].any()
        assert np.linalg.norm(se3.log(motion.cam_from_ref @ se3.inverse(TURNS))[:3]) < 0.01


@pytest.mark.parametrize("noise", [QUIET, 1.0, 2.0])
def test_in_a_static_scene_the_motion_is_that_of_all_points(noise: float) -> None:
    for seed in range(12):
        found, _ = seen(seed, 0.0, noise=noise)
        motion = resect(found.point_views, TURNS)
        assert chosen(found, motion, StartCheck()) is motion


def test_after_the_start_history_decides() -> None:
    found, _ = seen(0, 0.08)
    motion = resect(found.point_views, TURNS, find_second=False)
    assert chosen(found, motion, StartCheck(gone=True)) is motion


def chosen_after_start(
    found: Seen, motion: Resection, new: np.ndarray, predicted: np.ndarray, std_m: float
) -> Resection:
    """The choice where all but `new` tracks (n,) have a full history, and samples predict the motion to `std_m`."""
    agreed = np.where(new, 0, MotionRules().full_history)
    found = changed(found, before=changed(found.before, agreed=agreed))
    nothing = cast(Any, None)
    cov = np.diag(np.repeat([std_m, 0.1 * std_m], 3) ** 2)
    samples: Any = SimpleNamespace(previous_from_cam=se3.inverse(predicted), cov=cov, agreed=True)
    step = Step(Setup(P, Config()), nothing, nothing, 0.05, predicted, True, samples)
    state: Any = SimpleNamespace(start=StartCheck(gone=True), unsteadiness=None, ambiguity=AmbiguityMemory())
    return choose(step, state, found, motion)[0]


def test_tracks_with_a_history_and_samples_tell_a_body_that_comes_into_view() -> None:
    misled = 0
    for seed in range(12):
        found, of = seen(seed, 0.03)
        motion = resect(found.point_views, TURNS)
        if motion.accepted[of == 2].all() and motion.second is None:
            misled += 1
            now = chosen_after_start(found, motion, of == 2, TURNS, 0.002)
            assert now.accepted[of != 2].mean() > 0.9
            assert np.linalg.norm(se3.log(now.cam_from_ref @ se3.inverse(TURNS))[:3]) < 0.006
            assert now.second is not None and now.second.views[of == 2].mean() > 0.5 and now.ambiguous is None
    assert misled > 3  # otherwise nothing is tested


def test_tracks_with_a_history_refute_a_wrong_prediction() -> None:
    for seed in range(6):
        found, of = seen(seed, 0.0)
        motion = resect(found.point_views, TURNS)
        for moves_m in (0.05, 0.3):
            predicted = se3.exp([moves_m, 0, 0, 0, 0, 0]) @ TURNS
            assert chosen_after_start(found, motion, of < 0, predicted, 0.002) is motion


def two_sets(seed: int, moves_m: float) -> tuple[Seen, np.ndarray, Resection]:
    """The views of 30 near points and of nine at the end of a corridor, which also `moves_m`; and a motion of each.

    The first one is what near points alone may say: off by 5 σ in a direction that only the far ones determine.
    """
    found, of = seen(seed, moves_m, (0, 30, 9))
    views, far = found.point_views, of == 2
    near, end = (resect(views.select(rows), TURNS, find_second=False) for rows in (~far, far))
    values, vectors = np.linalg.eigh(near.cov_pose)
    worst = se3.exp(5 * np.sqrt(values[-1]) * vectors[:, -1]) @ near.cam_from_ref
    squared = residuals_of(views, worst)
    second = SecondMotion(end.cam_from_ref, end.cov_pose, far, odds=1.0)
    first = changed(near, cam_from_ref=worst, accepted=~far, squared_residuals=squared, second=second)
    return found, far, first


def test_two_sets_of_a_static_scene_that_one_motion_explains_are_one() -> None:
    for seed in range(8):
        found, _, motion = two_sets(seed, 0.0)
        one = chosen(found, motion, StartCheck(gone=True))
        assert one.second is None and one.accepted.mean() > 0.9
        assert np.linalg.norm(se3.log(one.cam_from_ref @ se3.inverse(TURNS))) < 0.02


def test_two_sets_that_no_motion_explains_stay_two() -> None:
    for seed in range(8):
        found, far, motion = two_sets(seed, 0.15)
        kept = chosen(found, motion, StartCheck(gone=True))
        assert kept.second is not None and kept.second.views[far].all()


def test_a_second_motion_that_does_not_differ_is_none() -> None:
    """Its views differ by an error that they share, and the camera has moved alike by both."""
    found, _, motion = two_sets(3, 0.15)
    apart = se3.exp(np.linalg.cholesky(motion.cov_pose) @ np.ones(6))
    assert motion.second is not None
    second = changed(motion.second, cam_from_ref=apart @ motion.cam_from_ref, cov_pose=motion.cov_pose)
    same = chosen(found, changed(motion, second=second), StartCheck(gone=True))
    assert same.second is None and np.array_equal(same.cam_from_ref, motion.cam_from_ref)
