"""What all views of a point have wrong together: larger where a patch lies across a depth edge, kept in bounds."""

import numpy as np
import pytest

from stream_sfm.frontend.disparity_bias import MIN_BIAS_PX, DisparityBias
from stream_sfm.types import StereoFrame
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.wall import Wall, rig


def test_points_across_a_depth_edge_say_so() -> None:
    """The same wall nearer by 6 px of disparity in the right half of the left image."""
    stereo = rig()
    left, right = Wall(7).frame(stereo, np.eye(4), 0).images
    edge = left.shape[1] // 2
    nearer = np.roll(right, -6, axis=1)
    split = right.copy()
    split[:, edge - 30 :] = nearer[:, edge - 30 :]  # the edge is about there in the right image
    std_px = {}
    for name, image in (("wall", right), ("edge", split)):
        front = SteppedFrontEnd(stereo)
        seen = front.step(StereoFrame(0, left, image))
        near_edge = np.abs(seen.z_px[:, 2] - (edge - 30)) < 9
        std_px[name] = np.median(front.state.bias.std_px(seen.track_ids)[near_edge])
    assert std_px["edge"] > 1.5 * std_px["wall"]


def test_what_is_not_known_has_the_least_and_memory_is_bounded() -> None:
    bias = DisparityBias()
    assert (bias.std_px(np.arange(3)) == MIN_BIAS_PX).all()
    assert bias.std_px(np.empty(0, np.int64)).shape == (0,)
    for start in range(0, 50_000, 1000):
        ids = np.arange(start, start + 1000)
        bias = bias.learnt(ids, np.full(1000, 0.3))
        assert bias.std_px(ids) == pytest.approx(np.hypot(MIN_BIAS_PX, 0.3))
    assert len(bias.ids) == len(bias.stds_px) < 30_000  # the last ones begun
    assert bias.std_px(bias.ids[:1])[0] > 0.3
    assert bias.std_px(bias.ids[:1] - 1)[0] == MIN_BIAS_PX
