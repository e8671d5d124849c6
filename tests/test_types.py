"""Records with arrays are printed on one short line, and equal only themselves."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.dense.mesh import Mesh
from stream_sfm.dense.surface import Surface
from stream_sfm.logs.recording.frames import recorded_frame
from stream_sfm.logs.recording.messages import ImageMessage
from stream_sfm.logs.recording.pair_reader import StereoPair
from stream_sfm.results.estimates_reader import Cloud
from stream_sfm.types import Ambiguity, LastingErrors, MapStart, Observations, Solution
from tests.helpers.wall import rig
from tests.results.test_estimates import estimate


def test_an_estimate_says_pose_sigma_and_points_in_one_line() -> None:
    one = estimate(2)
    x, y, z = one.world_from_cam[:3, 3]
    std_m = np.sqrt(np.trace(one.cov_pose[:3, :3]))
    assert repr(one) == f"<FrameEstimate 2 ok t=({x:.3f}, {y:.3f}, {z:.3f}) m σ={std_m:.2g} m, 5 points>"
    assert " units σ=" in repr(replace(one, unscaled=True))


def records() -> list[object]:
    image, views, cov = np.zeros((48, 64), np.uint8), np.zeros((5, 4)), np.zeros((5, 4, 4))
    start = MapStart(views, cov, np.eye(4), np.zeros((6, 6)))
    points, covs = np.zeros((5, 3)), np.zeros((5, 3, 3))
    ids = np.arange(5)
    pose = np.eye(4), np.eye(6)
    image_message = ImageMessage("/left", 7, "cam", True, "png", b"123")
    pair = StereoPair(image_message, image_message)
    mesh = Mesh(np.zeros((3, 3), np.float32), np.zeros((1, 3), np.int32), np.zeros((3, 3), np.float32),
                np.zeros((3, 3), np.uint8), np.zeros(3, np.float32))  # fmt: skip
    cloud = Cloud(7, "world", np.arange(3), np.zeros((3, 3), np.float32), np.zeros((3, 3, 3), np.float32))
    solution = Solution(sfm.Status.OK, "", *pose, ids, points, covs, points, covs, ids, np.zeros((5, 4, 4)))
    return [
        recorded_frame(pair, [image, image]), mesh, Surface(mesh, 3, 2, 0.01, np.zeros((3, 3))), cloud, estimate(2),
        solution, Observations(12, 7, ids, views, cov, start=start), LastingErrors(np.zeros(5), np.ones((5, 2))),
        Ambiguity(*pose), start, sfm.StereoFrame(7, image, image), sfm.MonoFrame(7, image),
        sfm.Trajectory(ids, np.zeros((5, 4, 4))), sfm.Trajectory(ids[:0], np.zeros((0, 4, 4))), rig(), rig().left,
        sfm.MonoRig(rig().left),
    ]  # fmt: skip


def test_every_record_has_a_short_repr_and_equals_itself_only() -> None:
    assert "str" in repr(sfm.StereoFrame(7, "left.png", np.zeros((48, 64), np.uint8)))  # type: ignore[arg-type]
    for one, other in zip(records(), records(), strict=True):
        assert repr(one).startswith(f"<{type(one).__name__}") and len(repr(one)) < 250, repr(one)
        assert "\n" not in repr(one) and "array" not in repr(one)
        assert one == one and one != other
        assert {one: 1}[one] == 1


@pytest.mark.parametrize(
    "wrong,message",
    [
        ({"start_s": -1.0}, "start_s is -1.0; give seconds from the first frame"),
        ({"end_s": float("nan")}, "end_s is nan"), ({"start_s": "1"}, "start_s is '1'"),
        ({"max_frames": 0}, "max_frames is 0; give a whole number of at least 1"), ({"stride": 0}, "stride is 0"),
        ({"stride": None}, "stride is None"), ({"stride": 1.5}, "stride is 1.5"),
        ({"start_s": 5, "end_s": 4}, "the end, 4 s, lies before the start, 5 s"),
    ],
)  # fmt: skip
def test_an_impossible_selection_is_refused_when_it_is_made(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(sfm.ConfigError, match=message):
        sfm.Selection(**wrong)


def test_a_selection_counts_the_frames_that_it_takes() -> None:
    assert sfm.Selection().is_everything and not sfm.Selection(stride=2).is_everything
    assert [sfm.Selection(stride=4).count(n) for n in (12, 13, None)] == [3, 4, None]
    assert sfm.Selection(max_frames=3, stride=4).count(100) == 3
    assert sfm.Selection(max_frames=30).count(12) == 12
    assert sfm.Selection(start_s=1.0).count(100) is None
    assert sfm.Selection(end_s=1.0, max_frames=5).count(100) == 5
