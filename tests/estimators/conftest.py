"""One small sequence with everything in it: turning path, natural visibility."""

import numpy as np
import pytest

from stream_sfm.simulation.scenes import MOTIONS, Scene, Sequence


@pytest.fixture(scope="session")
def arc() -> Sequence:
    return Scene(frames=14, motion=MOTIONS["arc"], density=40).sequence(np.random.SeedSequence(5))
