"""Runs of a log from several starting frames: which they are, and how they are judged."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.evaluation.association import truth_of_frames
from stream_sfm.geometry import se3
from stream_sfm.types import FrameEstimate, Selection, Status
from tests.helpers.places import DEMO
from tools.starts import FEWEST, Plan, Start, estimates_of, judged, runs_from, told

LOG = sfm.open_log(DEMO)


@lru_cache(maxsize=1)
def estimates() -> list[FrameEstimate]:
    return estimates_of(LOG, sfm.Config(), Selection(max_frames=8))[0]


def truth_of(found: list[FrameEstimate]) -> np.ndarray:
    return truth_of_frames(np.array([e.stamp_ns for e in found]), LOG.ground_truth())


def test_starts_are_even_and_leave_enough_frames_and_strides_begin_at_the_first() -> None:
    assert list(Plan(4, (2, 3)).selections(60)) == [(0, 1), (10, 1), (20, 1), (30, 1), (0, 2), (0, 3)]
    assert list(Plan(4, ()).selections(FEWEST - 1)) == [(0, 1)]


def test_a_pose_that_is_moved_by_ten_sigma_is_wrong_unless_the_truth_errs_as_much() -> None:
    found = estimates()
    true = truth_of(found)
    assert (judged(found, [], true).beyond_poses, judged(found, [], true).beyond_motions) == (0, 0)
    moved = true.copy()
    moved[5, :3, 3] += 10 * np.sqrt(np.diag(found[5].cov_pose)[:3].sum())
    run = judged(found, [], moved)
    assert run.beyond_poses == 1 and run.beyond_motions == 2  # to it and from it
    assert judged(found, [], moved, (1.0, 1.0)).beyond_poses == 0
    lost = [*found[:5], replace(found[5], status=Status.DEGRADED), *found[6:]]
    assert judged(lost, [], moved).beyond_poses == 0 and judged(lost, [], moved).degraded == 1
    moved[0] = np.nan
    assert judged(found, [], moved).beyond_poses is None


def test_errors_of_the_truth_turn_later_poses_about_the_first() -> None:
    """A rotation of the first true pose by its σ moves a pose far away by much more than its own σ."""
    found = [replace(e, world_from_cam=e.world_from_cam.copy()) for e in estimates()]
    far = np.eye(4)
    far[0, 3] = 100.0
    for e in found[1:]:
        e.world_from_cam[:] = far @ e.world_from_cam
    true = np.array([e.world_from_cam for e in found])
    true[1:] = se3.exp([0, 0, 0, 0, 2e-3, 0]) @ true[1:]  # 0.2 m at 100 m
    assert judged(found, [], true, (0.01, 0.0)).beyond_poses == len(found) - 1
    assert judged(found, [], true, (0.01, 2e-3)).beyond_poses == 0


def test_runs_are_those_of_replays_from_these_frames_beside_the_loop() -> None:
    first, later, strided = list(runs_from(LOG, sfm.Config(), Plan(2, (2,), frames=6)))
    assert (first.first, first.stride, later.stride, strided.stride) == (0, 1, 1, 2) and later.first > 0
    stamps_ns = [frame.stamp_ns for frame in LOG.frames(Selection(max_frames=later.first + 1))]
    assert first.run.frames == later.run.frames == strided.run.frames == 6
    replayed, problems = estimates_of(LOG, sfm.Config(), Selection(max_frames=6))
    assert first.run == judged(replayed, problems, truth_of(replayed))
    from_later, _ = estimates_of(
        LOG, sfm.Config(), Selection(start_s=(stamps_ns[-1] - stamps_ns[0]) / 1e9, max_frames=6)
    )
    assert later.run.error_m == judged(from_later, [], truth_of(from_later)).error_m
    for start in (first, later, strided):
        assert start.run.lost == 0 and start.ratio is not None and 0 < start.ratio < 2
    assert told([first, later, strided]).startswith("3 runs, 0 with lost frames, degraded or lost 0 of 18 frames")


def test_without_truth_the_distance_from_the_loop_is_told() -> None:
    found = estimates()
    other = np.array([e.world_from_cam for e in found])
    other[4, 1, 3] += 0.1
    run = judged(found, [], None, other=other)
    assert run.beyond_poses is None and run.error_m == pytest.approx(0.1 * np.sqrt(7) / 8, rel=0.1)
    assert "mm from the loop" in str(Start(3, 1, run, None)) and "beyond" not in str(Start(3, 1, run, None))
