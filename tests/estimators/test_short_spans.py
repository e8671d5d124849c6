"""Why frame-to-frame can be ahead over a few frames: errors that last along a track cancel within a pair."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators import make_estimator
from stream_sfm.evaluation.relative import mean_squares
from stream_sfm.frontend.persistence import Persistence
from stream_sfm.simulation.scenes import Scene
from stream_sfm.types import LastingErrors
from tests.frontend.test_persistence import with_lasting_errors

SPANS = [1, 4, 16]


def frame_to_frame_over_window(ratio: float, scenes: int = 3) -> np.ndarray:
    """RMS rotation errors over spans, of frame-to-frame over cross-frame; `ratio`: lasting over white variance."""
    squares: dict[str, list[np.ndarray]] = {"cross-frame": [], "frame-to-frame": []}
    for seed in range(scenes):
        s = Scene(track_length=16, frames=41, visible=80).sequence(np.random.SeedSequence(seed))
        observations = list(s.observations)
        if ratio:
            observations = with_lasting_errors(s, ratio, np.random.default_rng(seed))
        persistence = Persistence()
        learnt = []
        for o in observations:
            persistence = persistence.after(o.track_ids, o.z_px, o.cov_px)
            learnt.append(replace(o, lasting=LastingErrors(None, persistence.inflation)))
        for name, found in squares.items():
            estimator = make_estimator(name, s.projection, Config())
            poses = np.array([estimator.step(o).world_from_cam for o in learnt])
            found.append(mean_squares(poses, s.world_from_cam, SPANS)[1])
    pairs, window = (np.mean(squares[name], axis=0) for name in ("frame-to-frame", "cross-frame"))
    return np.sqrt(pairs / window)


@pytest.mark.slow
def test_lasting_errors_favour_pairs_over_short_spans_only() -> None:
    """Three scenes of 41 frames, 120 motions of one frame: the ratio is known to 3 %, as both share their noise."""
    white, lasting = frame_to_frame_over_window(0.0), frame_to_frame_over_window(10.0)
    assert (white > 1).all() and white[1] > 1.2
    assert lasting[0] < 0.95
    assert lasting[1] > 1.05 and lasting[2] > 1.3
