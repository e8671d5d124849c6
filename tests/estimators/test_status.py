"""Few accepted views degrade a frame if they are few of those that were sought."""

import pytest

from stream_sfm.estimators.lifecycle import frame_status
from stream_sfm.geometry.robust_rules import RobustRules
from stream_sfm.types import Status


@pytest.mark.parametrize(
    ("inliers", "sought", "status"),
    [
        (100, 300, Status.OK),  # another rule judges shares of many views, by their history
        (25, 100, Status.OK),
        (24, 100, Status.DEGRADED),
        (24, 96, Status.OK),
        (13, 56, Status.DEGRADED),
        (12, 48, Status.OK),
        (11, 11, Status.DEGRADED),
    ],
)
def test_a_narrow_view_is_no_fault(inliers: int, sought: int, status: Status) -> None:
    found, reason = frame_status(inliers, sought, "", RobustRules())
    assert found is status
    assert reason == ("" if status is Status.OK else f"only {inliers} accepted views of {sought} points sought")
