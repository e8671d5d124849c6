"""A rival is remembered for a while after the views that spoke for it have gone, then forgotten."""

import numpy as np

from stream_sfm.frontend.contest import Contest
from stream_sfm.frontend.tracks import Tracks
from stream_sfm.geometry import se3
from stream_sfm.geometry.resection import Resection, SecondMotion

FIRST = se3.exp([0.01, 0, 0.02, 0, 0.01, 0])
OTHER_FROM_FIRST = se3.exp([0.05, 0.01, 0, 0, 0, 0.02])


def motion(cam_from_ref: np.ndarray, odds: float | None) -> Resection:
    """A resection of ten views with a second motion of such odds, or without one."""
    second = None
    if odds is not None:
        second = SecondMotion(OTHER_FROM_FIRST @ cam_from_ref, np.eye(6), np.zeros(10, bool), odds)
    return Resection(cam_from_ref, np.eye(6), np.ones(10, bool), 0.0, 34, 1.0, True, np.zeros(10), 1.0, second)


def test_a_doubt_outlives_its_views_by_ten_frames_with_the_same_difference() -> None:
    contest = Contest()
    assert contest.judge(motion(FIRST, None)) is None
    assert contest.judge(motion(FIRST, 0.01)) is None  # a body that has no history
    rival = contest.judge(motion(FIRST, 0.5))
    assert rival is not None and np.array_equal(rival.cam_from_ref, OTHER_FROM_FIRST @ FIRST)
    turned = FIRST @ se3.exp([0, 0, 0, 0, 0.1, 0])
    for _ in range(10):
        rival = contest.judge(motion(turned, None))
        assert rival is not None
        assert np.allclose(rival.cam_from_ref, OTHER_FROM_FIRST @ turned, atol=1e-12)
    assert contest.judge(motion(turned, None)) is None


def test_a_long_contest_is_doubted_for_as_long_again() -> None:
    contest = Contest()
    for _ in range(25):
        assert contest.judge(motion(FIRST, 0.5)) is not None
    doubted = [contest.judge(motion(FIRST, None)) is not None for _ in range(30)]
    assert doubted == [True] * 25 + [False] * 5
    assert contest.judge(motion(FIRST, 0.5)) is not None  # a new one, of which nothing is remembered but itself
    assert sum(contest.judge(motion(FIRST, None)) is not None for _ in range(30)) == 10


def test_no_track_earns_history_while_the_motion_is_contested() -> None:
    none = Tracks.none()
    agreed = np.array([10, 10, 0, 0])
    arrays = {name: np.zeros((4, *getattr(none, name).shape[1:])) for name in Tracks.__dataclass_fields__}
    tracks = Tracks(**arrays | {"agreed": agreed, "rejected": np.zeros(4, np.int64)})
    accepted = np.array([True, False, True, False])
    contested = tracks.judged(accepted, contested=True)
    assert contested.agreed.tolist() == [10, 10, 0, 0] and contested.rejected.tolist() == [0, 1, 0, 1]
    assert tracks.judged(accepted, contested=False).agreed.tolist() == [11, 5, 1, 0]
