"""Two sets of points with different motions, neither with more history: this is reported, and covered by σ."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators.window.ambiguous_motions import AmbiguousMotion, AmbiguousMotions
from stream_sfm.estimators.window.cross_frame import CrossFrame
from stream_sfm.geometry import se3
from stream_sfm.geometry.resection import Resection, SecondMotion
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.record import changed
from stream_sfm.types import Ambiguity, Observations, Status
from tests.helpers.estimators import nees

P = StereoProjection(400.0, 320.0, 320.0, 240.0, 0.2, 640, 480)
STD_PX = 0.2
STEP = se3.exp([0.02, 0, 0.01, 0, 0.005, 0])  # of the camera per frame
OWN = np.array([0.03, 0.01, 0.0, 0.0, 0.004, 0.0])  # of the other set per frame, once it moves


def observations(frames: int, moves_from: int, seed: int = 0) -> tuple[list[Observations], np.ndarray]:
    """Views of two sets of 80 points, in the left and in the right half of the image; poses of the camera."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(2, 5, 160)
    u = np.concatenate([rng.uniform(40, 310, 80), rng.uniform(330, 600, 80)])
    rays = np.stack([(u - 320) / 400, (rng.uniform(20, 460, 160) - 240) / 400, np.ones(160)], axis=1)
    world = rays * depth[:, None]
    pose, found, poses = np.eye(4), [], []
    for index in range(frames):
        moved = world.copy()
        moved[:80] = se3.transform(se3.exp(max(0, index - moves_from + 1) * OWN), world[:80])
        z_px = P.project(se3.transform(se3.inverse(pose), moved)) + rng.normal(size=(160, 4)) * STD_PX
        cov_px = np.broadcast_to(STD_PX**2 * np.eye(4), (160, 4, 4))
        found.append(Observations(index, index * 50_000_000, np.arange(160), z_px, cov_px))
        poses.append(pose)
        pose = pose @ STEP
    return found, np.array(poses)


def test_two_motions_that_agree_are_reported_and_covered() -> None:
    frames, poses = observations(7, moves_from=5)
    estimator = CrossFrame(P, Config())
    solutions = [estimator.step(o) for o in frames]
    assert all(s.status is Status.OK for s in solutions[1:5])
    ambiguous = solutions[5]
    assert ambiguous.status is Status.DEGRADED
    assert "two rigid motions agree with the views" in ambiguous.reason
    certain = solutions[4]
    assert np.trace(ambiguous.cov_pose[:3, :3]) > 10 * np.trace(certain.cov_pose[:3, :3])
    # the camera's pose according to the other set: both are within a few standard deviations
    # or according to a third set, whose motion differs by as much in another direction
    third = se3.exp(OWN[[1, 2, 0, 4, 5, 3]]) @ poses[5]
    for pose in (poses[5], se3.exp(-OWN) @ poses[5], third):
        assert nees(ambiguous.world_from_cam, ambiguous.cov_pose, pose) < 30  # χ²(6), once in 25 000
    assert ambiguous.relative is not None
    before = np.flatnonzero(ambiguous.relative.frame_indices == 4)[0]
    motion, cov = ambiguous.relative.frame_from_newest[before], ambiguous.relative.cov[before]
    assert nees(motion, cov, se3.inverse(poses[4]) @ third) < 30  # χ²(6), once in 25 000


def test_the_set_that_has_agreed_for_longer_is_the_background() -> None:
    """The left half is new in every frame, and moves; the right half is old."""
    frames, poses = observations(8, moves_from=1)
    renewed = []
    for index, o in enumerate(frames):
        ids = np.concatenate([1000 * (index // 2 + 1) + np.arange(80), np.arange(80, 160)])
        order = np.argsort(ids)
        renewed.append(Observations(index, o.stamp_ns, ids[order], o.z_px[order], o.cov_px[order]))
    estimator = CrossFrame(P, Config())
    solutions = [estimator.step(o) for o in renewed]
    for solution, pose in zip(solutions[4:], poses[4:], strict=True):
        error = se3.log(se3.inverse(solution.world_from_cam) @ pose)
        assert np.linalg.norm(error[:3]) < 0.02  # m; the other set moves by 0.03 per frame
        assert solution.status is Status.OK


def test_a_settled_motion_no_longer_counts() -> None:
    frames, _ = observations(9, moves_from=99)
    other = Ambiguity(se3.exp(-OWN) @ se3.inverse(STEP), 1e-8 * np.eye(6))
    with_start = [replace(o, cam_from_previous=se3.inverse(STEP)) for o in frames]
    ambiguous = [replace(o, ambiguity=other) if 3 <= k < 6 else o for k, o in enumerate(with_start)]
    settled = [replace(o, settled=k == 7) for k, o in enumerate(ambiguous)]
    plain, never, back = ([CrossFrame(P, Config())] for _ in range(3))
    runs = [[e[0].step(o) for o in seen] for e, seen in ((plain, with_start), (never, ambiguous), (back, settled))]
    std_m = np.array([[np.sqrt(np.trace(s.cov_pose[:3, :3])) for s in run] for run in runs])
    assert (std_m[1:, 6] > 3 * np.linalg.norm(OWN[:3])).all()  # three frames with the same error
    assert std_m[1, 8] > 3 * np.linalg.norm(OWN[:3])
    assert np.allclose(std_m[2, 7:], std_m[0, 7:], rtol=0.05)
    in_world = [np.linalg.eigvalsh(run[8].cov_points_in_world).mean() for run in runs]
    assert in_world[1] > 0.01 and abs(in_world[2] / in_world[0] - 1) < 0.1
    relative = [run[8].relative.cov[0] for run in runs]
    assert np.allclose(relative[2], relative[0], atol=1e-7)


def test_what_later_tracks_do_not_confirm_stays_ambiguous() -> None:
    """The same points get new tracks at frame 5: in frame 6, none shows how the camera moved in frames 3 to 5."""
    frames, _ = observations(10, moves_from=99)
    other = Ambiguity(se3.exp(-OWN) @ se3.inverse(STEP), 1e-8 * np.eye(6))
    std_m, in_world = {}, {}
    for anew_at in (5, 99):
        estimator, runs = CrossFrame(P, Config()), []
        for k, o in enumerate(frames):
            old, new = np.arange(160), np.arange(160, 320)
            rows = old if k < anew_at else np.r_[old, old] if k == anew_at else old
            ids = old if k < anew_at else np.r_[old, new] if k == anew_at else new
            ambiguity = other if 3 <= k < 6 else None
            seen = replace(o, track_ids=ids, z_px=o.z_px[rows], cov_px=o.cov_px[rows], ambiguity=ambiguity)
            start = se3.inverse(STEP) if k else None
            runs.append(estimator.step(replace(seen, cam_from_previous=start, settled=k == 8)))
        std_m[anew_at] = np.sqrt(np.trace(runs[-1].cov_pose[:3, :3]))
        in_world[anew_at] = np.linalg.eigvalsh(runs[-1].cov_points_in_world).mean()
    assert std_m[5] > 3 * np.linalg.norm(OWN[:3]) and std_m[99] < 0.01
    assert in_world[5] > 0.01 > 10 * in_world[99]


def test_the_path_to_the_last_unconfirmed_motion_stays_ambiguous() -> None:
    ids = np.arange(40)
    motions = tuple(AmbiguousMotion(ids[k : k + 12], (k + 1.0) * np.eye(6)) for k in range(4))
    path = AmbiguousMotions(cov=4 * np.eye(6), frames=4, motions=motions)
    alone = Resection(STEP, np.eye(6), np.ones(40, bool), 0.0, 34, 1.0, True, np.zeros(40))
    for first, confirmed in ((0, 4), (1, 3), (3, 1), (4, 0)):
        seen, _ = path.with_second(alone, np.full(6, 0.1), np.eye(4), ids[first:])
        later, _ = seen.with_second(alone, np.full(6, 0.1), np.eye(4), ids[:0])  # the first frame counts
        after, n = later.settled(ids[first:])
        assert n == confirmed and not after.cov.any() and not after.motions
        assert np.array_equal(after.cov_left, (4 - confirmed) * np.eye(6))
        assert np.array_equal(after.of_newest(np.eye(4)), after.cov_left)


def test_if_the_tracks_after_an_ambiguity_have_gone_nothing_is_confirmed() -> None:
    """The motion that has proved to be the camera's may then be that of others than those followed."""
    ids = np.arange(40)
    path = AmbiguousMotions(cov=np.eye(6), frames=1, motions=(AmbiguousMotion(ids, np.eye(6)),), after=ids)
    assert path.settled(ids[28:])[1] == 1
    left, confirmed = path.settled(ids[29:])
    assert confirmed == 0 and np.array_equal(left.cov_left, np.eye(6))


@pytest.mark.parametrize("agree,is_confirmed", [(11, False), (12, True), (19, False), (20, True)])
def test_most_tracks_of_a_motion_confirm_it(agree: int, is_confirmed: bool) -> None:
    """And at least twelve. Before tiles half of them agree later although their depths, and the motion, are wrong."""
    ids = np.arange(30 if agree > 12 else 12)
    path = AmbiguousMotions(cov=np.eye(6), frames=1, motions=(AmbiguousMotion(ids, np.eye(6)),))
    now = np.arange(len(ids) - agree, len(ids) + 30)
    assert path.settled(now)[1] == is_confirmed


def test_the_memory_of_ambiguous_motions_is_bounded() -> None:
    """Nothing confirms the forgotten ones any more, so that the path up to them stays ambiguous."""
    path, ids = AmbiguousMotions(), np.arange(40)
    second = SecondMotion(se3.exp(OWN) @ STEP, 1e-8 * np.eye(6), np.zeros(40, bool), 1.0)
    motion = Resection(STEP, np.eye(6), np.ones(40, bool), 0.0, 34, 1.0, True, np.zeros(40), second=second)
    for _ in range(200):
        path, _ = path.with_second(motion, np.full(6, 0.1), np.eye(4), ids)
    assert len(path.motions) < 200
    alone = changed(motion, second=None)
    after, confirmed = path.with_second(alone, np.full(6, 0.1), np.eye(4), ids)[0].settled(ids)
    assert confirmed == len(path.motions) - 1
    assert 0 < np.trace(after.cov_left) < np.trace(path.cov)
