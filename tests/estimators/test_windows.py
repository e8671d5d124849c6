"""One window without a prior: WC, CC and the full adjustment have the same minimum."""

import numpy as np
import pytest

from stream_sfm.config import Config, WindowConfig
from stream_sfm.config.rules import Rules
from stream_sfm.estimators.window.reported.rules import ReportedRules
from stream_sfm.geometry.robust_rules import RobustRules
from tests.helpers.estimators import run
from tests.helpers.full_batch import batch_adjust

# No view is rejected and poses are those of the minimum, so that all solve the same problem.
CONFIG = Config(
    window=WindowConfig(frames=16, max_iterations=30),
    rules=Rules((RobustRules(gate_probability=1 - 1e-9), ReportedRules(most_followed=0.0))),
)


@pytest.fixture(scope="module")
def batch(arc):
    return batch_adjust(arc.projection, arc.observations, arc.world_from_cam, arc.points_in_world)


def last(method, arc, config=CONFIG):
    return run(method, arc.projection, arc.observations, config)[-1]


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [
        ("cross-frame-wc", 1e-4),
        ("cross-frame-cc", 1e-4),
        ("cross-frame-cc-literal", 1e-4),
        # stops when a step would decrease the sum of squares by less than 1e-4: a hundredth of a deviation
        ("cross-frame", 3e-2),
    ],
)
def test_one_window_is_the_batch(method, tolerance, arc, batch):
    """Poses and points agree to `tolerance` standard deviations, covariances as well."""
    s = last(method, arc)
    found, covariances = batch
    cov_pose = covariances.cov_pose(len(arc.observations) - 1)
    scale = np.sqrt(np.diag(cov_pose))
    difference = s.world_from_cam[:3, 3] - found.ref_from_cam[-1, :3, 3]
    assert (np.abs(difference) < tolerance * scale[:3] + 1e-9).all()
    # the batch is linearised at convergence
    assert np.abs((s.cov_pose - cov_pose) / np.outer(scale, scale)).max() < max(tolerance, 1e-4)
    # σ of a point is about a centimetre
    assert np.abs(s.points_in_world - found.points[s.track_ids]).max() < tolerance * 0.01 + 1e-9


def test_depth_filter_is_a_window_of_one(arc):
    one = Config(window=WindowConfig(frames=1))
    assert last("depth-filter", arc, Config()).world_from_cam.tobytes() == (
        last("cross-frame-wc", arc, one).world_from_cam.tobytes()
    )


@pytest.mark.parametrize("method", ["cross-frame-wc", "cross-frame-cc", "cross-frame-cc-literal"])
@pytest.mark.parametrize("frames", [1, 2, 5])
def test_windows_have_the_length_of_their_method(method, frames, arc):
    s = last(method, arc, Config(window=WindowConfig(frames=frames)))
    assert s.window_frame_indices.tolist() == list(range(14 - frames, 14))
