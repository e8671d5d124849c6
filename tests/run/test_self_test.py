"""The test by halves: the factor is 1 if σ is right, and grows with larger errors."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config, RigConfig
from stream_sfm.config.rules import Rules
from stream_sfm.geometry.robust_rules import RobustRules
from stream_sfm.logs.recording.stereo_log import open_log
from stream_sfm.pipeline.observer import Observed, Observer
from stream_sfm.run.lane import Lane
from stream_sfm.run.loop import run
from stream_sfm.run.self_test import SelfTest, SelfTestOfRun
from stream_sfm.simulation.scenes import Scene
from stream_sfm.system.interrupts import Interruption
from stream_sfm.types import Selection
from tests.helpers.places import DEMO

SCENE = Scene(frames=24, track_length=8, visible=100, std_px=0.2, round_off=False)
TRIALS = 4
CONFIG = Config(rules=Rules((RobustRules(gate_probability=1 - 1e-9),)))  # takes no large errors away


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


@pytest.mark.slow
def test_halves_are_given_the_calibration_that_the_run_has_found() -> None:
    """The demo's is off, so halves that find it differently, and later, are apart otherwise than halves given one."""
    log, interruption = open_log(DEMO), Interruption()
    lane = Lane(Config(), Observer(log.rig, Config()), None, None)
    test, exact = (
        SelfTestOfRun(lane),
        SelfTestOfRun(Lane(Config(rig=RigConfig(exact=True)), lane.observer, None, None)),
    )
    run(log, lane, (), (test, exact), selection=Selection(max_frames=14), interruption=interruption)
    found, told = test.result(interruption), exact.result(interruption)
    for name in ("tracks", "image"):
        by_themselves, calibrated = found[name], found[f"{name}_calibrated"]
        assert [s["frames"] for s in calibrated] == [s["frames"] for s in by_themselves] == [1, 2, 5, 8]
        assert all(a["factor"] != b["factor"] for a, b in zip(calibrated, by_themselves, strict=True))
        assert told[name] and not told[f"{name}_calibrated"]
        assert all(s["factor_own"] == s["factor"] and s["factor_common"] > 0 for s in by_themselves)
        assert all(s["factor_common"] is None for s in calibrated)  # there is one rig
    interruption.requested = True
    assert not test.result(interruption)["image_calibrated"]
    test.close()
