"""The test by halves: 1 where errors are as claimed, and what it is where they are larger."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config, RobustConfig
from stream_sfm.observer import Observed
from stream_sfm.run.self_test import SelfTest
from stream_sfm.simulation.scenes import Scene

SCENE = Scene(frames=24, track_length=8, visible=100, std_px=0.2, round_off=False)
TRIALS = 4
CONFIG = Config(robust=RobustConfig(gate_probability=1 - 1e-9))  # takes no large errors away


@pytest.mark.parametrize("too_small", [1.0, 1.4])
def test_halves_are_apart_by_as_much_as_their_covariances_say(too_small: float) -> None:
    """Points are seen in eight frames, so a trial has two independent motions of six components, whatever the span."""
    found: dict[tuple[str, int], list[float]] = {}
    for seed in range(TRIALS):
        sequence = SCENE.sequence(np.random.SeedSequence(seed))
        test = SelfTest(sequence.projection, CONFIG)
        for o in sequence.observations:
            test.add(Observed(replace(o, cov_px=o.cov_px / too_small**2), {}), {})
        for name, spans in test.result().items():
            for span in spans:
                found.setdefault((name, span["frames"]), []).append(span["factor"])
    assert {name for name, _ in found} == {"tracks", "image"}
    standard_error = too_small / np.sqrt(2 * 6 * 2 * TRIALS)
    for (name, frames), factors in found.items():
        assert abs(np.sqrt(np.mean(np.square(factors))) - too_small) < 3 * standard_error, (name, frames)
