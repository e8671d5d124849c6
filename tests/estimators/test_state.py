"""The state of the window is a record: a step returns the next one, and changes nothing of the one before it."""

import pickle

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators.window.cross_frame import CrossFrame
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.types import Observations
from tests.estimators import test_two_motions as two_motions
from tests.estimators.test_rig_errors import Flight, zoomed
from tests.helpers.imu_views import PROJECTION, observed


def seen(kind: str) -> tuple[StereoProjection, list[Observations]]:
    if kind == "samples":
        return PROJECTION, [observations for _, observations in observed(21, 12)]
    if kind == "two motions":
        return two_motions.P, two_motions.observations(8, moves_from=5)[0]
    flight = Flight(1, 0.008, 0.02, 12)
    longer = np.repeat([1.0, 1.02], [9, 3]) if kind == "zoom" else np.ones(12)
    return flight.P, zoomed(flight, longer)


@pytest.mark.parametrize("kind", ["late and rolling", "zoom", "two motions", "samples"])
def test_a_step_changes_nothing_of_the_state_before_it(kind: str) -> None:
    """Also where frames get unknowns of their own, the prior begins again, or a motion comes into question."""
    projection, observations = seen(kind)
    estimator = CrossFrame(projection, Config())
    for o in observations:
        before = estimator.map
        bytes_before = pickle.dumps(before)
        estimator.step(o)
        assert pickle.dumps(before) == bytes_before
        assert estimator.map is not before
    assert estimator.map is not None
    with pytest.raises(AttributeError):
        estimator.map.own = estimator.map.own[:0]  # type: ignore[misc]
