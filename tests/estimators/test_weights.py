"""All methods have the covariances of the views; those "with lasting errors" weight them by eq. (69) as well."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators import make_estimator
from stream_sfm.simulation.scenes import Scene
from stream_sfm.types import LastingErrors

PLAIN = ("ekf", "iterated-ekf", "frame-to-frame", "cross-frame-wc", "cross-frame-cc", "ekf-cv", "depth-filter")
SCENE = Scene(frames=8, track_length=6, visible=60).sequence(np.random.SeedSequence(2))


def poses(method: str, lasting: bool) -> np.ndarray:
    """Poses from views whose errors are said to last, the right ones longer, or not."""
    estimator, found = make_estimator(method, SCENE.projection, Config()), []
    for o in SCENE.observations:
        age = np.minimum(o.frame_index, 4) * np.ones(len(o.track_ids))
        inflation = np.column_stack([1 + age, 1 + 2 * age]) if lasting else None
        found.append(estimator.step(replace(o, lasting=LastingErrors(None, inflation))).world_from_cam)
    return np.array(found)


@pytest.mark.parametrize("method", PLAIN)
def test_plain_weights_are_those_of_the_covariances(method: str) -> None:
    assert poses(method, True).tobytes() == poses(method, False).tobytes()


@pytest.mark.parametrize("method", ["ekf", "iterated-ekf"])
def test_rows_with_lasting_errors_differ_in_nothing_else(method: str) -> None:
    """Without lasting errors both are one method, with them they are not."""
    lasting = f"{method}-lasting"
    assert np.abs(poses(lasting, True) - poses(method, True)).max() > 1e-5
    assert poses(lasting, False).tobytes() == poses(method, False).tobytes()
